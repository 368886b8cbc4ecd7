"""Which effects could it be: every branch of every effect by one simulation, then a race by multi-step errors.

A simulation of an effect at its usual size, with the gains of the model's quiet filter held, shows what it would change
in the windows' errors. How much of these the effect in any strength and all other parameters explain linearly chooses
a branch of each effect (a score test with a line search); a simulation says how much of that holds. The best race on by
Gauss-Newton steps, under gains of their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np
from scipy.optimize import lsq_linear

from optid.core.llvm_simd import LANES
from optid.core.model import Array
from optid.core.threads import parallel_map
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem, with_effect
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.estimation.fixed_gain import fixed_gain_fit, innovations
from optid.estimation.likelihood import FAR, Filtered, huber
from optid.estimation.likelihood_point import NUDGES, LikelihoodProblem
from optid.estimation.multistep import QUIET, quiet_filter, window_starts
from optid.estimation.problem import Booleans

LITTLE = 0.1  # of a way, by which its slope is taken
FARTHEST = 3.0  # times the usual size: how far along a branch its strength is followed
ROUNDS = 2  # of reweighting in a linear fit
LOST = 30.0  # sd: a change beyond it counts as so much
SHARES = np.linspace(0.0, 1.0, LANES)  # of a linear step, that are tried at once
SHORT = 5000  # samples of all recordings up to which a look at the catalogue takes them all
FEWEST = 0.02  # share of the usual size below which a branch says nothing


@dataclass(frozen=True, eq=False)
class Proposal:
    """An effect where a search has it.

    Attributes:
        effect: to come to the model.
        likelihood_problem: of the model with it.
        start: all parameters where a linear step had them; under gains of its own a race may lead them astray.
        p: all parameters where the race ended.
        loss: Huber's, of windows' errors.
    """

    effect: Effect
    likelihood_problem: LikelihoodProblem
    start: Array
    p: Array
    loss: float


@dataclass(frozen=True, eq=False)
class Proposals:
    """What a look at the catalogue found.

    Attributes:
        ranked: the most promising first, each effect once.
        visible: sd by which windows' errors would change, after a refit, with an effect of the smallest size worth a
            name, each window counting once; by the effect's name; 0 where nothing would change.
        alone: loss of the model without any of them, after as many steps over the same windows.
    """

    ranked: tuple[Proposal, ...]
    visible: Mapping[str, float]
    alone: float


@dataclass(frozen=True, eq=False)
class _Led:
    """Where a linear say leads: an effect's parameters, the loss that it promises, and a step of the others.

    The step is in typical sizes, (free,).
    """

    effect: Effect
    likelihood_problem: LikelihoodProblem
    p: Array
    loss: float
    step: Array


@dataclass(frozen=True, eq=False)
class _Branch:
    """A branch before it was tried, and how visible its effect is."""

    led: _Led | None
    effect: Effect
    visible: float


Tried = TypeVar("Tried", Proposal, _Led)


@dataclass(frozen=True, eq=False)
class _Origin:
    """Where branches begin: parameters by name, the filter there, and the windows' errors with their slopes.

    `free` are the names of the fitted parameters, `typical` their sizes.
    """

    values: Mapping[str, float]
    free: tuple[str, ...]
    typical: Array
    held: Filtered
    errors: Array
    slopes: Array  # (rows, free)
    per_window: float  # rows
    room: tuple[Array, Array]  # to the bounds, in typical sizes, (free,) each


def propose(
    current: FittedModel,
    effects: Sequence[Effect],
    problem: DiagnosisProblem,
    entrants: int | None = None,
    level: float = QUIET,
    begin: Array | None = None,
) -> Proposals:
    """Effects, the most promising first.

    Args:
        current: the model that they come to.
        effects: to try.
        problem: the recordings.
        entrants: branches at most that race; all if absent. Far from the truth a linear step holds for
            none, and a right law may stand in the middle.
        level: of process noise of the filters under whose gains they race.
        begin: parameters of the model from which branches begin; its own fitted ones if absent.
    """
    o, q = problem.options, current.likelihood_problem
    p = current.p if begin is None else begin
    first = worst_recordings(current, problem)
    resets = window_starts(q.problem, o.short * problem.window)
    per_window = max(o.short * problem.window / float(np.median(q.problem.dt)), 1.0)
    origin = _origin(q, p, first, resets, per_window, level)
    if origin is None:
        return Proposals((), dict.fromkeys((effect.name for effect in effects), 0.0), math.inf)
    branches = parallel_map(partial(_branches, current, problem, origin, first, resets), effects)
    visible = {
        effect.name: max((one.visible for one in some), default=0.0)
        for effect, some in zip(effects, branches, strict=True)
    }
    led = [one.led for some in branches for one in some if one.led is not None]
    led = keep_best(led, len(led))
    running = parallel_map(partial(_tried, origin, current, first, resets), led)
    running = keep_best(running, entrants or len(running))
    for leg, (steps, most) in enumerate(o.race):
        if problem.budget.is_over:
            break
        over = first if leg < len(o.race) - 1 else None
        advanced = parallel_map(partial(_advance, problem, steps, over, resets, level), running)
        # The first goes on: under gains of its own a law may need more than a leg to be where a linear say had it.
        running = [*advanced[:1], *keep_best(advanced[1:], most - 1)]
    _, alone = _moved(problem, q, p, sum(steps for steps, _ in o.race), None, resets, level)
    return Proposals(tuple(keep_best(running, len(running))), visible, alone)


def keep_best(running: Sequence[Tried], most: int) -> list[Tried]:
    """Those that leave least, each effect once."""
    kept: list[Tried] = []
    for one in sorted(running, key=lambda one: one.loss):
        if len(kept) < most and math.isfinite(one.loss) and all(k.effect is not one.effect for k in kept):
            kept.append(one)
    return kept


def worst_recordings(current: FittedModel, problem: DiagnosisProblem) -> list[int]:
    """The segments of the recording in which most is missing, and of all others where these are short.

    What differs from recording to recording, as friction does under another pressure, shows in no single one: there the
    rig's own parameters make up for it.
    """
    q = current.likelihood_problem
    if len(q.problem.time) <= SHORT:
        return list(range(len(q.problem.counts)))
    return worst_recording(current, problem)


def worst_recording(current: FittedModel, problem: DiagnosisProblem) -> list[int]:
    """The segments of the recording in which most is missing."""
    q = current.likelihood_problem
    resets = window_starts(q.problem, problem.window)
    (z,) = innovations(q, current.p[None], q.model, current.fit.filtered, resets=resets)
    rows = np.nonzero(np.isfinite(current.fit.filtered.innovations[0]))[0]
    owner = np.repeat(q.problem.recording, q.problem.counts + 1)[rows]
    loss = np.bincount(owner, weights=huber(z))
    return np.flatnonzero(q.problem.recording == int(np.argmax(loss))).tolist()


def _origin(
    q: LikelihoodProblem,
    p: Array,
    only: Sequence[int],
    resets: Booleans,
    per_window: float,
    level: float,
) -> _Origin | None:
    held = quiet_filter(q, p, only, level)
    if held is None:
        return None
    free = list(q.free)
    P = np.tile(p, (len(free) + 1, 1))
    steps = np.where(p[free] + NUDGES[1] * q.typical > q.high, -NUDGES[1], NUDGES[1])
    P[range(1, len(P)), free] += steps * q.typical
    here, *others = innovations(q, P, q.model, held, only, resets)
    values = dict(zip((one.name for one in q.model.parameters), p.tolist(), strict=True))
    room = ((q.low - p[free]) / q.typical, (q.high - p[free]) / q.typical)
    names = tuple(q.model.parameters[i].name for i in free)
    slopes = ((np.array(others) - here) / steps[:, None]).T
    return _Origin(values, names, q.typical, held, here, slopes, per_window, room)


def _branches(
    current: FittedModel,
    problem: DiagnosisProblem,
    origin: _Origin,
    only: Sequence[int],
    resets: Booleans,
    effect: Effect,
) -> list[_Branch]:
    """Every branch of an effect, in the strength in which it explains most."""
    q = problem.likelihood_problem(with_effect(current.rig, effect))
    null = effect.at_null()
    if effect.ways:
        return [_from_ways(current, origin, only, resets, effect, q)]
    points = [{**null, **one} for one in effect.tries(*_missed(current))]
    P = np.array([q.at({**origin.values, **effect.qualified(point)}) for point in points])
    seen = innovations(q, P, current.likelihood_problem.model, origin.held, only, resets)
    found = []
    for point, z in zip(points, seen, strict=True):
        change = z - origin.errors
        visible = _visible(origin, change) / effect.size(point)
        step, loss = _explained(origin, change[:, None], 0.0)
        strength = step[-1]
        if strength < FEWEST:
            found.append(_Branch(None, effect, visible))
            continue
        scaled = {
            name: null[name] + strength * (value - null[name]) if name in effect.strength else value
            for name, value in point.items()
        }
        p = q.at({**origin.values, **effect.qualified(scaled)})
        found.append(_Branch(_Led(effect, q, p, loss, step[:-1]), effect, visible))
    return found


def _from_ways(
    current: FittedModel,
    origin: _Origin,
    only: Sequence[int],
    resets: Booleans,
    effect: Effect,
    q: LikelihoodProblem,
) -> _Branch:
    """An effect that begins at its null, along all of its ways at once."""
    null = effect.at_null()
    turns = [{**null, **{name: null[name] + LITTLE * by for name, by in way.items()}} for way in effect.ways]
    P = np.array([q.at({**origin.values, **effect.qualified(turn)}) for turn in turns])
    seen = innovations(q, P, current.likelihood_problem.model, origin.held, only, resets)
    changes = (seen - origin.errors).T / LITTLE
    visible = max(
        _visible(origin, LITTLE * one) / max(effect.size(turn), 1e-12)
        for one, turn in zip(changes.T, turns, strict=True)
    )
    step, loss = _explained(origin, changes, -FARTHEST)
    own, count = dict(null), len(origin.free)
    for strength, way in zip(step[count:], effect.ways, strict=True):
        for name, by in way.items():
            own[name] += strength * by
    p = q.at({**origin.values, **effect.qualified(own)})
    return _Branch(_Led(effect, q, p, loss, step[:count]), effect, visible)


def _tried(
    origin: _Origin, current: FittedModel, only: Sequence[int], resets: Booleans, led: _Led
) -> Proposal:
    """A branch with the parameters moved, by as much of what a linear say promises as one simulation confirms."""
    q, steps = led.likelihood_problem, led.step * origin.typical
    moves = [
        {name: origin.values[name] + share * by for name, by in zip(origin.free, steps, strict=True)}
        for share in SHARES
    ]
    own = {one.name: float(led.p[i]) for i, one in enumerate(q.model.parameters)}
    P = np.array([q.at({**own, **move}) for move in moves])
    seen = innovations(q, P, current.likelihood_problem.model, origin.held, only, resets)
    losses = 0.5 * huber(seen).sum(axis=1)
    best = int(np.argmin(losses))
    return Proposal(led.effect, q, P[best], P[best], float(losses[best]))


def _missed(current: FittedModel) -> tuple[list[Array], float]:
    """What the quiet filter's predictions of the first output miss in every stretch of data, and the sampling time."""
    problem, missed = current.likelihood_problem.problem, current.fit.filtered.innovations[0][:, 0]
    stretches = zip(problem.begins, problem.counts, strict=True)
    return [missed[first : first + count + 1] for first, count in stretches], float(np.median(problem.dt))


def _explained(origin: _Origin, changes: Array, least: float) -> tuple[Array, float]:
    """Where parameters within bounds and shares of changes (rows, some) explain most linearly, and the loss there.

    Returns the parameters' steps in typical sizes and then the shares, (free + some,).
    """
    slopes, z, some = np.column_stack([origin.slopes, changes]), origin.errors, changes.shape[1]
    low = np.append(origin.room[0], np.full(some, least))
    high = np.append(origin.room[1], np.full(some, FARTHEST))
    taken, best = np.zeros(slopes.shape[1]), math.inf
    for _ in range(ROUNDS):
        weight = np.minimum(1.0, FAR / np.maximum(np.abs(z), 1e-12))
        normal = (slopes.T * weight) @ slopes
        size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        values, vectors = np.linalg.eigh(normal / np.outer(size, size))
        root = np.sqrt(np.maximum(values, 1e-9))
        aim = -(vectors.T @ (slopes.T @ (weight * origin.errors) / size)) / root
        step = (
            lsq_linear(
                root[:, None] * vectors.T, aim, (low * size - 1e-12, high * size + 1e-12), method="bvls"
            ).x
            / size
        )
        z = origin.errors + slopes @ step
        loss = 0.5 * float(huber(z).sum())
        if loss < best:
            taken, best = step, loss
    return taken, best


def _visible(origin: _Origin, change: Array) -> float:
    """Root of what a change adds to the windows' mean squares that the free parameters cannot take away."""
    clipped = np.clip(change, -LOST, LOST)
    size = np.maximum(np.linalg.norm(origin.slopes, axis=0), 1e-300)
    unit = origin.slopes / size
    left = clipped - unit @ np.linalg.lstsq(unit.T @ unit, unit.T @ clipped, rcond=1e-9)[0]
    return float(np.sqrt(np.sum(left**2) / origin.per_window))


def _advance(
    problem: DiagnosisProblem,
    steps: int,
    only: Sequence[int] | None,
    resets: Booleans,
    level: float,
    one: Proposal,
) -> Proposal:
    """The same some steps further; lost where the simulation diverges."""
    p, loss = _moved(problem, one.likelihood_problem, one.p, steps, only, resets, level)
    return replace(one, p=p, loss=loss)


def _moved(
    problem: DiagnosisProblem,
    q: LikelihoodProblem,
    p: Array,
    steps: int,
    only: Sequence[int] | None,
    resets: Booleans,
    level: float,
) -> tuple[Array, float]:
    """Parameters some Gauss-Newton steps further under gains of their own, and the loss there."""
    held = None if problem.budget.is_over else quiet_filter(q, p, only, level)
    if held is None:
        return p, math.inf
    try:
        fit = fixed_gain_fit(q, p, q.model, held, steps, only, resets)
    except SolveError:
        return p, math.inf
    return fit.p, fit.loss
