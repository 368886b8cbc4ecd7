"""One candidate order: identified recursively and offline, audited, with its undetermined combinations."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from optid.armax.audit import Audit, audit
from optid.armax.batch import SEARCHED, BatchFit, fit_batch, informed
from optid.armax.forgetting import Constant
from optid.armax.identifiability import EXCITED, OpenDirection, excitation, follows_output, loop_share
from optid.armax.identifier import Method, Settings
from optid.armax.model import Armax, from_theta
from optid.armax.offline import Identification, identify, names
from optid.armax.order_selection import OrderTable, cut_of
from optid.armax.plan import Estimator, Plan
from optid.armax.prediction import innovations
from optid.armax.profile import Intervals, profile_intervals, wald_intervals
from optid.armax.regression import hannan_rissanen
from optid.armax.signals import Signals
from optid.armax.structure import Orders
from optid.armax.trend import Frame, Trend
from optid.armax.words import (
    Finding,
    excitation_finding,
    feedback_finding,
    open_findings,
    trend_finding,
    weak_feedback_finding,
)
from optid.core.model import Array

HEAD = 4  # divisor: the recursion starts from a regression over this share of first samples
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
PROFILED = 40_000  # samples up to which intervals are profiled; beyond, the delta method is used
TESTED = 60_000  # samples on which residuals are tested


@dataclass(frozen=True)
class Candidate:
    """One order by the requested estimator, with the recursion and the offline fit of the same structure.

    Attributes:
        order: na.
        recursive: result of the recursion.
        batch: the reference.
        loss: mean squared one-step error of the recursion's last model over the recording.
        model: of the requested estimator.
        held_out: of the same estimator, fitted to the part before the one held out.
        audit: of `model`, its first input; findings on the other inputs follow.
        open: combinations that the data do not determine.
        intervals: of the model's poles and static gains.
    """

    order: int
    recursive: Identification
    batch: BatchFit
    loss: float
    model: Armax
    held_out: Armax
    audit: Audit
    open: tuple[OpenDirection, ...]
    intervals: Intervals

    @property
    def settled(self) -> bool:
        """Whether the recursion's model predicts about as well as the offline fit's."""
        return self.loss <= CLOSE * self.batch.loss


def identify_candidate(
    record: Signals,
    orders: Orders,
    sample_time: float,
    about: tuple[Plan, Trend, OrderTable],
    whose: list[Finding],
) -> Candidate:
    """Identify one order recursively and offline, select the plan's estimator, and audit its model."""
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
    e: Array = innovations(taught.model, record.y, record.u, estimated_start=True)
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
    likely = plan.estimator is Estimator.PEM and record.y.size <= PROFILED
    intervals = profile_intervals([record], model, trend) if likely else wald_intervals(model)
    looked = _audited(model, record, plan, intervals)
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
        orders.na,
        taught,
        batch,
        loss,
        model,
        held_out,
        replace(looked, findings=tuple(said)),
        left_open,
        intervals,
    )


def _audited(model: Armax, record: Signals, plan: Plan, intervals: Intervals) -> Audit:
    """The audit of the first input's path, followed by further findings on the others."""
    some = record.part(0, TESTED)
    looked = audit(model, some.y, some.u, gains=plan.gains, intervals=intervals)
    more = [
        replace(finding, text=f"Input {i + 1}: {finding.text}")
        for i in range(1, model.orders.inputs)
        for finding in audit(model, gains=plan.gains, input=i, intervals=intervals).findings
        if finding.name not in SHARED
    ]
    return replace(looked, findings=(*looked.findings, *more))


def _with_covariance(
    model: Armax, record: Signals, trend: Trend, plan: Plan
) -> tuple[Armax, tuple[OpenDirection, ...]]:
    """A recursion's model with the covariance from its data: P also contains the assumed start.

    With forgetting, P is used: it has the effective number of samples.
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
    """The same with infinite covariance."""
    n = model.theta.size
    nothing = np.where(np.eye(n) > 0, np.inf, np.nan)
    return replace(model, covariance=tuple(tuple(float(x) for x in row) for row in nothing))


def _teach(record: Signals, orders: Orders, sample_time: float, plan: Plan, trend: Trend) -> Identification:
    """Run the recursion from a regression over the first part of the recording, if possible."""
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


def _inputs(plan: Plan, orders: Orders) -> list[str]:
    roles = [role.strip().replace("_", " ") for role in plan.input.split(",")]
    return roles if len(roles) == orders.inputs else [f"input {i + 1}" for i in range(orders.inputs)]


def _full_names(orders: Orders, trend: Trend) -> list[str]:
    every, at = names(orders), orders.parameters - orders.nc
    return [*every[:at], *["constant", "slope"][: trend.value], *every[at:]]


def feedback_findings(record: Signals, plan: Plan) -> list[Finding]:
    """Findings on inputs that earlier outputs determine, completely or nearly."""
    listed = [role.strip().replace("_", " ") for role in plan.input.split(",")]

    def name(i: int) -> str:
        return f"the {listed[i]}" if i < len(listed) else f"input {i + 1}"

    found = follows_output(record)
    nearly = [(i, share) for i, share in loop_share(record) if i not in found]
    return [
        *(feedback_finding(name(i)) for i in found),
        *(weak_feedback_finding(name(i), share) for i, share in nearly),
    ]


def _excited(record: Signals, plan: Plan, orders: Orders) -> list[Finding]:
    """Findings on inputs with an order of excitation below the number of coefficients of A and B."""
    said = []
    for i, (role, column) in enumerate(zip(_inputs(plan, orders), record.u.T, strict=True)):
        needed = orders.na + orders.nb[i]
        order = excitation(column, max(EXCITED, needed + 2))
        if 0 < order < needed:
            said.append(excitation_finding(f"the {role}", order, needed))
    return said


def _unsettled(ratio: float, taken: bool) -> Finding:
    where = (
        "the table shows it all the same, as requested" if taken else "the models here are the offline fit's"
    )
    return Finding(
        "recursion_not_settled",
        taken,
        f"After one pass the recursion's mean squared error is {ratio:.3g} times the offline fit's: {where}.",
    )
