"""A first look at where recordings begin: what no sensor sees there is tried in many places at once.

A record says little of its first state before it moves. Pressures that may lie anywhere between exhaust and supply may
push the piston either way or not at all, and a filter that takes so much for one normal distribution believes, when
the first motion is over, in pressures a tenth of a bar off, and is sure of them. Each of many normal
distributions that together make up the same prior is narrow enough to be filtered well (Gaussian sums: Sorenson and
Alspach, Automatica 7, 1971); the likeliest one, by the first moments of the record, is where the filter begins. Where
the first window ends, and at the next ones as long as that changes anything, the filter begins anew with what least
squares on everything read so far make of the state there.

Most records begin at rest. A filter to which the speed is unknown takes friction that holds the axis for forces in
balance, and believes in pressures that would balance: so everything is tried at rest as well.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import casadi as ca
import numpy as np
from scipy import stats

from optid.core.model import Array, Model
from optid.core.threads import parallel_map
from optid.estimation.initial_state_map import (
    InitialSegment,
    Likely,
    StatePrior,
    carried,
    likely_start,
    nearest,
)
from optid.estimation.likelihood import QUIET, Noise, Start, deviance, run_filter, start_of
from optid.estimation.problem import Booleans, Problem

PARTS = 32
NARROW = 0.5  # sd of a part, in those of the whole
WORTH = 2.0 * np.log(PARTS)  # in -2 log likelihood: what the likeliest of so many gains by chance
KEPT = 4  # starts of least squares, and those that go on to the next window
AGAIN = 2  # starts there beside them, about the best one: it may stand in a small hollow of a long valley
BEHIND = 20.0  # in -2 log likelihood: starts so far off do not go on
LOOKS = 4  # windows at most, at the ends of which a filter begins anew
LONGEST = 8  # segments at most in which it does: recordings with many gaps have dozens


class Known(NamedTuple):
    """Segments cut into pieces at which a filter begins anew, and what is known of the states there; one set."""

    pieces: Problem
    start: Start


class _Begun(NamedTuple):
    """Where a filter begins: the row, mean (states,) and covariance (states, states)."""

    row: int
    mean: Array
    covariance: Array


class _Tried(NamedTuple):
    """A normal distribution tried as start: mean and sd (states,), of what it is a part, and odds against it."""

    mean: Array
    sd: Array
    whole: StatePrior
    odds: float


def first_look(model: Model, problem: Problem, cut: Problem, p: Array, noise: Noise) -> Known:
    """What is known of the states where segments begin, and where their first windows end, from what is read before.

    Args:
        model: the plant.
        problem: posed with one window per segment.
        cut: the same recordings cut into windows.
        p: parameters, (parameters,).
        noise: of measurement and states.

    Returns:
        Where each segment begins one of the parts of what the model itself says of the start, moving or at rest, or all
        that where no part is likelier by what is read in the first window; then what all readings since say.
    """
    whole = start_of(model, p[None], 1)
    mean, sd = whole.mean[0, 0], np.sqrt(np.diagonal(whole.covariance[0, 0]))
    measured = np.asarray(np.isfinite(problem.measured).any(axis=0))
    hidden = _unseen(model, p, measured) & (sd > 0.0)
    if not hidden.any():
        return Known(problem, start_of(model, p[None], len(problem.begins)))
    look = _Look(model, p, noise, _tried(model, p, mean, sd, hidden))
    begun: list[_Begun] = []
    counts: list[int] = []
    longest = np.argsort(-problem.counts, kind="stable")[:LONGEST].tolist()
    for k, (begin, count) in enumerate(zip(problem.begins.tolist(), problem.counts.tolist(), strict=True)):
        ends = [row for row in cut.begins.tolist() if begin < row < begin + count][:LOOKS]
        found = look.at(problem, begin, ends or [begin + count], anew=len(ends) if k in longest else 0)
        counts += [b - a - 1 for a, b in itertools.pairwise([*(one.row for one in found), begin + count + 1])]
        begun += found
    start = Start(
        np.stack([one.mean for one in begun])[None], np.stack([one.covariance for one in begun])[None]
    )
    begins = np.array([one.row for one in begun], dtype=np.int64)
    pieces = replace(
        problem,
        begins=begins,
        counts=np.array(counts, dtype=np.int64),
        closed=np.ones(len(begins), dtype=np.bool_),
        linked=np.zeros(len(begins), dtype=np.bool_),
        recording=problem.recording[np.searchsorted(problem.begins, begins, side="right") - 1],
    )
    return Known(pieces, start)


@dataclass(frozen=True, eq=False)
class _Look:
    """A look at one segment after the other."""

    model: Model
    p: Array
    noise: Noise
    tried: tuple[_Tried, ...]

    def at(self, problem: Problem, begin: int, ends: list[int], anew: int) -> list[_Begun]:
        """Where a filter begins in a segment: at its beginning, and where so many windows end at most."""
        against = self._against(_part(problem, begin, ends[0]))
        first, *others = (self.tried[k] for k in np.argsort(against, kind="stable")[:KEPT])
        found = [_Begun(begin, first.mean, np.diag(first.sd**2))]
        ways = [(one.whole, one.whole.z(one.mean)) for one in (first, *others)]
        for end in ends[:anew]:
            part = _part(problem, begin, end)
            likely = sorted(parallel_map(partial(self._likely, part), ways), key=lambda one: one[0].evidence)
            best, whole = likely[0]
            opening = self._opening(part, whole)
            mean, covariance, normal = carried(opening, [one for one, _ in likely])
            if normal:
                last = found[-1]
                if last.row > begin and self._agrees(_part(problem, last.row, end), last, mean, covariance):
                    break
                found.append(_Begun(end, mean, covariance))
            about = nearest(opening, np.concatenate([best.z + best.root.T, best.z - best.root.T]), AGAIN)
            on = [(known, one.z) for one, known in likely if one.evidence < best.evidence + BEHIND][:KEPT]
            ways = [*on, *((whole, z) for z in about)]
        return found

    def _likely(self, part: Problem, way: tuple[StatePrior, Array]) -> tuple[Likely, StatePrior]:
        """The likeliest start near one, and what that was of."""
        known, z = way
        return likely_start(self._opening(part, known), z), known

    def _against(self, opening: Problem) -> Array:
        """What speaks against each of the starts tried, in -2 log likelihood."""
        start = Start.apart(
            *(np.stack(part)[:, None] for part in zip(*((o.mean, o.sd) for o in self.tried), strict=True))
        )
        f = run_filter(self.model, opening, *self._given(len(self.tried)), start=start)
        score = deviance(f.innovations, f.variances).sum(axis=1) + [one.odds for one in self.tried]
        return np.where(np.isfinite(score), score, np.inf)

    def _agrees(self, since: Problem, last: _Begun, mean: Array, covariance: Array) -> bool:
        """Whether a filter that began there stands where least squares do, as far as these are certain."""
        start = Start(last.mean[None, None], last.covariance[None, None])
        f = run_filter(self.model, since, *self._given(1), keep=True, start=start)
        return bool((np.abs(f.states[0, -1] - mean) <= np.sqrt(np.diagonal(covariance))).all())

    def _given(self, sets: int) -> tuple[Array, ...]:
        """Parameters and noise of states and measurement, as many times."""
        Q, R = self.noise.spectrum(len(self.model.states)), self.noise.measurement
        return tuple(np.tile(a, (sets, 1)) for a in (self.p, Q, R))

    def _opening(self, part: Problem, known: StatePrior) -> InitialSegment:
        return InitialSegment(self.model, self.p, self.noise, part, known)


def _part(problem: Problem, begin: int, end: int) -> Problem:
    """From one row up to another; what is read there counts as not yet known."""
    rows = slice(begin, end + 1)
    measured = problem.measured[rows].copy()
    measured[-1] = np.nan
    return replace(
        problem,
        time=problem.time[rows],
        dt=problem.dt[rows],
        inputs=problem.inputs[rows],
        measured=measured,
        begins=np.zeros(1, dtype=np.int64),
        counts=np.array([end - begin], dtype=np.int64),
        closed=np.ones(1, dtype=np.bool_),
        linked=np.zeros(1, dtype=np.bool_),
        recording=np.zeros(1, dtype=np.int64),
    )


def _tried(model: Model, p: Array, mean: Array, sd: Array, hidden: Booleans) -> tuple[_Tried, ...]:
    """The whole, and its parts at so many sd, narrow in the states that are hidden; the same at rest."""
    z = np.zeros((PARTS, len(mean)))
    z[:, hidden] = _spread(int(hidden.sum()))
    speeds = _speeds(model, p)
    found = []
    for still in (False, True) if speeds.any() else (False,):
        rests = speeds & still
        known = StatePrior(
            np.where(rests, 0.0, mean),
            np.where(rests, QUIET * model.scales, sd),
            np.flatnonzero(hidden & ~rests),
        )
        narrow = known.sd.copy()
        narrow[known.moved] *= NARROW
        found.append(_Tried(known.mean, known.sd, known, -WORTH))
        for one in np.where(rests, 0.0, z):
            at = known.mean + np.sqrt(1.0 - NARROW**2) * one * sd
            found.append(_Tried(at, narrow, known, float((one**2).sum())))
    return tuple(found)


def _speeds(model: Model, p: Array) -> Booleans:
    """States that are the rate of another, (states,)."""
    x = ca.SX.sym("x", len(model.states))
    rates = model.rates(x, ca.SX.sym("u", len(model.inputs)), ca.DM(p))
    return np.array(
        [any(ca.is_equal(rates[i], x[j]) for i in range(x.numel()) if i != j) for j in range(x.numel())]
    )


def _unseen(model: Model, p: Array, measured: Booleans) -> Booleans:
    """States that no measured output shows at once, (states,)."""
    x = ca.SX.sym("x", len(model.states))
    y = model.sensors(x, ca.SX.sym("u", len(model.inputs)), ca.DM(p))[np.flatnonzero(measured).tolist()]
    return np.array([not ca.depends_on(y, x[i]) for i in range(len(model.states))])


def _spread(states: int) -> Array:
    """Standard normal points, (PARTS, states), evenly spread."""
    points = stats.qmc.Sobol(states, scramble=False).random(PARTS)
    return np.asarray(stats.norm.ppf((points + 0.5 / PARTS) % 1.0))
