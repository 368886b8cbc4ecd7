"""Which of the paper's claims about its models stand, judged on a recording by numbers.

Section 6.1: the fourth order is best, because the plant has four states. Section 6.2: five and ten steps come late
because of the plant's nonlinearity. Section 6.2, figure 14: the predicted model tracks better than the simulated one.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from optid.armax.model import Armax
from optid.armax.order_selection import compare_orders, grid
from optid.armax.prediction import fit_percent, innovations, predict, simulate
from optid.armax.survey import Survey
from optid.armax.table2 import lag_of, last_value
from optid.armax.trend import Trend

Array = NDArray[np.float64]
ORDERS = range(1, 8)


def claims(y: Array, u: Array, sample_time: float, found: Survey, seed: int = 0) -> list[str]:
    """A sentence a claim, with the numbers that decide it."""
    model = next(c.model for c in found.candidates if c.order == 4)
    return [
        four_states(y, u, sample_time, found),
        late_by_nonlinearity(y, u, model, np.random.default_rng(seed)),
        prediction_beats_simulation(y, u, model),
    ]


def four_states(y: Array, u: Array, sample_time: float, found: Survey) -> str:
    """Held-out one-step error by order: is the fourth the best, and more than by chance?"""
    nk = found.orders.recommended.nk[0]
    table = compare_orders(y, u, grid(ORDERS, [nk]), sample_time, trend=Trend.CONSTANT)
    losses = {row.orders.na: row.validated_loss for row in table.rows}
    best = min(losses, key=lambda n: losses[n])
    effective = next(c.audit.effective_order for c in found.candidates if c.order == 4)
    chosen = table.recommended.na
    verdict = "stands" if best == chosen == 4 and effective == 4 else "does not stand"
    listed = ", ".join(f"{n}: {loss / losses[best]:.4f}" for n, loss in losses.items())
    return (
        f'"Order 4 is best because of four states" {verdict}: held-out mean square errors, of the best, are {listed}; '
        f"{chosen} is the smallest order that none beats by more than chance; order 4 is effectively of order "
        f"{effective}."
    )


def late_by_nonlinearity(y: Array, u: Array, model: Armax, rng: np.random.Generator) -> str:
    """Lag at 5 and 10 steps, on the recording and on the linear model's own simulation with its own noise."""
    e = innovations(model, y, u)
    noise = np.nanstd(e) * rng.standard_normal(y.size)
    linear = simulate(model, u, y[: model.orders.reach]) + _filtered(model, noise)
    lags = {}
    for k in (5, 10):
        lags[k] = [lag_of(x, predict(model, x, u, k), k) for x in (y, linear)]
    both = "; ".join(f"{k} steps: {a:.2f} samples recorded, {b:.2f} linear" for k, (a, b) in lags.items())
    stale = lag_of(y, last_value(y, 10), 10)
    more = all(recorded > 2.0 * max(alike, 0.05) for recorded, alike in lags.values())
    verdict = "stands" if more else "does not stand"
    return (
        f'"Five and ten steps come late because of nonlinearity" {verdict}: {both}; '
        f"the last value is late by {stale:.2f} at ten. A linear plant with this noise, in which nothing is "
        "nonlinear, shows what lag the noise alone makes."
    )


def prediction_beats_simulation(y: Array, u: Array, model: Armax) -> str:
    """One-step prediction against the same model's free run, and against the last value."""
    one = fit_percent(y, predict(model, y, u, 1))
    free = fit_percent(y, simulate(model, u, y[: model.orders.reach]))
    still = fit_percent(y, last_value(y, 1))
    gained = "more" if one > still else "less"
    return (
        f'"The predicted model tracks better than the simulated one" stands and says little: '
        f"fits are {one:.3f} % one step ahead and {free:.2f} % in free run, but {still:.3f} % for the value of "
        f"the sample before, which knows no model; the model explains {gained} than that."
    )


def _filtered(model: Armax, noise: Array) -> Array:
    alone = replace(model, b=(), nk=(), covariance=None, constant=0.0, slope=0.0, c=(1.0,))
    from scipy.signal import lfilter

    return np.asarray(lfilter(model.c, alone.a, noise))
