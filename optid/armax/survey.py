"""The whole job of `optid identify` as one function with one frozen result."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from optid.armax.batch import SEARCHED
from optid.armax.candidate import LATER, Candidate, feedback_findings, identify_candidate
from optid.armax.identifier import Identifier
from optid.armax.multistep import fit_for_horizon
from optid.armax.order_selection import OrderTable, choose_delay, compare_orders, cut_of
from optid.armax.plan import DELAYS, Estimator, Plan
from optid.armax.signals import Signals, signals
from optid.armax.structure import Orders
from optid.armax.table2 import Entry, Table2, last_value, table2
from optid.armax.trend import Trend, find_trend

LAST = 20_000  # samples after which a continuing identifier has estimated its uncertainty

Tell = Callable[[float, str], None]


@dataclass(frozen=True)
class Survey:
    """The results that `optid identify` reports.

    Attributes:
        candidates: one for each order.
        recommended: the recommended order.
        words: the reason, as a sentence.
        orders: table over orders and delays.
        table2: as in the paper.
        input, output: roles of the signals.
        input_unit: of the input.
        estimator: that made the models and the table.
        trend: terms added to eq. 12.
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


def survey(
    y: ArrayLike, u: ArrayLike, sample_time: float, plan: Plan | None = None, tell: Tell | None = None
) -> Survey:
    """Identify a recording for several orders, compare, audit, and tabulate as the paper does.

    Args:
        y: output, shape (N,); u: input, shape (N,) or (N, inputs); NaN where missing.
        sample_time: seconds.
        plan: of the survey.
        tell: called with the share done and the next step.

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
    whose = feedback_findings(record, plan)
    for done, na in enumerate(plan.orders):
        tell(0.4 + 0.5 * done / len(plan.orders), f"order {na}")
        candidates.append(
            identify_candidate(
                record, plan.structure(na, nk, inputs), sample_time, (plan, trend, table), whose
            )
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
    """The structures to compare: the requested ones, smaller ones, and longer delays."""
    inputs = record.u.shape[1]
    if plan.delay is not None:
        delays: tuple[int | tuple[int, ...], ...] = (plan.delay,)
    else:
        room = [nk for nk in DELAYS if nk < record.y.size // 20] or [1]
        first = choose_delay(record, [plan.structure(middle, nk, inputs) for nk in room], trend)
        delays = (first,) if plan.exact else (first, tuple(nk + 1 for nk in first))
    numbers = sorted(set(plan.orders) if plan.exact else {*plan.orders, *range(1, max(plan.orders) + 1)})
    return [plan.structure(na, nk, inputs) for na in numbers for nk in delays]


def _table(record: Signals, plan: Plan, candidates: Sequence[Candidate], trend: Trend) -> Table2:
    """Table 2 by one estimator; with models for each horizon and the last value for comparison."""
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


def _recommended(asked: Sequence[int], table: OrderTable) -> tuple[int, str]:
    """The recommended order among the requested ones, and a sentence that names a better one if there is any."""
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
    """An identifier in the signals' own units that continues from the chosen model at the recording's end.

    Returns:
        the identifier, and whether its last input is a constant of 1 that the caller must supply.
    """
    model = found.chosen.model
    constant = bool(model.constant or model.slope)
    orders, u, theta = model.orders, record.u, model.theta
    if constant:  # the slope ends here: an endless ramp is not a model of the future
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
