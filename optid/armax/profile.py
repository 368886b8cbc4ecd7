"""95 % intervals of poles and static gains by profile likelihood.

A standard error propagated from the coefficients (the delta method) treats A's roots as linear functions of its
coefficients. For poles that are close together, or hardly visible in the data, this is wrong: the interval is too
short and misplaced. The profile instead moves a pole, with all else refitted, until the sum of squares has grown
by the significant amount (Bates and Watts, Nonlinear Regression Analysis, 1988, sec. 6.1; Venzon and Moolgavkar,
Appl. Statist. 37, 1988). A pole at a given place, a pair of given modulus and a given static
gain are linear constraints on the coefficients, so each point is a small least-squares problem.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from optid.armax.audit import pole_errors, static_gain_error
from optid.armax.batch import STABLE_RADIUS, equilibrated, placed
from optid.armax.constraints import Constraint, across, fixed_gain, fixed_pair, fixed_pole
from optid.armax.freedom import VarianceSlopes
from optid.armax.gradient import Problem
from optid.armax.model import Armax
from optid.armax.signals import Signals
from optid.armax.stability import roots_inside
from optid.armax.trend import Trend
from optid.core.model import Array

LIMIT = 1.96  # standard errors at a 95 % interval's end, of one whose variance is known
NEAR = 0.05  # of that root: tolerance
WALKS = 14  # points on each side
STEPS = 12  # Gauss-Newton steps per point
SETTLED = 0.02  # change of -2 log likelihood below which a point has converged
FLATTEST = 2.0  # factor by which a step outwards may grow
OUTERMOST = 1.2  # modulus up to which a pole is followed
FARTHEST = 1e3  # standard errors up to which a static gain is followed
BESIDE = 1e-3  # of them: a shorter interval is not credible
MOST = 4_000_000  # samples processed for all intervals of a model; the remaining ones use the delta method
TURN = 0.3  # rad, by which a pair's angle may change in a step
APART = 1e-3  # rad, from the real axis

Interval = tuple[float, float]


@dataclass(frozen=True)
class Intervals:
    """95 % intervals.

    Attributes:
        poles: of each pole's modulus, in the order of `numpy.roots(a)`; infinite where a side is not determined.
        static_gains: of each input's; the same.
    """

    poles: tuple[Interval, ...]
    static_gains: tuple[Interval, ...]


@dataclass(frozen=True, eq=False)
class Place:
    """Coefficients under a constraint, and their loss.

    Attributes:
        theta: in the coordinates of the fit, shape (n,).
        angle: of a pair of poles, rad; 0 where there is none.
        growth: of -2 log likelihood over its best value.
    """

    theta: Array
    angle: float
    growth: float


def wald_intervals(model: Armax) -> Intervals:
    """First-order intervals from the covariance: accurate for long recordings."""
    poles = np.roots(np.array(model.a)).astype(complex)
    errors = pole_errors(model, poles)
    around = [_around(float(abs(p)), sd) for p, sd in zip(poles, errors, strict=True)]
    gains = [_around(_gain(model, i), static_gain_error(model, i)) for i in range(model.orders.inputs)]
    return Intervals(tuple(around), tuple(gains))


def profile_intervals(records: Sequence[Signals], model: Armax, trend: Trend) -> Intervals:
    """From the recordings to which the model was fitted by prediction errors, where these are not too long.

    Undetermined quantities, and those that would take too long, keep the interval of the delta method, which is
    accurate with much data.

    Args:
        records: to which it was fitted.
        model: the best one.
        trend: that was estimated along.
    """
    frame, problem, theta = placed(records, model, trend)
    first = wald_intervals(model)
    profile = Profile.around(problem, theta)
    poles = np.roots(np.array(model.a)).astype(complex)
    gains, every = list(first.static_gains), list(first.poles)
    with contextlib.suppress(_WorkExceeded):
        for i, (low, high) in enumerate(first.static_gains):
            unit = float(frame.output / frame.inputs[i])
            if math.isfinite(low + high):
                own = profile.gain(i, (low / unit, high / unit))
                gains[i] = unit * own[0], unit * own[1]
        for i in np.argsort(-np.abs(poles), kind="stable"):  # the most important ones first
            pole, twin = complex(poles[i]), np.flatnonzero(poles == np.conj(poles[i]))
            if pole.imag >= 0.0 and np.isfinite(first.poles[i]).all():
                every[i] = profile.pole(pole, first.poles[i])
                for other in twin:
                    every[other] = every[i]
    return Intervals(tuple(every), tuple(gains))


class _Replaced(Exception):
    """Another pole moved to the given value."""


class _WorkExceeded(Exception):
    """The limit of computation for intervals is reached."""


@dataclass(frozen=True, eq=False)
class Profile:
    """The sum of squares around its minimum.

    Attributes:
        problem: of the sum of squares.
        theta: at the minimum, shape (n,).
        loss: there.
        metric: inverse of the information there, of parameters times their sizes, and these.
        spent: samples gone through so far, in a list of one.
        told: change of the variance with C, in a list of one, if computed.
    """

    problem: Problem
    theta: Array
    loss: float
    metric: tuple[Array, Array]
    spent: list[int] = field(default_factory=lambda: [0])
    told: list[VarianceSlopes] = field(default_factory=list)

    @classmethod
    def around(cls, problem: Problem, theta: Array) -> Profile:
        """The profile of a problem's best parameters."""
        R, _, size = equilibrated(problem.information(theta))
        weight = np.linalg.inv(R.T @ R + 1e-10 * np.eye(size.size))
        return cls(problem, theta, problem.loss(theta), (np.asarray(weight), size))

    def _inside(self, theta: Array) -> bool:
        orders = self.problem.orders
        return bool(roots_inside(theta[orders.c_block], orders.nc, STABLE_RADIUS, np.empty(2 * orders.nc)))

    def limit(self, constraint: Constraint, angle: float) -> float:
        """Root of the growth of -2 log likelihood at a 95 % interval's end."""
        if not self.told:
            self.spent[0] += 2 * self.problem.orders.nc * self.problem.count
            self.told.append(VarianceSlopes.at(self.problem, self.theta, self.loss))
        return self.told[0].quantile(across(constraint, self.theta, angle))

    def gain(self, input: int, first: Interval) -> Interval:
        """The interval of a static gain, from a first guess."""
        orders, middle, half = self.problem.orders, (first[0] + first[1]) / 2, (first[1] - first[0]) / 2
        limit, ends = self.limit(fixed_gain(orders, input, middle), 0.0), []
        for side in (-1.0, 1.0):
            walk = _Steps(self, limit)
            end = _end(
                lambda x, walk=walk: walk.to([(fixed_gain(orders, input, x), 0.0)]),  # type: ignore[misc]
                (middle, limit),
                side * half,
                middle + side * FARTHEST * half,
            )
            # A likelihood is continuous at its maximum: where no step succeeds, that side is not determined.
            known = BESIDE * half < abs(end - middle) < FARTHEST * half
            ends.append(end if known else side * math.inf)
        return ends[0], ends[1]

    def pole(self, pole: complex, first: Interval) -> Interval:
        """The interval of a pole's modulus, from a first guess.

        Along the real axis through zero if the pole is real. Two real poles may become a pair on the way, and a pair
        two real ones: a modulus is within the interval if any of them fits. If another pole would move there instead,
        the interval ends at the first guess or at the point reached.
        """
        half = (first[1] - first[0]) / 2
        sign = -1.0 if pole.real < 0.0 else 1.0
        sign_of = 1.0 if pole.imag else sign
        start = abs(pole) if pole.imag else pole.real
        limit, ends = self.limit(*self._kinds(start, pole, sign)[0]), []
        for side in (-1.0, 1.0):
            walk, step = _Steps(self, limit), side * min(half, 0.5)
            reached = [start + step]

            def root(x: float, walk: _Steps = walk, reached: list[float] = reached) -> float:
                now = walk.to(self._kinds(x, pole, sign))
                if now <= limit:
                    other = self._nearer(walk.last, abs(x), pole)
                    if other is not None:
                        reached.append(other.real if not (pole.imag or other.imag) else sign_of * abs(other))
                        raise _Replaced
                    reached.append(x)
                return now

            bound = side * OUTERMOST if not pole.imag or side > 0 else 0.0
            try:
                ends.append(_end(root, (start, limit), step, bound))
            except _Replaced:
                farthest = max(reached, key=lambda x: side * x)
                ends.append(max(farthest, 0.0) if pole.imag else farthest)
        low, high = min(ends), max(ends)
        if low < 0.0 < high:
            return 0.0, max(-low, high)
        return min(abs(low), abs(high)), max(abs(low), abs(high))

    def _nearer(self, theta: Array, modulus: float, pole: complex) -> complex | None:
        """The nearest other pole, if it moved to the given value instead of this one.

        A superfluous pole can move anywhere and gives no information.
        """
        roots = np.roots(np.concatenate([[1.0], theta[: self.problem.orders.na]])).astype(complex)
        distance = np.abs(roots.real + 1j * np.abs(roots.imag) - (pole.real + 1j * abs(pole.imag)))
        there = np.abs(np.abs(roots) - modulus) < 1e-3
        if not there.any() or there.all():
            return None
        nearest = int(np.argmin(distance))
        return None if there[nearest] else complex(roots[nearest])

    def _kinds(self, x: float, pole: complex, sign: float) -> list[tuple[Constraint, float]]:
        """A real pole at that value, or a pair of that modulus; the present kind comes first."""
        orders = self.problem.orders
        real = (fixed_pole(orders, x if not pole.imag else sign * x), 0.0)
        if orders.na < 2 or x == 0.0:
            return [real]
        angle = abs(np.angle(pole)) if pole.imag else (0.1 if x > 0 else math.pi - 0.1)
        pair = (fixed_pair(orders, abs(x)), float(angle))
        return [pair, real] if pole.imag else [real, pair]

    def nearest(self, constraint: Constraint, start: Place) -> Place:
        """The smallest sum of squares under a constraint, started from a point."""
        place, damping = self._brought(constraint, start), 1e-3
        for _ in range(STEPS):
            if not math.isfinite(place.growth):
                break
            self.spent[0] += self.problem.count
            if self.spent[0] > MOST:
                raise _WorkExceeded
            R, target, size = equilibrated(self.problem.information(place.theta))
            rows, _, turn = constraint(place.theta, place.angle)
            free = _free(np.column_stack([rows / size, turn]))
            moved = False
            while damping < 1e6:
                trial = self._stepped(constraint, place, (R, target, size, free), damping)
                if trial.growth <= place.growth:
                    moved = True
                    break
                damping *= 8.0
            if not moved:
                break
            settled = place.growth - trial.growth < SETTLED
            place, damping = trial, max(damping / 10.0, 1e-9)
            if settled:
                break
        return place

    def _stepped(
        self,
        constraint: Constraint,
        place: Place,
        linear: tuple[Array, Array, Array, Array],
        damping: float,
    ) -> Place:
        R, target, size, free = linear
        n = self.theta.size
        stacked = np.concatenate([R @ free[:n], math.sqrt(damping) * free])
        wanted = np.concatenate([target[:n], np.zeros(free.shape[0])])
        step = free @ np.linalg.lstsq(stacked, wanted, rcond=None)[0]
        angle = place.angle
        if angle:
            angle = float(np.clip(angle + np.clip(step[n], -TURN, TURN), APART, math.pi - APART))
        return self._brought(constraint, Place(place.theta + step[:n] / size, angle, 0.0))

    def _brought(self, constraint: Constraint, place: Place) -> Place:
        """The nearest coefficients that satisfy the constraint, in the metric of the residuals."""
        rows, right, _ = constraint(place.theta, place.angle)
        weight, size = self.metric
        scaled = rows / size
        lacking = right - rows @ place.theta
        across = scaled @ weight @ scaled.T
        step = weight @ scaled.T @ np.linalg.lstsq(across, lacking, rcond=1e-12)[0] / size
        theta = place.theta + step
        if not self._inside(theta):
            return Place(theta, place.angle, math.inf)
        loss = self.problem.loss(theta)
        ratio = loss / self.loss if self.loss > 0.0 else math.inf
        return Place(theta, place.angle, self.problem.count * math.log(ratio) if ratio < math.inf else ratio)


class _Steps:
    """Successive points, each started from the one before and from the best one."""

    def __init__(self, profile: Profile, limit: float) -> None:
        self._profile, self.last, self._limit = profile, profile.theta, limit

    def to(self, kinds: Sequence[tuple[Constraint, float]]) -> float:
        """Root of the growth under the first constraint within the limit, else under the best one."""
        best = math.inf
        for constraint, angle in kinds:
            for theta in (self.last, self._profile.theta):
                place = self._profile.nearest(constraint, Place(theta, angle, 0.0))
                if place.growth < best:
                    best, found = place.growth, place.theta
                if best <= self._limit**2:
                    self.last = found
                    return math.sqrt(max(best, 0.0))
        return math.sqrt(max(best, 0.0))


def _end(root: Callable[[float], float], begin: Interval, step: float, bound: float) -> float:
    """The point, from a start in the direction of `step`, at which the root of the growth first exceeds the limit."""
    start, limit = begin
    inner, low, outer, high = start, 0.0, math.nan, math.nan
    x = start + step
    for _ in range(WALKS):
        x = min(x, bound) if step > 0 else max(x, bound)
        now = root(x)
        if abs(now - limit) <= NEAR:
            end = start + (x - start) * limit / now
            return min(end, bound) if step > 0 else max(end, bound)
        if now < limit:
            inner, low = x, now
            if x == bound:
                return bound
        else:
            outer, high = x, min(now, 10.0)
        if math.isnan(outer):
            x = start + (x - start) * min(max(limit / max(now, 0.1), 1.1), FLATTEST)
        else:
            x = inner + (outer - inner) * min(max((limit - low) / (high - low), 0.1), 0.9)
    return inner if math.isnan(outer) else x


def _free(rows: Array) -> Array:
    """An orthonormal basis of the null space of rows, shape (n, n - rank)."""
    _, singular, Vt = np.linalg.svd(rows)
    rank = int(np.sum(singular > 1e-10 * max(float(singular[0]), 1e-300)))
    return np.asarray(Vt[rank:].T)


def _around(value: float, sd: float) -> Interval:
    if not math.isfinite(value) or not math.isfinite(sd):
        return -math.inf, math.inf
    return value - LIMIT * sd, value + LIMIT * sd


def _gain(model: Armax, input: int) -> float:
    at_one = float(np.sum(model.a))
    return float(np.sum(model.b[input])) / at_one if abs(at_one) > 1e-12 else math.nan
