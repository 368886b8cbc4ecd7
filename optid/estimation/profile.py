"""Profile likelihood of one fitted parameter: the loss at each of its values, with all others refitted.

The interval of a fit is that of the linearised problem, symmetric by construction. The profile follows the likelihood
itself: it is asymmetric where the model is nonlinear, and open where the data give no limit.

Residuals are coloured and the model imperfect, so the cost alone overstates the evidence. It is divided by the ratio
of the fit's variance to that from the cost's curvature (the vertical adjustment of Chandler and Bate 2007, Biometrika
94:167); both intervals then agree near the minimum, and the profile shows the shape further out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy import special
from scipy.interpolate import PchipInterpolator

from optid.core.model import Array
from optid.core.recording import Recording
from optid.errors import InputError, NotIdentifiable, SolveError, nearest
from optid.estimation.multiple_shooting import FitOptions
from optid.estimation.noise_continuation import SETTLED
from optid.estimation.objective import objective_of, with_nuisance_parameters
from optid.estimation.problem import build_problem, node_distance
from optid.estimation.result import CONFIDENCE, Fit
from optid.estimation.smoother import Objective, Point, Terms, descend, settled_system, solve_schur
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    import pandas as pd

# Of the fit's half-width: the step along the profile, and by how much its minimum and the estimate may differ.
STRIDE = 0.5
FARTHEST = 24  # steps to each side; an interval still open after them counts as open


@dataclass(frozen=True, eq=False)
class Profile:
    """A parameter's profile; SI units.

    Attributes:
        value: the best one.
        values: at which the others were refitted, ascending.
        deviance: adjusted rise of -2 log likelihood above the best.
        limit: deviance at the ends of the 95 % interval.
        low, high: that interval; infinite where the data give no limit within the range.
        linear: the interval of the fit itself, for comparison.
        estimate: the fit's estimate; `sentence` says if the profile's minimum is different.
        others: one row per value: all other fitted parameters along the profile.
    """

    name: str
    unit: str
    value: float
    values: Array
    deviance: Array
    limit: float
    low: float
    high: float
    linear: tuple[float, float]
    others: pd.DataFrame
    estimate: float = math.nan

    @property
    def sentence(self) -> str:
        """The profile's interval compared with the fit's own, and whether its minimum is the fit's estimate."""
        return self._interval + self._apart

    @property
    def _apart(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        lowest = float(self.values[int(np.argmin(self.deviance))])
        half = (self.linear[1] - self.linear[0]) / 2
        if float(self.deviance.min()) < -self.limit:
            return (
                f"; its minimum lies at {lowest:.5g}{unit}, away from the estimate of {self.estimate:.5g}{unit}: "
                "the fit stopped in a local minimum; fit again from there, or with more --starts"
            )
        if half > 0 and abs(self.value - self.estimate) > STRIDE * half:
            return (
                f"; its minimum lies at {self.value:.5g}{unit}, the estimate at {self.estimate:.5g}{unit}: the "
                "fit also weighs predictions over a longer time, or it stopped early"
            )
        return ""

    @property
    def _interval(self) -> str:
        unit = "" if self.unit == "1" else f" {self.unit}"
        if not math.isfinite(self.high - self.low):
            open_ends = " and ".join(
                side for side, end in (("below", self.low), ("above", self.high)) if not math.isfinite(end)
            )
            return f"{self.name}: the data give no limit {open_ends} within the range of the profile"
        found = f"{self.name}: 95 % of the profile likelihood within {self.low:.5g} to {self.high:.5g}{unit}"
        ratio = (self.high - self.value) / max(self.value - self.low, 1e-300)
        if 0.8 < ratio < 1.25:
            return f"{found}, as symmetric as the fit's own interval"
        longer = "upwards" if ratio > 1 else "downwards"
        return f"{found}, {max(ratio, 1 / ratio):.2g} times as far {longer}: the fit's own interval is too symmetric"


def profile(
    rig: Rig,
    recordings: Iterable[Recording],
    fit: Fit,
    name: str,
    options: FitOptions | None = None,
    progress: Callable[[float], None] | None = None,
) -> Profile:
    """Compute the profile of one parameter to both sides of its estimate.

    Args:
        rig: as fitted.
        recordings: as fitted.
        fit: their fit, converged.
        name: of the parameter.
        options: as fitted; window and robust loss are used.
        progress: called with the share of the work done.

    Raises:
        InputError: the fit holds no such parameter.
        NotIdentifiable: the parameter lies at its bound, or the data do not determine it.
    """
    k, recordings, options = _place(rig, fit, name), list(recordings), options or FitOptions()
    problem = build_problem(rig.model, recordings, options.window or node_distance(recordings))
    o, _ = objective_of(rig, with_nuisance_parameters(rig), problem, options.huber)
    p, q = rig.model.vector(fit.values), fit.process_noise
    # A fit may end below the bounds of its search.
    widest = np.array([rig.model.parameters[i].bounds[0] for i in o.free])
    o = replace(o, low=np.where(p[list(o.free)] < o.low, widest, o.low))
    best, terms, _ = descend(o, Point(fit.states, p), q, precision=SETTLED / 100)
    curved, sd = _curved(o, best, terms, fit, k), math.sqrt(fit.covariance[k, k])
    limit = float(special.chdtri(1, 1.0 - CONFIDENCE))
    walk = _ProfilePath(o, q, k, STRIDE * math.sqrt(limit) * sd, limit * (sd / curved) ** 2, progress)
    middle = (float(best.p[o.free[k]]), terms.cost, best.p)
    down, up = (_follow(walk, best, terms.cost, way) for way in (-1, 1))
    rows = [*reversed(down), middle, *up]
    values, cost = (np.array([row[i] for row in rows]) for i in (0, 1))
    deviance = (cost - terms.cost) * (curved / sd) ** 2
    estimate, at = fit.parameters[k], len(down)
    return Profile(
        name,
        estimate.unit,
        middle[0],
        values,
        deviance,
        limit,
        -_crossing(-values[at::-1], deviance[at::-1], limit),
        _crossing(values[at:], deviance[at:], limit),
        (estimate.low, estimate.high),
        _others(o, k, rows),
        estimate.value,
    )


def fitted(rig: Rig, name: str) -> int:
    """Index of a parameter among those that a fit of the rig moves.

    Raises:
        InputError: it is not among them; names the nearest one.
    """
    names = [freed.name for freed in with_nuisance_parameters(rig)]
    if name not in names:
        raise InputError(f'"{name}" is not fitted', where=rig.path, field="[fit]", hint=nearest(name, names))
    return names.index(name)


def _place(rig: Rig, fit: Fit, name: str) -> int:
    k = fitted(rig, name)
    if fit.parameters[k].at_bound or not fit.parameters[k].identifiable:
        why = "lies at its bound" if fit.parameters[k].at_bound else "is not determined by these recordings"
        raise NotIdentifiable(f"{name} {why}: the profile likelihood is not defined")
    return k


def _curved(o: Objective, best: Point, terms: Terms, fit: Fit, k: int) -> float:
    """Standard deviation of a parameter from the cost's curvature alone, with those at their bounds fixed."""
    held = np.array([estimate.at_bound for estimate in fit.parameters])
    s = settled_system(o, best, terms, fit.process_noise, held)
    inverse = solve_schur(replace(s, schur=s.schur + np.diag(held.astype(float))), np.eye(len(held)))
    return math.sqrt(inverse[k, k]) * float(o.typical[k])


@dataclass(frozen=True, eq=False)
class _ProfilePath:
    """Data shared by both sides: parameter number `k`, its step, and the rise of the cost that ends it."""

    o: Objective
    q: Array
    k: int
    stride: float
    rise: float
    progress: Callable[[float], None] | None


Row = tuple[float, float, Array]  # value, cost, all parameters


def _follow(walk: _ProfilePath, at: Point, lowest: float, way: int) -> list[Row]:
    """Points away from the best in one direction, each started from the one before."""
    o, k, rows = walk.o, walk.k, list[Row]()
    begin, before = float(at.p[o.free[k]]), at
    for number in range(1, FARTHEST + 1):
        value = float(np.clip(begin + way * number * walk.stride, o.low[k], o.high[k]))
        if rows and value == rows[-1][0]:
            break  # at its bound
        try:
            found, cost = _fixed(walk, _ahead(o, at, before, k, value), value)
        except SolveError:
            break  # the model cannot be simulated there
        before, at = at, found
        rows.append((value, cost, at.p))
        if walk.progress is not None:
            walk.progress(min(max(number / FARTHEST, (cost - lowest) / walk.rise), 1.0) / 2 + (way > 0) / 2)
        if cost - lowest > walk.rise:
            break
    return rows


def _ahead(o: Objective, at: Point, before: Point, k: int, value: float) -> Point:
    """Extrapolate the line through the last two points: the path bends slowly."""
    i = o.free[k]
    gone = at.p[i] - before.p[i]
    share = (value - at.p[i]) / gone if gone else 0.0
    p, free = at.p.copy(), list(o.free)
    p[free] = np.clip(at.p[free] + share * (at.p - before.p)[free], o.low, o.high)
    p[i] = value
    return Point(at.X + share * (at.X - before.X), p)


def _fixed(walk: _ProfilePath, start: Point, value: float) -> tuple[Point, float]:
    """Fit of the others with the parameter fixed at a value."""
    low, high = walk.o.low.copy(), walk.o.high.copy()
    low[walk.k] = high[walk.k] = value
    at, terms, _ = descend(replace(walk.o, low=low, high=high), start, walk.q, precision=SETTLED)
    return at, terms.cost


def _crossing(values: Array, deviance: Array, limit: float) -> float:
    """Where the deviance first exceeds the limit; its square root is nearly linear and is interpolated."""
    root = np.sqrt(np.maximum(deviance, 0.0))
    beyond = np.flatnonzero(root >= math.sqrt(limit))
    if not len(beyond):
        return math.inf
    last = int(beyond[0])
    rising = bool((np.diff(root[: last + 1]) > 0).all())
    reach = slice(0 if rising else last - 1, last + 1)
    return float(PchipInterpolator(root[reach], values[reach])(math.sqrt(limit)))


def _others(o: Objective, k: int, rows: list[Row]) -> pd.DataFrame:
    import pandas as pd

    names = [o.model.parameters[i].name for i in o.free]
    table = pd.DataFrame([row[2][list(o.free)] for row in rows], columns=names)
    return table.set_index(names[k])
