"""Do the residuals hold anything the model should have explained? Two score tests with a stated error rate.

A right model's residuals depend neither on their own past nor on inputs that went before. Both are tested the
same way: regress e(t) on psi(t), the gradient of the fit, together with the suspects w(t) (lagged residuals,
lagged inputs). Under the null N R^2 is chi-squared with as many degrees of freedom as w adds to psi (score
test: Breusch and Godfrey 1978; Söderström and Stoica, System Identification, 1989, sec. 11.2). Taking psi
along makes the rate right although the parameters were fitted to the same data; plain correlations miss that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from optid.armax.model import Armax
from optid.armax.regression import column_sizes, lagged, triangle
from optid.armax.signals import signals, usable
from optid.core.model import Array

LEAST_SHARE = 0.05  # of a suspect's size must be new to psi for it to count as a degree of freedom


@dataclass(frozen=True)
class ResidualTest:
    """One test.

    Attributes:
        name: what was tested.
        statistic, freedom, p_value: of the score test.
        level: probability at which a right model fails this test.
        largest: largest correlation coefficient of e with a suspect, its size as opposed to its significance.
        lag: where it stands, samples.
    """

    name: str
    statistic: float
    freedom: int
    p_value: float
    level: float
    largest: float
    lag: int

    @property
    def passed(self) -> bool:
        """True where nothing was found."""
        return self.p_value >= self.level


@dataclass(frozen=True)
class ResidualTests:
    """Whiteness, and independence of each input; a right model fails any of them at `error_rate`."""

    whiteness: ResidualTest
    independence: tuple[ResidualTest, ...]
    error_rate: float
    samples: int

    @property
    def white(self) -> bool:
        """The residuals do not depend on their own past."""
        return self.whiteness.passed

    @property
    def independent(self) -> bool:
        """The residuals do not depend on earlier inputs."""
        return all(test.passed for test in self.independence)


def residual_tests(
    model: Armax,
    y: ArrayLike,
    u: ArrayLike | None,
    *,
    lags: int = 20,
    error_rate: float = 0.01,
    fitted: bool = True,
) -> ResidualTests:
    """Test a model's residuals over a recording.

    Args:
        model: to test.
        y, u: the recording.
        lags: how many of the past, and of each input.
        error_rate: at which a right model fails any of the tests (shared equally among them).
        fitted: the model was fitted to this recording; False for a recording it has not seen.
    """
    record = signals(y, u)
    keep = usable(record, model.orders)
    e, Psi = _gradient(model, record.y, record.u)
    keep &= np.isfinite(e)
    e = np.where(keep, e, np.nan)
    level = error_rate / (1 + record.u.shape[1])
    suspects = [(f"past residuals, 1 to {lags} samples back", [lagged(e, k) for k in range(1, lags + 1)], 1)]
    for i, nk in enumerate(model.nk):
        # A lag of 0 is a suspect only where the model lets the input act at once: a controller acts so too.
        first = min(nk, 1)
        which = "the input" if len(model.nk) == 1 else f"input {i + 1}"
        name = f"{which}, {first} to {first + lags - 1} samples back"
        suspects.append((name, [lagged(record.u[:, i], k) for k in range(first, first + lags)], first))
    tests = [
        _score(name, e, Psi if fitted else None, np.column_stack(w), level, first)
        for name, w, first in suspects
    ]
    return ResidualTests(tests[0], tuple(tests[1:]), error_rate, int(keep.sum()))


def _gradient(model: Armax, y: Array, u: Array) -> tuple[Array, Array]:
    from optid.armax.batch import residuals_of

    return residuals_of(model, y, u)


def _score(name: str, e: Array, Psi: Array | None, W: Array, level: float, first: int) -> ResidualTest:
    from scipy.stats import chi2

    rows = np.isfinite(e) & np.isfinite(W).all(axis=1)
    e, W = e[rows], W[rows]
    N = e.size
    size = np.sqrt(np.mean(W**2, axis=0))
    spread = float(np.sqrt(np.mean(e**2)))
    if 3 * W.shape[1] >= N or spread == 0.0 or not np.any(size > 0):
        return ResidualTest(name, 0.0, 0, 1.0, level, 0.0, first)
    W = W[:, size > 0] / size[size > 0]
    correlations = W.T @ e / (N * spread)
    worst = int(np.argmax(np.abs(correlations)))
    lag = first + int(np.flatnonzero(size > 0)[worst])
    known = np.zeros((N, 0)) if Psi is None else Psi[rows] / column_sizes(Psi[rows])
    p, k = known.shape[1], W.shape[1]
    R = triangle(np.column_stack([known, W, e]))
    # Orthonormal directions in which the suspects say something that psi does not.
    left, singular, _ = np.linalg.svd(R[p : p + k, p : p + k])
    new = left[:, singular > LEAST_SHARE * np.sqrt(N)]
    freedom = new.shape[1]
    explained = float(np.sum((new.T @ R[p : p + k, -1]) ** 2))
    statistic = N * explained / float(np.sum(R[p:, -1] ** 2)) if freedom else 0.0
    p_value = float(chi2.sf(statistic, freedom)) if freedom else 1.0
    return ResidualTest(name, statistic, freedom, p_value, level, float(correlations[worst]), lag)
