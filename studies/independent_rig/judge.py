"""What PID gains are worth on the independent rig: ITAE of the true position over the step's size, hunting at rest.

Steps of several sizes about mid-stroke, several seeds of the sensor's noise. The controller is written out here:

    u = kp (b r - y) + integral of ki (r - y) + kd d(c r - y)/dt, the derivative through a first-order lag

limited, its integral stopped while it would push further into a limit; 1 kHz. Nothing of optid is imported.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numba import njit

from studies.independent_rig.loop import _clock, _work, interval, state
from studies.independent_rig.rig import Array, Rig, balanced, packed
from studies.independent_rig.states import X

SIZES = (0.02, 0.06, -0.04, 0.08, -0.08, 0.01, -0.02)  # m
SECONDS, DT, NOISE, LIMIT = 2.5, 1e-3, 0.03e-3, 5.0
REST = 0.5  # s at the end over which hunting is measured
FILTER = 2e-3  # s: of the oracle's derivative


@njit(cache=True, nogil=True)
def run(rig, gains, size, noise, clock, y, work):
    """One step with its noise: ITAE over the step's size, s2; peak to peak and largest error at rest, m; overshoot."""
    kp, ki, kd, lag, b, c = gains
    dt, steps, late = clock
    n = len(noise)
    share = np.zeros(n)
    itae, integral, slope, before = 0.0, 0.0, 0.0, 0.0
    low, high, off, beyond = np.inf, -np.inf, 0.0, 0.0
    rest = n - round(REST / dt)
    way = 1.0 if size > 0.0 else -1.0
    for k in range(n):
        x = y[X]
        itae += dt * (k * dt) * abs(size - x)
        beyond = max(beyond, (x - size) * way)
        if k >= rest:
            low, high, off = min(low, x), max(high, x), max(off, abs(x - size))
        seen = x + noise[k]
        if k == 0:
            before = -seen  # the set-point before the step is 0
        rise = c * size - seen
        slope = (lag * slope + rise - before) / (lag + dt)
        before = rise
        grown = ki * dt * (size - seen)
        wish = kp * (b * size - seen) + integral + grown + kd * slope
        u = min(max(wish, -LIMIT), LIMIT)
        if (wish - u) * grown <= 0.0:
            integral += grown
        share[k] = u / LIMIT
        interval(rig, y, share, (k, dt, steps, late), work)
    return itae / abs(size), high - low, off, beyond / abs(size)


@dataclass(frozen=True, eq=False)
class Judge:
    """A rig, and how gains are tried on it.

    Attributes:
        rig: of the independent simulation.
        sizes: of the steps, m.
        seeds: of the sensor's noise; the same ones for all gains.
        step: longest integration step, s; stops and break-aways are found within it: 0.1 ms change 1e-4 of a cost.
        noise: sd of the position sensor, m.
    """

    rig: Rig
    sizes: Sequence[float] = SIZES
    seeds: Sequence[int] = (0, 1, 2, 3, 4)
    step: float = 2.5e-4
    noise: float = NOISE

    def runs(self, gains: Sequence[float]) -> Array:
        """ITAE/size (s2), peak to peak at rest (m), error at rest (m), overshoot (share): (sizes, seeds, 4).

        Args:
            gains: kp, ki, kd (V, m, s), filter time (s), set-point weight, derivative weight.
        """
        rig, clock, start = packed(self.rig), _clock(self.rig, DT, self.step, 0.0), balanced(self.rig)
        vector = tuple(float(g) for g in gains)
        out = np.empty((len(self.sizes), len(self.seeds), 4))

        def one(place: tuple[int, int]) -> None:
            i, j = place
            rng = np.random.default_rng([self.seeds[j], i])
            noise = self.noise * rng.standard_normal(round(SECONDS / DT))
            out[i, j] = run(rig, vector, self.sizes[i], noise, clock, state(self.rig, start), _work(self.rig))

        places = [(i, j) for i in range(len(self.sizes)) for j in range(len(self.seeds))]
        with ThreadPoolExecutor(THREADS) as pool:
            list(pool.map(one, places))
        return out

    def cost(self, gains: Sequence[float]) -> float:
        """Mean of ITAE over the step's size, s2."""
        mean = float(self.runs(gains)[..., 0].mean())
        return mean if math.isfinite(mean) else math.inf

    def rest(self, gains: Sequence[float]) -> float:
        """Largest peak to peak of the true position over the last half second, m."""
        return float(self.runs(gains)[..., 1].max())


THREADS = max(1, int(os.environ.get("JUDGE_THREADS", "2")))


BOUNDS = ((5.0, 1500.0), (1e-3, 600.0), (0.02, 60.0))  # of kp, ki, kd: beyond them every rig is worse by far
NO_INTEGRAL = 5e-3  # ki below which there is none
COARSE = 5e-4  # s, integration step of the search: costs differ by 0.3 % from those at 0.25 ms
# Points, generations, ends followed, their distance (logarithm).
SCREENED, EVOLVED, VALLEYS, APART = 1024, 40, 4, 0.25
SETS, SHORTEST = (
    24,
    0.75,
)  # sets of sizes between this share of the steps and all of them, where sizes are not known
UNKNOWN = 1000  # first seed of those sets' noise

Cost = Callable[[Sequence[float]], float]


def oracle(
    rig: Rig, rng: np.random.Generator, said: Callable[[str], None] = lambda text: None, blind: bool = False
) -> tuple[Array, float]:
    """The best kp, ki, kd that a long global search finds on the rig itself: gains (6,), cost.

    Points that fill the box (Sobol), differential evolution from the best of them over the logarithms, on all steps
    and one seed; the simplex search from the best valleys on all steps and seeds, twice from the best end.

    Args:
        rig: of the independent simulation.
        rng: source of everything random.
        said: receives the progress.
        blind: whether it knows neither the steps nor the noise that it will be judged by, but others like them.
    """
    from scipy.optimize import differential_evolution
    from scipy.stats import qmc

    if blind:
        rough, fine = _other_steps(rig, 2), _other_steps(rig, SETS)
    else:
        rough, fine = Judge(rig, seeds=(0,), step=COARSE).cost, Judge(rig, step=COARSE).cost
    bounds = np.log(BOUNDS)
    seen: list[tuple[float, Array]] = []

    def first(point: Array) -> float:
        seen.append((rough(_oracle_gains(point)), point.copy()))
        return seen[-1][0]

    points = bounds[:, 0] + np.ptp(bounds, axis=1) * qmc.Sobol(3, rng=rng).random(SCREENED)
    values = np.array([first(point) for point in points])
    said(f"screened: {values.min():.6g} at {_oracle_gains(points[np.argmin(values)])}")
    begin = points[np.argsort(values)[:EVOLVED]]
    differential_evolution(
        first, bounds.tolist(), init=begin, maxiter=EVOLVED, tol=1e-4, polish=False, rng=rng
    )
    seen.sort(key=lambda one: one[0])
    said(f"evolved: {seen[0][0]:.6g} at {_oracle_gains(seen[0][1])}")
    starts: list[Array] = []
    for _, point in seen:
        if len(starts) < VALLEYS and all(np.abs(point - other).max() > APART for other in starts):
            starts.append(point)
    ends = [_simplex(fine, start, 0.15, 80) for start in starts]
    for cost, point in ends:
        said(f"simplex: {cost:.6g} at {_oracle_gains(point)}")
    best = min(ends, key=lambda one: one[0])
    for side in (0.1, 0.03):
        best = min(best, _simplex(fine, best[1], side, 60), key=lambda one: one[0])
    gains = _oracle_gains(best[1])
    return np.array(gains), Judge(rig).cost(gains)


def _other_steps(rig: Rig, count: int) -> Cost:
    """The mean cost over sets of shortened steps, each with noise of its own."""
    rng = np.random.default_rng(UNKNOWN)
    sizes = rng.uniform(SHORTEST, 1.0, (count, len(SIZES))) * SIZES
    judges = [Judge(rig, tuple(one), (UNKNOWN + k,), COARSE) for k, one in enumerate(sizes)]
    return lambda gains: float(np.mean([judge.cost(gains) for judge in judges]))


def _oracle_gains(point: Array) -> tuple[float, ...]:
    kp, ki, kd = (float(g) for g in np.exp(point))
    return kp, ki if ki > NO_INTEGRAL else 0.0, kd, FILTER, 1.0, 0.0


def _simplex(cost: Cost, start: Array, side: float, most: int) -> tuple[float, Array]:
    from scipy.optimize import minimize

    begin = np.vstack([start, start + side * np.eye(len(start))])
    options = {"maxfev": most, "initial_simplex": begin}
    found = minimize(lambda p: cost(_oracle_gains(p)), start, method="Nelder-Mead", options=options)
    return float(found.fun), np.asarray(found.x)
