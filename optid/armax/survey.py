"""The whole job of `optid identify` as one function with one frozen result."""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from optid.armax.audit import Audit, audit
from optid.armax.batch import SEARCHED, BatchFit, fit_batch, informed
from optid.armax.forgetting import Constant, Forgetting
from optid.armax.identifiability import EXCITED, OpenDirection, excitation, follows_output
from optid.armax.identifier import Identifier, Method, Settings
from optid.armax.loop import Gains
from optid.armax.model import Armax, from_theta
from optid.armax.multistep import fit_for_horizon
from optid.armax.offline import Identification, identify, names
from optid.armax.order_selection import OrderTable, choose_delay, compare_orders, cut_of
from optid.armax.prediction import innovations
from optid.armax.regression import hannan_rissanen
from optid.armax.signals import Signals, signals
from optid.armax.structure import Orders
from optid.armax.table2 import Entry, Table2, last_value, table2
from optid.armax.trend import Frame, Trend, find_trend
from optid.armax.words import Finding, excitation_finding, feedback_finding, open_findings, trend_finding
from optid.core.model import Array
from optid.errors import InputError

DELAYS = (1, 2, 3, 5, 8, 12)  # samples, tried where none is given
HEAD = 4  # the recursion begins from a regression over one sample in so many, the first ones
FEW = 20_000  # and over no more than these
LATER = Settings(start_sd=0.003, start_sd_c=0.03, ease=None, warm=(0.0, 0.0))  # begins near its aim
SHARED = (
    "stable",
    "unstable",
    "integrating",
    "time_constants",
    "common_factor",
    "noise_cancellation",
    "drift",
)
CLOSE = 1.1  # the recursion's loss may exceed the batch fit's by this factor
LAST = 20_000  # samples by which an identifier that goes on has learnt how sure it is
TESTED = 60_000  # samples on which residuals are tested

Tell = Callable[[float, str], None]


class Estimator(enum.Enum):
    """Who makes the models of a table; the value says how."""

    PEM = "prediction errors of the whole recording made least, offline"
    RML = "recursive maximum likelihood, one pass"
    RLS = "recursive (extended) least squares, one pass, as the paper does"


@dataclass(frozen=True)
class Candidate:
    """One order by the estimator asked for, beside the recursion and the batch fit of the same structure.

    Attributes:
        order: na.
        recursive: what the recursion taught.
        batch: the reference.
        loss: mean squared one-step error of the recursion's last model over the recording.
        model: of the estimator asked for.
        held_out: of the same estimator, fitted to the part before the one held out.
        audit: of `model`, its first input; findings on the paths of the others follow.
        open: what the data leave open.
    """

    order: int
    recursive: Identification
    batch: BatchFit
    loss: float
    model: Armax
    held_out: Armax
    audit: Audit
    open: tuple[OpenDirection, ...]

    @property
    def settled(self) -> bool:
        """The recursion's model predicts about as well as the batch fit's."""
        return self.loss <= CLOSE * self.batch.loss


@dataclass(frozen=True)
class Survey:
    """All that `optid identify` reports.

    Attributes:
        candidates: one for each order.
        recommended: the order to take.
        words: why, in a sentence.
        orders: table over orders and delays.
        table2: as in the paper.
        input, output: roles of the signals.
        input_unit: of the input.
        estimator: that made the models and the table.
        trend: what stands beside eq. 12.
    """

    candidates: tuple[Candidate, ...]
    recommended: int
    words: str
    orders: OrderTable
    table2: Table2
    input: str
    output: str
    input_unit: str = ""
    estimator: Estimator = Estimator.PEM
    trend: Trend = Trend.NONE

    @property
    def chosen(self) -> Candidate:
        """The recommended candidate."""
        return next(c for c in self.candidates if c.order == self.recommended)


@dataclass(frozen=True)
class Plan:
    """What `survey` shall do.

    Attributes:
        orders: na of the models to identify.
        steps: horizons of the Table 2 rows of `table_order`.
        delay: samples, one for all inputs or one for each; None lets the recording choose among `DELAYS`.
        nb: numbers of B, one for all inputs or one for each; None is na.
        nc: numbers of C; None is na.
        exact: these structures alone, nothing beside them is compared.
        table_order: the order predicted over all horizons; None is 4 if asked for, else the last.
        gains: PID gains to check the models with.
        estimator: who makes the models.
        forgetting: of the recursion.
        trend: what stands beside eq. 12; None is a constant, and a slope where the recording shows one.
        horizons: fit models to each horizon, too.
        unit: of the output.
        input, output: roles of the signals; several inputs are separated by commas.
        input_unit: of the input; of several, separated by commas.
    """

    orders: tuple[int, ...] = (3, 4, 5)
    steps: tuple[int, ...] = (1, 5, 10)
    delay: int | tuple[int, ...] | None = None
    nb: int | tuple[int, ...] | None = None
    nc: int | None = None
    exact: bool = False
    table_order: int | None = None
    gains: Gains | None = None
    estimator: Estimator = Estimator.PEM
    forgetting: Forgetting = field(default_factory=Constant)
    trend: Trend | None = None
    horizons: bool = True
    unit: str = "m"
    input: str = "command"
    output: str = "position"
    input_unit: str = ""

    def __post_init__(self) -> None:
        for name, values in (("orders", self.orders), ("steps", self.steps)):
            if not values or any(int(v) != v or v < 1 for v in values):
                raise InputError(f"{values}", field=name, expected="whole numbers of at least 1")
        if self.table_order is not None and self.table_order not in self.orders:
            raise InputError(f"{self.table_order}", field="table_order", expected=f"one of {self.orders}")

    def structure(self, na: int, nk: int | tuple[int, ...], inputs: int) -> Orders:
        """Eq. 12's numbers for an order."""

        def each(value: int | tuple[int, ...], field: str) -> tuple[int, ...]:
            if isinstance(value, int):
                return (value,) * inputs
            if len(value) != inputs:
                raise InputError(
                    f"{len(value)} numbers", field=field, expected=f"one, or {inputs}: one an input"
                )
            return value

        nb = each(na if self.nb is None else self.nb, "nb")
        return Orders(na, nb, na if self.nc is None else self.nc, each(nk, "delay"))


def survey(
    y: ArrayLike, u: ArrayLike, sample_time: float, plan: Plan | None = None, tell: Tell | None = None
) -> Survey:
    """Identify a recording for several orders, compare, audit, and tabulate as the paper does.

    Args:
        y: output, shape (N,); u: input, shape (N,) or (N, inputs); NaN where missing.
        sample_time: seconds.
        plan: what to do.
        tell: is told the share done and what comes next.

    Raises:
        NotIdentifiable: the recording is too short for the orders.
    """
    plan, tell = plan or Plan(), tell or (lambda share, words: None)
    record = signals(y, u)
    inputs = record.u.shape[1]
    tell(0.0, "trend and delay")
    middle = plan.structure(sorted(plan.orders)[len(plan.orders) // 2], 1, inputs)
    trend = plan.trend if plan.trend is not None else find_trend(record.excerpts(SEARCHED), middle)
    wanted = _structures(plan, record, middle.na, trend)
    table = compare_orders(
        record.y,
        record.u,
        wanted,
        sample_time,
        trend=trend,
        tell=lambda share: tell(0.05 + 0.35 * share, "orders"),
    )
    nk = table.recommended.nk if plan.delay is None else plan.delay
    candidates = []
    whose = _whose(record, plan)
    for done, na in enumerate(plan.orders):
        tell(0.4 + 0.5 * done / len(plan.orders), f"order {na}")
        candidates.append(
            _candidate(record, plan.structure(na, nk, inputs), sample_time, (plan, trend, table), whose)
        )
    recommended, words = _recommended(plan.orders, table)
    tell(0.9, "Table 2")
    return Survey(
        tuple(candidates),
        recommended,
        words,
        table,
        _table(record, plan, candidates, trend),
        plan.input,
        plan.output,
        plan.input_unit,
        plan.estimator,
        trend,
    )


def _structures(plan: Plan, record: Signals, middle: int, trend: Trend) -> list[Orders]:
    """What is compared: the structures asked for, and smaller and later ones beside them."""
    inputs = record.u.shape[1]
    if plan.delay is not None:
        delays: tuple[int | tuple[int, ...], ...] = (plan.delay,)
    else:
        room = [nk for nk in DELAYS if nk < record.y.size // 20] or [1]
        first = choose_delay(record, [plan.structure(middle, nk, inputs) for nk in room], trend)
        delays = (first,) if plan.exact else (first, tuple(nk + 1 for nk in first))
    numbers = sorted(set(plan.orders) if plan.exact else {*plan.orders, *range(1, max(plan.orders) + 1)})
    return [plan.structure(na, nk, inputs) for na in numbers for nk in delays]


def _candidate(
    record: Signals,
    orders: Orders,
    sample_time: float,
    about: tuple[Plan, Trend, OrderTable],
    whose: list[Finding],
) -> Candidate:
    """Identify one order recursively and offline, take whom the plan asks for, and audit what is taken."""
    plan, trend, table = about
    alike = next((row.fit.model for row in table.rows if row.orders == orders), None)
    head = record.part(0, cut_of(record.y.size))
    batch = fit_batch(
        [record],
        orders,
        sample_time,
        start=None if alike is None else alike.theta,
        trend=trend,
        alone=alike is not None and record.y.size > SEARCHED,
    )
    taught = _teach(record, orders, sample_time, plan, trend)
    e: Array = innovations(taught.model, record.y, record.u)
    with np.errstate(over="ignore"):
        loss = float(np.nanmean(e**2))
    if plan.estimator is Estimator.PEM:
        held_out = alike or fit_batch([head], orders, sample_time, trend=trend).model
        model, left_open = batch.model, batch.open
    else:
        held_out = _teach(head, orders, sample_time, plan, trend).model
        model, left_open = _with_covariance(taught.model, record, trend, plan)
    if any(finding.name == "feedback" for finding in whose):
        model = _undetermined(model)
    looked = _audited(model, record, plan, trend)
    more = [
        *open_findings(left_open, _full_names(orders, trend), _inputs(plan, orders)),
        *_excited(record, plan, orders),
    ]
    if (told := trend_finding(model, plan.unit)) is not None:
        more.append(told)
    if loss > CLOSE * batch.loss:
        more.append(_unsettled(loss / batch.loss, plan.estimator is not Estimator.PEM))
    said = sorted([*whose, *more, *looked.findings], key=lambda finding: not finding.grave)
    return Candidate(
        orders.na, taught, batch, loss, model, held_out, replace(looked, findings=tuple(said)), left_open
    )


def _audited(model: Armax, record: Signals, plan: Plan, trend: Trend) -> Audit:
    """The audit of the first input's path, with what else the others' say behind its findings."""
    some = record.part(0, TESTED)
    looked = audit(model, some.y, some.u, gains=plan.gains, fitted=True)
    more = [
        replace(finding, text=f"Input {i + 1}: {finding.text}")
        for i in range(1, model.orders.inputs)
        for finding in audit(model, gains=plan.gains, input=i).findings
        if finding.name not in SHARED
    ]
    return replace(looked, findings=(*looked.findings, *more))


def _with_covariance(
    model: Armax, record: Signals, trend: Trend, plan: Plan
) -> tuple[Armax, tuple[OpenDirection, ...]]:
    """A recursion's model with the covariance that its data give it there: P holds what the start assumed, too.

    Where samples fade, P stands: it knows how many of them count.
    """
    spread, left_open = informed(record, model, trend)
    if isinstance(plan.forgetting, Constant) and plan.forgetting.factor == 1.0:
        own: Array = spread
    else:
        own = np.array(model.covariance)
        own = np.where(np.isfinite(spread), own, spread)
    trended = (model.constant, model.slope)
    same = from_theta(
        model.theta, model.orders, model.sample_time, model.noise_variance, own, trended, model.trend_errors
    )
    return same, left_open


def _undetermined(model: Armax) -> Armax:
    """The same with nothing known of any coefficient."""
    n = model.theta.size
    nothing = np.where(np.eye(n) > 0, np.inf, np.nan)
    return replace(model, covariance=tuple(tuple(float(x) for x in row) for row in nothing))


def _teach(record: Signals, orders: Orders, sample_time: float, plan: Plan, trend: Trend) -> Identification:
    """Run the recursion from a regression over the first part of the recording, if that can be done."""
    length = min(max(record.y.size // HEAD, 10 * orders.parameters + orders.reach), FEW)
    frame = Frame.of([record], orders, sample_time, trend)
    try:
        inner = hannan_rissanen([frame.augmented(record.part(0, length))], frame.full_orders, 10)
        start = frame.model(inner, 0.0).theta
    except np.linalg.LinAlgError:
        start = np.zeros(orders.parameters)
    method = Method.EXTENDED_LEAST_SQUARES if plan.estimator is Estimator.RLS else Method.MAXIMUM_LIKELIHOOD
    settings = replace(LATER, method=method, forgetting=plan.forgetting)
    return identify(record.y, record.u, orders, sample_time, settings, start=start, trend=trend)


def _table(record: Signals, plan: Plan, candidates: Sequence[Candidate], trend: Trend) -> Table2:
    """Table 2 by one estimator; models for each horizon and the last value stand beside it."""
    many = plan.table_order or (4 if 4 in plan.orders else plan.orders[-1])
    by_order = {c.order: c for c in candidates}
    pairs = dict.fromkeys([(n, 1) for n in plan.orders] + [(many, k) for k in plan.steps])
    entries = [Entry(n, k, by_order[n].model, by_order[n].held_out) for n, k in pairs]
    cut = cut_of(record.y.size)
    if plan.horizons:
        head = record.part(0, cut)
        for k in plan.steps:
            if k > 1:
                both = [
                    fit_for_horizon([part], start, k, trend)
                    for part, start in ((record, by_order[many].model), (head, by_order[many].held_out))
                ]
                entries.append(Entry(many, k, both[0], both[1], f"armax, {k} steps"))
    for k in dict.fromkeys((1, *plan.steps)):
        guess = last_value(record.y, k)
        entries.append(Entry(0, k, predictor="last value", guesses=(guess, guess)))
    return table2(record.y, record.u, entries, plan.unit, cut)


def _inputs(plan: Plan, orders: Orders) -> list[str]:
    roles = [role.strip().replace("_", " ") for role in plan.input.split(",")]
    return roles if len(roles) == orders.inputs else [f"input {i + 1}" for i in range(orders.inputs)]


def _full_names(orders: Orders, trend: Trend) -> list[str]:
    every, at = names(orders), orders.parameters - orders.nc
    return [*every[:at], *["constant", "slope"][: trend.value], *every[at:]]


def _whose(record: Signals, plan: Plan) -> list[Finding]:
    """Inputs that earlier outputs determine."""
    listed = [role.strip().replace("_", " ") for role in plan.input.split(",")]
    found = follows_output(record)
    return [feedback_finding(f"the {listed[i]}" if i < len(listed) else f"input {i + 1}") for i in found]


def _excited(record: Signals, plan: Plan, orders: Orders) -> list[Finding]:
    """Inputs that excite less than A and B have numbers."""
    said = []
    for i, (role, column) in enumerate(zip(_inputs(plan, orders), record.u.T, strict=True)):
        needed = orders.na + orders.nb[i]
        order = excitation(column, max(EXCITED, needed + 2))
        if 0 < order < needed:
            said.append(excitation_finding(f"the {role}", order, needed))
    return said


def _unsettled(ratio: float, taken: bool) -> Finding:
    where = "it stands here all the same, as asked" if taken else "the models here are the offline fit's"
    return Finding(
        "recursion_not_settled",
        taken,
        f"After one pass the recursion's mean squared error is {ratio:.3g} times the offline fit's: {where}.",
    )


def _recommended(asked: Sequence[int], table: OrderTable) -> tuple[int, str]:
    """The recommended order among those asked for, in words that name another one where that is better."""
    best = table.recommended.na
    if best in asked:
        return best, table.words
    larger = [n for n in sorted(asked) if n >= best]
    chosen = larger[0] if larger else max(asked)
    return (
        chosen,
        f"Of the orders asked for, {chosen} is nearest to what the recording supports. {table.words}",
    )


def going_on(found: Survey, record: Signals) -> tuple[Identifier, bool]:
    """An identifier in the signals' own units that goes on where the recording ends from the chosen model.

    Returns:
        it, and whether its last input is a constant of 1 that the caller has to give it.
    """
    model = found.chosen.model
    constant = bool(model.constant or model.slope)
    orders, u, theta = model.orders, record.u, model.theta
    if constant:  # the slope's end: a ramp that never stops is no model of what comes
        at = orders.parameters - orders.nc
        level = model.constant + model.slope * model.sample_time * record.y.size
        orders = Orders(orders.na, (*orders.nb, 1), orders.nc, (*orders.nk, 0))
        u = np.column_stack([u, np.ones(record.y.size)])
        theta = np.concatenate([theta[:at], [level], theta[at:]])
    settings = replace(LATER, noise=max(float(np.sqrt(model.noise_variance)) / record.scales[0], 1e-9))
    whole = Signals(record.y, np.ascontiguousarray(u))
    identifier = Identifier(orders, model.sample_time, settings, whole.scales)
    identifier.start_at(theta)
    identifier.run(whole.y[-LAST:], whole.u[-LAST:])
    identifier.start_at(theta)
    return identifier, constant
