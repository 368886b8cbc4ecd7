"""Which orders and delay: a table with criteria and validation, and one recommendation in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from optid.armax.batch import SEARCHED, BatchFit, fit_batch
from optid.armax.prediction import fit_percent, innovations, predict, simulate
from optid.armax.signals import Signals, signals
from optid.armax.structure import Orders
from optid.armax.trend import Trend
from optid.core.model import Array
from optid.errors import InputError, NotIdentifiable

if TYPE_CHECKING:
    import pandas as pd

BLOCKS = 20  # blocks of the held-out part, for the scatter of a difference in loss
GLANCED = 10_000  # samples on which delays are compared
VALIDATED = 100_000  # samples of the held-out part, at most
LEAD = 2000  # samples before it for the transient of the residuals
SURE = 2.0  # standard errors by which a larger model must predict better to justify its parameters


@dataclass(frozen=True)
class Row:
    """One candidate, fitted to the first part of the recording and validated on the rest.

    Attributes:
        orders, fit: the fitted orders and the fit.
        aic, bic, fpe: N ln V + 2 p, N ln V + p ln N, V (1 + p/N)/(1 - p/N) with V the mean squared residual
            (Ljung, System Identification, 2nd ed. 1999, sec. 16.4).
        validated_loss: mean squared one-step error on the held-out part, output unit squared.
        fit_one_step, fit_ten_steps, fit_simulated: percent, on the held-out part.
        block_losses: the validated loss block by block.
    """

    orders: Orders
    fit: BatchFit
    aic: float
    bic: float
    fpe: float
    validated_loss: float
    fit_one_step: float
    fit_ten_steps: float
    fit_simulated: float
    block_losses: tuple[float, ...]


@dataclass(frozen=True)
class OrderTable:
    """All candidates and the recommended one.

    Attributes:
        rows: in the requested order.
        recommended: the one with the fewest parameters that no other beats significantly.
        words: the recommendation and its reason.
        refused: candidates that could not be fitted, and why.
    """

    rows: tuple[Row, ...]
    recommended: Orders
    words: str
    refused: tuple[tuple[Orders, str], ...]

    def frame(self) -> pd.DataFrame:
        """The table, one row per candidate."""
        import pandas as pd

        return pd.DataFrame(
            [
                {
                    "na": row.orders.na,
                    "nb": ",".join(map(str, row.orders.nb)),
                    "nc": row.orders.nc,
                    "nk": ",".join(map(str, row.orders.nk)),
                    "parameters": row.orders.parameters,
                    "loss": row.fit.loss,
                    "aic": row.aic,
                    "bic": row.bic,
                    "fpe": row.fpe,
                    "validated_loss": row.validated_loss,
                    "fit_one_step": row.fit_one_step,
                    "fit_ten_steps": row.fit_ten_steps,
                    "fit_simulated": row.fit_simulated,
                    "recommended": row.orders == self.recommended,
                }
                for row in self.rows
            ]
        )


def compare_orders(
    y: ArrayLike,
    u: ArrayLike | None,
    candidates: Iterable[Orders],
    sample_time: float = 1.0,
    held_out: float = 0.3,
    trend: Trend = Trend.NONE,
    tell: Callable[[float], None] = lambda share: None,
) -> OrderTable:
    """Fit each candidate by batch prediction errors and validate it on the last part of the recording.

    Args:
        y, u: the recording.
        candidates: orders and delays to compare.
        sample_time: seconds.
        held_out: share of the recording for validation.
        trend: what stands beside eq. 12.
        tell: called with the share done.

    Raises:
        NotIdentifiable: no candidate could be fitted.
    """
    if not 0.05 <= held_out <= 0.9:
        raise InputError(f"{held_out}", field="held_out", expected="a share from 0.05 to 0.9")
    record = signals(y, u)
    cut = cut_of(record.y.size, held_out)
    rows, refused, listed = [], [], list(candidates)
    searched = record.part(0, cut).excerpts(SEARCHED)
    for done, orders in enumerate(listed):
        tell(done / len(listed))
        try:
            fit = fit_batch(searched, orders, sample_time, trend=trend)
        except NotIdentifiable as error:
            refused.append((orders, str(error)))
        else:
            rows.append(_row(orders, fit, record, cut))
    if not rows:
        raise NotIdentifiable("; ".join(why for _, why in refused) or "no candidates")
    recommended, words = recommend(rows)
    return OrderTable(tuple(rows), recommended, words, tuple(refused))


def cut_of(samples: int, held_out: float = 0.3) -> int:
    """First sample of the part held out."""
    return round(samples * (1.0 - held_out))


def choose_delay(record: Signals, candidates: Iterable[Orders], trend: Trend) -> tuple[int, ...]:
    """The delays of the candidate with the smallest loss; among those without a significant difference, the first.

    Args:
        record: recording; excerpts of a long one are used.
        candidates: with equal numbers of coefficients, shortest delay first.
        trend: what stands beside eq. 12.
    """
    parts, losses, listed = record.excerpts(GLANCED), {}, list(candidates)
    for orders in listed:
        try:
            losses[orders] = fit_batch(parts, orders, trend=trend, quick=True).loss
        except NotIdentifiable:
            continue
    samples = sum(part.y.size for part in parts)
    chance = 1.0 + 2.0 * float(np.log(samples)) / samples
    least = min(losses.values(), default=0.0)
    return next((orders.nk for orders, loss in losses.items() if loss <= least * chance), listed[0].nk)


def _row(orders: Orders, fit: BatchFit, record: Signals, cut: int) -> Row:
    N, p, V = fit.samples, orders.parameters, max(fit.loss, 1e-300)
    # The residuals continue from the training part: no transient is validated.
    rest = record.part(cut, cut + VALIDATED)
    lead = min(cut, LEAD + orders.reach)
    run = record.part(cut - lead, cut + VALIDATED)
    e = innovations(fit.model, run.y, run.u, run.first)[lead:]
    ten = predict(fit.model, run.y, run.u, 10, run.first)[lead:]
    start = np.nan_to_num(rest.y[: max(1, orders.reach)])
    with np.errstate(all="ignore"):
        free = simulate(fit.model, rest.u, start, rest.y.size, rest.first)
        simulated = fit_percent(rest.y, free) if np.all(np.abs(free) < 1e150) else -np.inf
    blocks = [float(np.nanmean(b**2)) for b in np.array_split(e, BLOCKS) if np.isfinite(b).any()]
    return Row(
        orders,
        fit,
        aic=N * np.log(V) + 2 * p,
        bic=N * np.log(V) + p * np.log(N),
        fpe=V * (1 + p / N) / (1 - p / N),
        validated_loss=float(np.nanmean(e**2)),
        fit_one_step=fit_percent(rest.y, rest.y - e),
        fit_ten_steps=fit_percent(rest.y, ten),
        fit_simulated=simulated,
        block_losses=tuple(blocks),
    )


def recommend(rows: list[Row]) -> tuple[Orders, str]:
    """The smallest candidate that the best one does not beat significantly, and the reason in words."""
    best = min(rows, key=lambda row: row.validated_loss)
    alike = [row for row in rows if row is best or not _beats(best, row)]
    chosen = min(alike, key=lambda row: (row.orders.parameters, row.validated_loss))
    by_bic = min(rows, key=lambda row: row.bic)
    words = f"Take {_spoken(chosen.orders)}"
    if chosen is best:
        words += ": it predicts the held-out part best"
        if len(alike) > 1:
            words += ", and no smaller order does as well"
    else:
        gain = 100 * (1 - best.validated_loss / chosen.validated_loss)
        words += (
            f": the order that predicts the held-out part best ({_spoken(best.orders)}) gains {gain:.2g} % in mean "
            "square, "
            "which is within chance, and needs "
            f"{best.orders.parameters - chosen.orders.parameters} more parameters"
        )
    if by_bic is chosen:
        words += "; BIC agrees."
    else:
        words += f"; BIC would choose {_spoken(by_bic.orders)}."
    return chosen.orders, words


def _spoken(orders: Orders) -> str:
    """Orders in words, if they are all equal."""
    if {orders.na, *orders.nb, orders.nc} != {orders.na} or len(set(orders.nk)) != 1:
        return str(orders)
    plural = "s" if orders.nk[0] != 1 else ""
    return f"order {orders.na} with a delay of {orders.nk[0]} sample{plural}"


def _beats(better: Row, other: Row) -> bool:
    """Whether the mean difference of block losses is significant."""
    pairs = zip(better.block_losses, other.block_losses, strict=False)
    difference: Array = np.array([b - a for a, b in pairs])
    if difference.size < 3:
        return bool(better.validated_loss < other.validated_loss)
    error = float(np.std(difference, ddof=1)) / np.sqrt(difference.size)
    return bool(np.mean(difference) > SURE * error)


def grid(orders: Iterable[int], delays: Iterable[int], inputs: int = 1) -> list[Orders]:
    """Candidates with na = nb = nc for each order and each delay."""
    return [Orders(n, (n,) * inputs, n, (nk,) * inputs) for n in orders for nk in delays]
