"""The whole job of `optid identify` as one function with one frozen result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from optid.armax.audit import Audit, Finding, audit
from optid.armax.batch import BatchFit, fit_batch
from optid.armax.identifier import Settings
from optid.armax.loop import Gains
from optid.armax.model import Armax
from optid.armax.orders import OrderTable, compare_orders, grid
from optid.armax.prediction import innovations
from optid.armax.regression import hannan_rissanen
from optid.armax.signals import Signals, signals
from optid.armax.structure import Orders
from optid.armax.table2 import Entry, Table2, table2
from optid.armax.whole import Identification, identify
from optid.core.model import Array
from optid.errors import InputError

DELAYS = (1, 2, 3, 5, 8, 12)  # samples, tried where none is given
HEAD = 4  # the recursion begins from a regression over one sample in so many, the first ones
LATER = Settings(start_sd=0.003, start_sd_c=0.03, ease=None, warm=(0.0, 0.0))  # begins near its aim
SHARED = ("stable", "unstable", "integrating", "time_constants")  # what one A says for all inputs
CLOSE = 1.1  # the recursion's loss may exceed the batch fit's by this factor


@dataclass(frozen=True)
class Candidate:
    """One order: identified recursively, beside the batch fit of the same structure.

    Attributes:
        order: na = nb = nc.
        recursive: what the recursion taught.
        batch: the reference.
        loss: mean squared one-step error of the recursion's last model over the recording.
        model: the recursion's last model, or the batch fit's where the recursion has not come close to it.
        audit: of `model`, its first input; findings on the paths of the others follow.
    """

    order: int
    recursive: Identification
    batch: BatchFit
    loss: float
    model: Armax
    audit: Audit

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
    """

    candidates: tuple[Candidate, ...]
    recommended: int
    words: str
    orders: OrderTable
    table2: Table2
    input: str
    output: str
    input_unit: str = ""

    @property
    def chosen(self) -> Candidate:
        """The recommended candidate."""
        return next(c for c in self.candidates if c.order == self.recommended)


@dataclass(frozen=True)
class Plan:
    """What `survey` shall do.

    Attributes:
        orders: to identify.
        steps: horizons of the Table 2 rows of `table_order`.
        delay: samples; None lets the recording choose among `DELAYS`.
        table_order: the order predicted over all horizons; None is 4 if asked for, else the last.
        gains: PID gains to check the models with.
        settings: of the recursion.
        unit: of the output.
        input, output: roles of the signals; several inputs are separated by commas.
        input_unit: of the input; of several, separated by commas.
    """

    orders: tuple[int, ...] = (3, 4, 5)
    steps: tuple[int, ...] = (1, 5, 10)
    delay: int | None = None
    table_order: int | None = None
    gains: Gains | None = None
    settings: Settings | None = None
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


def survey(y: ArrayLike, u: ArrayLike, sample_time: float, plan: Plan | None = None) -> Survey:
    """Identify a recording for several orders, compare, audit, and tabulate as the paper does.

    Args:
        y: output, shape (N,); u: input, shape (N,) or (N, inputs); NaN where missing.
        sample_time: seconds.
        plan: what to do.

    Raises:
        NotIdentifiable: the recording is too short for the orders.
    """
    plan = plan or Plan()
    record = signals(y, u)
    inputs = record.u.shape[1]
    delay = choose_delay(record.y, record.u, sample_time, plan)
    delays = (delay,) if plan.delay is not None else (delay, delay + 1)
    wanted = grid(sorted({*plan.orders, *range(1, max(plan.orders) + 1)}), delays, inputs)
    table = compare_orders(record.y, record.u, wanted, sample_time)
    orders = grid(plan.orders, table.recommended.nk[:1], inputs)
    candidates = [_candidate(record, o, sample_time, plan) for o in orders]
    recommended, words = _recommended(plan.orders, table)
    many = plan.table_order or (4 if 4 in plan.orders else plan.orders[-1])
    models = {c.order: c.model for c in candidates}
    pairs = [(n, 1) for n in plan.orders] + [(many, k) for k in plan.steps]
    entries = [Entry(n, k, models[n]) for n, k in dict.fromkeys(pairs)]
    return Survey(
        tuple(candidates),
        recommended,
        words,
        table,
        table2(record.y, record.u, entries, plan.unit),
        plan.input,
        plan.output,
        plan.input_unit,
    )


def _candidate(record: Signals, orders: Orders, sample_time: float, plan: Plan) -> Candidate:
    """Identify one order both ways, take the recursion's model if it came close, and audit what is taken."""
    taught = _teach(record, orders, sample_time, plan.settings)
    batch = fit_batch([(record.y, record.u)], orders, sample_time, start=taught.model.theta)
    e: Array = innovations(taught.model, record.y, record.u)
    with np.errstate(over="ignore"):
        loss = float(np.nanmean(e**2))
    model = taught.model if loss <= CLOSE * batch.loss else batch.model
    looked = audit(model, record.y, record.u, gains=plan.gains)
    more = [
        replace(finding, text=f"Input {i + 1}: {finding.text}")
        for i in range(1, orders.inputs)
        for finding in audit(model, gains=plan.gains, input=i).findings
        if finding.name not in SHARED
    ]
    if model is not taught.model:
        more.append(_unsettled(loss / batch.loss))
    return Candidate(
        orders.na, taught, batch, loss, model, replace(looked, findings=(*looked.findings, *more))
    )


def _teach(record: Signals, orders: Orders, sample_time: float, settings: Settings | None) -> Identification:
    """Run the recursion from a regression over the first part of the recording, if that can be done."""
    head = record.part(0, max(record.y.size // HEAD, 10 * orders.parameters + orders.reach))
    try:
        start = hannan_rissanen([head], orders, 10)
    except np.linalg.LinAlgError:
        start = np.zeros(orders.parameters)
    return identify(record.y, record.u, orders, sample_time, settings or LATER, start=start)


def choose_delay(y: Array, u: Array, sample_time: float, plan: Plan) -> int:
    """The delay of the plan, or the one whose middle-order model has the lowest BIC."""
    if plan.delay is not None:
        return plan.delay
    middle = sorted(plan.orders)[len(plan.orders) // 2]
    room = [nk for nk in DELAYS if nk < y.size // 20] or [1]
    table = compare_orders(y, u, grid([middle], room, u.shape[1]), sample_time)
    return min(table.rows, key=lambda row: row.bic).orders.nk[0]


def _unsettled(ratio: float) -> Finding:
    return Finding(
        "recursion_not_settled",
        True,
        f"After one pass the recursion's mean squared error is {ratio:.3g} times the batch fit's: "
        "the batch fit stands here.",
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
