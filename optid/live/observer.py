"""An observer with the physical model: it gives the start states of windowed predictions and the sensors' noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from optid.core.jit import compiled
from optid.core.jit_cache import kept
from optid.core.kernel import advance, at, call
from optid.core.kernel import compiled as compiled_loop
from optid.core.model import Array, Model
from optid.live.twin import Twin

# Process noise per 0.5 s as a share of each state's size, at least: what the batch fit starts from as well.
PROCESS_NOISE, WINDOW = 3e-3, 0.5
FORGET = 0.999  # of the running estimate of the sensors' noise
OUTLIER = 5.0  # sd of an innovation: larger ones are clipped to it
# Rate at which the process noise follows innovations larger than expected, and its limit.
HEED, MOST = 0.02, 1e8

Kernel = TypeVar("Kernel", bound=Callable[..., object])
quick: Callable[[Kernel], Kernel] = kept()


class Observer(Twin):
    """A twin corrected by every measurement: an extended Kalman filter with the compiled slopes.

    Missing physics causes innovations larger than expected: the process noise follows them, up and down, so that the
    state follows the rig; a single outlier hardly affects it.

    Args:
        model, parameters, start: as for a twin.
        noise: sd of each output, SI, shape (outputs,); NaN where it is estimated online, from third differences, which
            motion hardly affects.
    """

    def __init__(self, model: Model, parameters: Array, noise: Array, start: Array | None = None) -> None:
        nx, ny, wide = len(model.states), len(model.outputs), compiled(model).width
        self._S, self._T = np.zeros((nx, wide)), np.empty((nx, wide))
        self._H, self._eye = np.empty((ny, wide)), np.eye(nx, wide)
        self._q = (PROCESS_NOISE * model.scales) ** 2 / WINDOW
        self._R, self._known = np.where(np.isnan(noise), 0.0, noise**2), ~np.isnan(noise)
        self._recent, self._weight = np.full((4, ny), np.nan), np.zeros(ny)
        self._P, self._swell = np.zeros((nx, nx)), np.ones(1)
        super().__init__(model, parameters, start)
        self.correct(np.full(ny, np.nan))
        self._recent[:] = np.nan

    def _begin(self) -> None:
        super()._begin()
        self._P[:] = np.diag(self._spread**2)

    def advance(self, command: float, span: float) -> bool:
        """As for a twin, also propagating the covariance."""
        self._input(command, span)
        h = _follow(
            self._code,
            self.x,
            self._S,
            self._u,
            self._c,
            self._k,
            self._T,
            self._tolerance,
            span,
            min(self._h, span),
            self._P,
            self._q,
            self._swell,
        )
        if not self._sane(h, span):
            self._P[:] = np.diag(self._spread**2)
            return False
        return True

    def correct(self, measured: Array) -> None:
        """Take one sample of the outputs, SI, shape (outputs,); NaN is missing."""
        _heed(
            self._code,
            self.x,
            self._u,
            self._c,
            self._y,
            self._H,
            self._eye,
            self._P,
            self._R,
            self._swell,
            self._recent,
            self._weight,
            self._known,
            measured,
        )

    @property
    def noise(self) -> Array:
        """Sd of each output as used by the filter, shape (outputs,)."""
        return np.sqrt(self._R)


@quick
def _carry(P: Array, S: Array, q: Array) -> None:
    """P <- S P S' + diag(q), kept symmetric; S is padded."""
    n = len(q)
    square = np.ascontiguousarray(S[:, :n])
    new = square @ P @ square.T
    for i in range(n):
        for j in range(i + 1):
            P[i, j] = P[j, i] = 0.5 * (new[i, j] + new[j, i])
        P[i, i] += q[i]


@quick
def _correct(x: Array, P: Array, H: Array, R: Array, swell: Array, measured: Array, predicted: Array) -> None:
    """Correct by one output after the other, which needs no inverse; `swell` multiplies the process noise."""
    n, start = len(x), x.copy()
    gain = np.empty(n)
    surprise, seen = 0.0, 0
    for o in range(len(measured)):
        error = measured[o] - predicted[o]
        if error != error or R[o] == 0.0:
            continue
        for i in range(
            n
        ):  # linearised at the start of the sample, moved by the corrections of earlier outputs
            error -= H[o, i] * (x[i] - start[i])
        variance = R[o]
        for i in range(n):
            gain[i] = 0.0
            for j in range(n):
                gain[i] += P[i, j] * H[o, j]
        for i in range(n):
            variance += H[o, i] * gain[i]
        bound = OUTLIER * math.sqrt(variance)
        error = min(max(error, -bound), bound)
        surprise += error * error / variance - 1.0
        seen += 1
        for i in range(n):
            x[i] += gain[i] * error / variance
        for i in range(n):
            for j in range(n):
                P[i, j] -= gain[i] * gain[j] / variance
    if seen:
        swell[0] = min(max(swell[0] * math.exp(HEED * surprise / seen), 1.0), MOST)


@quick
def _noise(recent: Array, R: Array, weight: Array, known: Any, measured: Array) -> None:
    """Variance of white noise from third differences: their mean square is 20 times as large."""
    for o in range(len(measured)):
        for back in range(3):
            recent[3 - back, o] = recent[2 - back, o]
        recent[0, o] = measured[o]
        if known[o]:
            continue
        third = recent[0, o] - 3.0 * recent[1, o] + 3.0 * recent[2, o] - recent[3, o]
        if third == third:
            weight[o] = FORGET * weight[o] + 1.0
            R[o] += (third * third / 20.0 - R[o]) / weight[o]


@compiled_loop
def _follow(code, x, S, u, c, k, T, tolerance, span, h, P, q, swell):  # type: ignore[no-untyped-def]
    """One hold of the state and its covariance; the next step size, negative on failure."""
    S[:] = 0.0
    for i in range(len(x)):
        S[i, i] = 1.0
    h = advance(
        code.slopes,
        code.step_slopes,
        code.half,
        at(x, 0),
        at(S, 0),
        at(u, 0),
        at(c, 0),
        k,
        at(T, 0),
        at(tolerance, 0),
        span,
        h,
    )
    _carry(P, S, q * (span * swell[0]))
    return h


@compiled_loop
def _heed(code, x, u, c, y, H, eye, P, R, swell, recent, weight, known, measured):  # type: ignore[no-untyped-def]
    """One sample: outputs with their slopes, the sensors' noise, the correction, and the outputs after it."""
    call(code.sensor_slopes, (at(x, 0), at(eye, 0), at(u, 0), at(c, 0), at(y, 0), at(H, 0)))
    _noise(recent, R, weight, known, measured)
    _correct(x, P, H, R, swell, measured, y)
    call(code.sensors, (at(x, 0), at(x, 0), at(u, 0), at(c, 0), at(y, 0), at(x, 0)))
