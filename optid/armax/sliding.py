"""What a recording shows of an axis beside its linear model: dry friction, break-away, load, dead zone.

The least axis with dry friction is a force that the command charges, a speed, and a position, per unit of mass:

    dF/dt = k (u + alpha |u| + d) - w^2 v - l |u| F,    dv/dt = F - c v - f sgn v,    dx/dt = v

An open valve lets the force decay at the rate l |u|; k and w^2 vary over the stroke, here by parabolas about its
middle (as eqs. 1, 2, 9 and 10 of a cylinder say, linearised). Without these terms dry friction is mistaken for
damping. The force law integrated over time,

    F = dv/dt + c v + f sgn v = integral of k(x) (u + alpha |u|) + k d t - integral of w^2(x) dx - l integral of |u| F
        + constant,

is linear in all but the products of l with c and f: Gauss and Newton's method finds it from stretches in which the
axis moves, each with a constant of its own; position, speed and acceleration are smoothed (Savitzky and Golay,
Analytical Chemistry 36, 1964). A linear model cannot tell friction from damping, nor a load from a speed that differs
by direction. The force at which the axis breaks away follows from the force law, which holds at rest too.
"""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optid.armax.model import Armax
from optid.armax.signals import Signals
from optid.core.document import finite
from optid.core.model import Array
from optid.errors import InputError

Mask = NDArray[np.bool_]

NEAR = 2e-3  # of 1 in z: an integrator's pole
SMOOTHED = 0.3  # of the mode's period: length of the smoothing polynomial
STRETCH = 20.0  # over w: s that share a constant
# Of the largest speed, and sd of the speed's noise: below it the axis may be at rest.
SLOW, NOISE = 0.015, 5.0
LEAST, EXPLAINED = 200, 0.5  # moving samples, and share of the acceleration's variance
SURE = 3.0  # standard errors
# Half-widths of a dead zone, shares of the largest command; how many of them.
NARROW, WIDEST, TRIED = 2e-3, 0.12, 25
BETTER = 0.95  # a dead zone must leave less than this of the squared residual
STEPS = 8  # of Gauss and Newton: on the rigs of studies/pid_gains.py the last one changes the decay by less than 1e-5
STARTS = 5  # starts from rest needed for a break-away force


@dataclass(frozen=True)
class SlidingAxis:
    """An axis with dry friction, per unit of mass, in the recording's SI units.

    Attributes:
        speed_gain: steady speed per command.
        asymmetry: share by which it is larger for positive commands, smaller for negative ones.
        frequency: w in the middle of the motion, rad/s.
        damping: c, 1/s, without dry friction.
        dry_friction: f, output's unit/s2.
        breakaway_ratio: friction at which the axis breaks away over f, at least 1.
        load: d, constant load added to the command; 0 where it is not significant.
        dead_zone: half-width, command's unit; 0 for none.
        explained: share of the acceleration's variance.
        decay: l, rate at which the force decays per command, 1/s over the command's unit.
        gain_slope, gain_curvature: share by which k grows per output's unit from the middle, and per its square.
        stiffness_slope, stiffness_curvature: the same of w^2.
        half_travel: largest distance from the middle of the motion.
    """

    speed_gain: float
    asymmetry: float
    frequency: float
    damping: float
    dry_friction: float
    breakaway_ratio: float
    load: float
    dead_zone: float
    explained: float
    decay: float = 0.0
    gain_slope: float = 0.0
    gain_curvature: float = 0.0
    stiffness_slope: float = 0.0
    stiffness_curvature: float = 0.0
    half_travel: float = 0.0

    @property
    def position_dependence(self) -> tuple[float, float, float, float, float]:
        """Slope and curvature of the gain, of the stiffness, and half the travel over which they are known."""
        gain, stiffness = (
            (self.gain_slope, self.gain_curvature),
            (self.stiffness_slope, self.stiffness_curvature),
        )
        return *gain, *stiffness, self.half_travel


def mode_frequency(model: Armax) -> float | None:
    """Of the slowest two poles beside an integrator's, rad/s; None for a model of another kind."""
    poles = np.roots(np.array(model.a)).astype(complex)
    others = sorted((p for p in poles if abs(p - 1.0) > NEAR and abs(p) > 1e-9), key=lambda p: abs(np.log(p)))
    if len(others) == len(poles) or len(others) < 2 or abs(others[0]) >= 1.0 or others[0].real <= 0.0:
        return None
    pair = [others[0], others[1] if others[0].imag == 0.0 else others[0].conjugate()]
    if pair[1].real <= 0.0:
        return None
    return float(math.sqrt(abs(np.log(pair[0]) * np.log(pair[1]))) / model.sample_time)


def axis_shown(signals: Signals, model: Armax) -> SlidingAxis | None:
    """The axis fitted to a recording with a known linear model; None without one, or for more than one input."""
    frequency = mode_frequency(model)
    if frequency is None or signals.u.shape[1] != 1:
        return None
    return sliding_axis(signals.y, signals.u[:, 0], model.sample_time, frequency)


def sliding_axis(y: Array, u: Array, sample_time: float, frequency: float) -> SlidingAxis | None:
    """Fit the axis to one recording.

    Args:
        y: output, shape (n,), NaN where missing.
        u: command, shape (n,).
        sample_time: s.
        frequency: of its mode, roughly, rad/s.

    Returns:
        None if the recording does not show such an axis.
    """
    signals = _Signals.of(y, u, sample_time, frequency)
    if signals is None:
        return None
    plain = signals.regression(0.0)
    widths = np.geomspace(NARROW, WIDEST, TRIED) * float(np.nanmax(np.abs(u)))
    tried = [signals.regression(float(width)) for width in widths]
    best = min(tried, key=lambda one: one.squares)
    found = best if best.squares < BETTER * plain.squares else plain
    return _axis(signals, found)


@dataclass(frozen=True, eq=False)
class _Regression:
    """Least squares with one dead zone.

    Attributes:
        theta: c, f, l, w2, k, k alpha, k d, then the slopes and the curvatures of w2, k and k alpha.
        covariance: of theta.
        squares: sum of the squared residuals.
        explained: share of the acceleration's variance.
        width: half the dead zone.
        force: from the motion, a + c v + f sgn v, (n,).
        charged: from the command, up to a constant, (n,).
    """

    theta: Array
    covariance: Array
    squares: float
    explained: float
    width: float
    force: Array
    charged: Array


@dataclass(frozen=True, eq=False)
class _Signals:
    """Smoothed signals, and where the axis moves; all (n,)."""

    T: float
    window: int
    x: Array
    v: Array
    a: Array
    u: Array
    moving: Mask
    slow: float
    stretch: NDArray[np.int64]

    @classmethod
    def of(cls, y: Array, u: Array, T: float, frequency: float) -> _Signals | None:
        window = max(2 * round(0.5 * SMOOTHED * 2.0 * math.pi / (frequency * T)) + 1, 5)
        known = np.isfinite(y) & np.isfinite(u)
        if known.sum() < max(LEAST, 4 * window):
            return None
        times = np.arange(y.size)
        whole = np.interp(times, times[known], y[known])
        x, v, a = (_smooth(whole, window, T, order) for order in range(3))
        sd = float(np.std((whole - x)[known])) * float(np.linalg.norm(_speed_weights(window, T)))
        slow = max(SLOW * float(np.max(np.abs(v))), NOISE * sd)
        near = np.ones(window)
        lost = np.convolve(~known, near, "same") > 0.5
        rests = np.convolve(np.abs(v) < 0.5 * slow, near, "same") > 0.5
        moving = (np.abs(v) > slow) & ~lost & ~rests
        moving[:window] = moving[-window:] = False
        stretch = (times // max(round(STRETCH / (frequency * T)), 4)).astype(np.int64)
        held = np.where(np.isfinite(u), u, 0.0)
        return cls(T, window, x, v, a, held, moving, slow, stretch) if moving.sum() >= LEAST else None

    def integral(self, values: Array) -> Array:
        """The integral up to each sample of a held signal, smoothed like the position."""
        return _smooth(np.r_[0.0, np.cumsum(values)[:-1]] * self.T, self.window, self.T, 0)

    @property
    def centred_position(self) -> Array:
        """Position from the middle of the motion."""
        return np.asarray(self.x - float(np.mean(self.x[self.moving])))

    @property
    def half_travel(self) -> float:
        """Largest distance from there, in motion."""
        return float(np.max(np.abs(self.centred_position[self.moving])))

    def passed(self, width: float) -> Array:
        """The command after a dead zone."""
        return np.asarray(np.sign(self.u) * np.maximum(np.abs(self.u) - width, 0.0))

    def regression(self, width: float) -> _Regression:
        """Least squares over the stretches in which the axis moves."""
        passed = self.passed(width)
        opened = np.abs(passed)
        motion = np.column_stack([self.a, self.v, np.sign(self.v)])
        decaying = np.column_stack([self.integral(opened * column) for column in motion.T])
        built_up = np.column_stack(self._built_up(passed))
        moved, decayed, grown = map(self._within_stretches, (motion, decaying, built_up))
        c, f, rate = 0.0, 0.0, 0.0
        for _ in range(STEPS):
            left = moved + rate * decayed
            A = np.column_stack([left[:, 1:], decayed @ (1.0, c, f), -grown])
            theta = np.asarray(np.linalg.lstsq(A, -left[:, 0], rcond=None)[0], dtype=float)
            c, f, rate = float(theta[0]), float(theta[1]), rate + float(theta[2])
        rest, theta[2] = left[:, 0] + A @ theta, rate
        squares = float(np.sum(rest**2))
        # Smoothing correlates neighbours: a window of them counts as two samples.
        stretches = np.unique(self.stretch[self.moving]).size
        free = max(2.0 * len(A) / self.window - theta.size - stretches, 1.0)
        covariance = np.asarray(np.linalg.pinv(A.T @ A), dtype=float) * squares / free
        explained = 1.0 - squares / max(float(np.sum(moved[:, 0] ** 2)), 1e-300)
        charged = np.asarray(built_up @ theta[3:] - rate * decaying @ (1.0, c, f))
        force = np.asarray(motion @ (1.0, c, f))
        return _Regression(theta, covariance, squares, explained, width, force, charged)

    def _built_up(self, passed: Array) -> list[Array]:
        """The force that builds up for a unit of each parameter of its law: w2, k, k alpha, k d, the parabolas."""
        x, opened = self.centred_position, np.abs(passed)
        found = [-x, self.integral(passed), self.integral(opened), self.T * np.arange(float(x.size))]
        for power in (1, 2):
            varied = [self.integral(passed * x**power), self.integral(opened * x**power)]
            found += [-(x ** (power + 1)) / (power + 1), *varied]
        return found

    def _within_stretches(self, table: Array) -> Array:
        """Columns less their means over each stretch, where the axis moves."""
        table = table[self.moving]
        _, group = np.unique(self.stretch[self.moving], return_inverse=True)
        count = np.bincount(group)
        means = np.column_stack([np.bincount(group, column) / count for column in table.T])
        return np.asarray(table - means[group])


def _axis(signals: _Signals, found: _Regression) -> SlidingAxis | None:
    """The axis from the regression; None where its values are not those of an axis."""
    c, f, rate, w2, k, ka, kd = found.theta[:7]
    sd = np.sqrt(np.diag(found.covariance))
    if not (
        found.explained >= EXPLAINED and w2 > SURE * sd[3] and abs(k) > SURE * sd[4] and f > SURE * sd[1]
    ):
        return None
    load = kd / k if abs(kd) > SURE * sd[6] else 0.0
    return SlidingAxis(
        float(k / w2),
        float(np.clip(ka / k, -0.5, 0.5)),
        math.sqrt(w2),
        max(float(c), 0.0),
        float(f),
        max(_breakaway(signals, found, float(sd[1])) / float(f), 1.0),
        float(load),
        found.width,
        found.explained,
        max(float(rate), 0.0),
        float(found.theta[8] / k),
        float(found.theta[11] / k),
        float(found.theta[7] / w2),
        float(found.theta[10] / w2),
        signals.half_travel,
    )


def _breakaway(signals: _Signals, found: _Regression, sd: float) -> float:
    """Median force at which the axis leaves a rest, per mass; that in motion if it is not significantly larger.

    `sd` is the standard error of that in motion.
    """
    # The force up to a constant, which follows from the motion after the rest.
    f, grown = found.theta[1], found.charged
    whole = found.force - grown
    forces = []
    for start in _departures(signals):
        after = slice(start + signals.window // 2, start + signals.window // 2 + max(signals.window, 8))
        way = math.copysign(1.0, signals.v[start])
        if np.any(signals.v[start : after.stop] * way < 0.5 * signals.slow):
            continue
        leaves = start - 1
        while leaves > 0 and abs(signals.v[leaves]) > 0.25 * signals.slow:
            leaves -= 1
        forces.append(way * float(np.median(whole[after]) + grown[max(leaves - signals.window // 4, 0)]))
    if len(forces) < STARTS:
        return float(f)
    median, quarter = float(np.median(forces)), float(np.subtract(*np.percentile(forces, (75, 25)))) / 1.35
    unsure = math.hypot(SURE * sd, SURE * quarter * math.sqrt(0.5 * math.pi / len(forces)))
    return median if median - f > unsure else float(f)


def _departures(signals: _Signals) -> list[int]:
    """Samples at which it begins to move after a rest of a window and more."""
    fast = np.abs(signals.v) > signals.slow
    rest = signals.window + signals.window // 4
    rested = np.convolve(fast, np.ones(rest), "full")[: fast.size] < 0.5
    starts = np.flatnonzero(fast[1:] & rested[:-1]) + 1
    return [int(s) for s in starts if 2 * rest < s < fast.size - 4 * signals.window]


def _smooth(values: Array, window: int, T: float, order: int) -> Array:
    from scipy.signal import savgol_filter

    return np.asarray(savgol_filter(values, window, 3, order, T))


def _speed_weights(window: int, T: float) -> Array:
    from scipy.signal import savgol_coeffs

    return np.asarray(savgol_coeffs(window, 3, 1, T))


def to_document(axis: SlidingAxis | None) -> dict[str, float] | None:
    """For armax.json."""
    return None if axis is None else {field.name: getattr(axis, field.name) for field in fields(axis)}


def from_document(content: Any, where: object) -> SlidingAxis | None:
    """From armax.json.

    Raises:
        InputError: a field is missing, not a number, or not possible for an axis.
    """
    if content is None:
        return None
    if not isinstance(content, dict):
        raise InputError("no table", where=where, field="axis", expected="numbers by name")
    names = [field.name for field in fields(SlidingAxis)]
    older = {field.name: field.default for field in fields(SlidingAxis) if field.default is not MISSING}
    content = older | content  # files of versions that did not know these
    for name in names:
        if name not in content:
            raise InputError("missing", where=where, field=f"axis.{name}")
    axis = SlidingAxis(*(finite(content[name], f"axis.{name}", where) for name in names))
    for name in ("frequency", "dry_friction", "damping", "dead_zone", "decay"):
        if getattr(axis, name) < 0.0:
            raise InputError(
                f"{getattr(axis, name):g}", where=where, field=f"axis.{name}", expected="no negative number"
            )
    if (
        axis.frequency == 0.0
        or axis.speed_gain == 0.0
        or axis.breakaway_ratio < 1.0
        or abs(axis.asymmetry) > 0.5
    ):
        raise InputError("no axis", where=where, field="axis", expected="as optid identify writes it")
    return axis
