"""Batch fit of a rig's free parameters to recordings: annealed smoothing, then intervals and a certificate."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy import stats

from optid.core.model import Array
from optid.core.recording import Recording
from optid.errors import InputError, NotIdentifiable, SolveError
from optid.fit.covariance import covariance
from optid.fit.identifiability import Ties, examine, find_ties
from optid.fit.objective import freed_with_rest, objective_of, window_length
from optid.fit.problem import Booleans, pose
from optid.fit.result import Certificate, Estimate, Fit, Outcome
from optid.fit.smoother import Objective, Point, Terms, descend, evaluate, settled_system
from optid.fit.start import guess
from optid.rigs.rigfile import Rig

LEVELS = (0.3, 0.03, 1e-2, 3e-3, 1e-3, 3e-4)  # process noise per node as a share of each state's usual size
HARD = 1e-6  # the share that stands for none at all
TIGHT = 1e-5  # as good as none, where the iteration still moves easily


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes:
        starts: number of starts; all but the first are drawn within bounds (or a factor 2).
        time_limit: s; the best point so far is returned.
        huber: residuals beyond so many sd count linearly; infinity for least squares.
        process_noise: share of each state's usual size that a node may jump in the end; 0 is simulation error;
            ``None`` lets the marginal likelihood choose and widens the intervals by what a deterministic fit
            says otherwise.
        window: s between nodes; ``None`` adapts to sampling.
        seed: of the drawn starts.
        checkpoint: file that keeps the best point; read back when it belongs to the same fit.
    """

    starts: int = 1
    time_limit: float | None = None
    huber: float = math.inf
    process_noise: float | None = None
    window: float | None = None
    seed: int = 0
    checkpoint: Path | None = None


@dataclass(frozen=True)
class Progress:
    """Where a running fit stands."""

    stage: str
    iteration: int
    cost: float
    fraction: float
    parameters: Mapping[str, float]


Report = Callable[[Progress], None]


class _OutOfTime(Exception):
    """Ends an iteration at the time limit."""


@dataclass(frozen=True, eq=False)
class _Solution:
    """Where one start ended: the point, its linearisation, the process noise, and the marginal score."""

    at: Point
    terms: Terms
    q: Array
    score: float
    outcome: Outcome


def fit(
    rig: Rig,
    recordings: Iterable[Recording],
    options: FitOptions | None = None,
    progress: Report | None = None,
) -> Fit:
    """Fit the parameters of a rig's [fit] table to recordings.

    Args:
        rig: model, start values, bounds and priors.
        recordings: one or many; each has its own start state.
        options: see `FitOptions`.
        progress: called after every iteration.

    Raises:
        InputError: nothing to fit.
        NotIdentifiable: a parameter has no influence on these data.
        SolveError: the model cannot be simulated at the start values.
    """
    began = time.monotonic()
    options = options or FitOptions()
    freed = freed_with_rest(rig)
    if not rig.freed:
        raise InputError("nothing to fit", where=rig.path, field="[fit]", expected="at least one parameter")
    recordings = list(recordings)
    problem = pose(rig.model, recordings, options.window or window_length(rig.model, recordings))
    objective, p = objective_of(rig, freed, problem, options.huber)
    first = Point(guess(rig.model, problem, p), p)
    _refuse_idle(rig, examine(objective, first))
    best: _Solution | None = None
    late = False
    for number, start in enumerate(_starts(objective, first, options)):
        try:
            found = _anneal(objective, start, options, number, began, progress)
        except _OutOfTime:
            late = True
            break
        except SolveError:
            if number == 0 and options.starts == 1:
                raise
            continue
        if best is None or found.score < best.score:
            best = found
        if found.outcome is Outcome.TIME_LIMIT:
            break
    if best is None:
        raise SolveError("no start led anywhere within the time limit" if late else "no start led anywhere")
    if late:
        best = replace(best, outcome=Outcome.TIME_LIMIT)
    _save(options.checkpoint, objective, best.at)
    return _result(rig, objective, best, options.process_noise is None, p, began)


def _refuse_idle(rig: Rig, ties: Ties) -> None:
    """A parameter the rig file frees and the data do not move is an error, never a silent fit."""
    stated = {f.name for f in rig.freed}
    idle = [name for name in ties.idle if name in stated]
    if idle:
        raise NotIdentifiable(
            f"{', '.join(idle)}: without influence on these recordings; remove it from [fit] or record an "
            "experiment that shows it"
        )


def _starts(o: Objective, first: Point, options: FitOptions) -> Iterable[Point]:
    kept = _load(options.checkpoint, o)
    if kept is not None:
        yield kept
        return
    generator = np.random.default_rng(options.seed)
    yield first
    for _ in range(options.starts - 1):
        drawn = first.p.copy()
        theta = first.p[list(o.free)]
        low, high = np.maximum(o.low, theta / 2), np.minimum(o.high, theta * 2)
        drawn[list(o.free)] = np.where(
            theta > 0,
            np.exp(generator.uniform(np.log(np.maximum(low, 1e-300)), np.log(np.maximum(high, 1e-300)))),
            theta,
        )
        yield Point(guess(o.model, o.problem, drawn), drawn)


def _anneal(
    o: Objective, at: Point, options: FitOptions, number: int, began: float, progress: Report | None
) -> _Solution:
    """Loose to tight; the level kept is the one the marginal likelihood prefers (or the one asked for)."""
    names = [o.model.parameters[i].name for i in o.free]
    levels: tuple[float, ...] = LEVELS
    if options.process_noise is not None:
        target = max(options.process_noise, HARD)
        levels = (*(level for level in LEVELS if level > target), target)
    best: _Solution | None = None
    terms: Terms | None = None
    late = False
    for step, level in enumerate(levels):
        q = level * o.model.scales

        def watch(iteration: int, cost: float, p: Array, step: int = step, level: float = level) -> None:
            if progress is not None:
                stage = f"start {number + 1} of {options.starts}, process noise {level:g}"
                values = dict(zip(names, p[list(o.free)].tolist(), strict=True))
                progress(Progress(stage, iteration, cost, step / len(levels), values))
            if options.time_limit is not None and time.monotonic() - began > options.time_limit:
                raise _OutOfTime

        try:
            at, terms, _ = descend(o, at, q, iterations=50, precision=1e-4, terms=terms, watch=watch)
        except _OutOfTime:
            if best is None:
                raise
            late = True
            break
        _save(options.checkpoint, o, at)
        score = marginal(o, at, terms, q)
        if best is not None and options.process_noise is None and score > best.score:
            break  # tighter explains the data less well: the model is not better than this
        best = _Solution(at, terms, q, score, Outcome.TIME_LIMIT)
    assert best is not None
    if late:
        return best
    at, terms, settled = descend(o, best.at, best.q, iterations=60, precision=1e-9, terms=best.terms)
    outcome = Outcome.CONVERGED if settled else Outcome.NOT_CONVERGED
    return _Solution(at, terms, best.q, marginal(o, at, terms, best.q), outcome)


def marginal(o: Objective, at: Point, t: Terms, q: Array) -> float:
    """-2 log of the likelihood of the data with the states integrated out (Laplace), up to a constant.

    The states' volume and the process noise's normalisation balance, so that q can be chosen by it, as the
    diffusion in CTSM (Kristensen et al. 2004).
    """
    s = settled_system(o, at, t, q, np.zeros(len(o.free), dtype=bool))
    volume = 2.0 * float(np.log(s.factor[0]).sum())
    links = int(o.problem.linked.sum())
    return t.cost + volume + 2.0 * links * float(np.log(q / o.model.scales).sum())


def _result(
    rig: Rig,
    o: Objective,
    best: _Solution,
    compare: bool,
    p0: Array,
    began: float,
) -> Fit:
    at, terms, q = best.at, best.terms, best.q
    theta = at.p[list(o.free)]
    span = np.where(np.isfinite(o.high - o.low), o.high - o.low, np.abs(theta) + o.typical)
    bound = (theta - o.low <= 1e-9 * span) | (o.high - theta <= 1e-9 * span)
    ties: Ties = find_ties(o, at, terms, q, bound)
    _refuse_idle(rig, ties)
    fixed = bound | np.asarray(ties.mute)
    cov = covariance(o, at, terms, q, fixed)
    freedom = max(len(o.problem.begins) - len(o.free), 2)
    if compare and best.outcome is Outcome.CONVERGED:
        cov = cov + np.diag(_imperfection(o, best, cov, fixed))
    half = stats.t.ppf(0.975, freedom) * np.sqrt(np.maximum(np.diag(cov), 0.0))
    half = np.where(ties.mute, np.inf, half)
    estimates = []
    for k, i in enumerate(o.free):
        parameter = o.model.parameters[i]
        low, high = max(theta[k] - half[k], o.low[k]), min(theta[k] + half[k], o.high[k])
        estimates.append(
            Estimate(
                parameter.name, parameter.unit, float(theta[k]), float(low), float(high), float(p0[i]),
                bool(bound[k]), not bool(ties.mute[k]),
            )
        )  # fmt: skip
    values = {q_.name: float(v) for q_, v in zip(o.model.parameters, at.p, strict=True)}
    return Fit(
        best.outcome, tuple(estimates), values, cov, _noise(o, terms, at, q), q, at.X, ties.sentences,
        _certificate(o, terms, q), time.monotonic() - began,
    )  # fmt: skip


def _imperfection(o: Objective, best: _Solution, cov: Array, fixed: Booleans) -> Array:
    """Variance added for what the model gets wrong, (free,): Hausman's (1978) comparison of two estimates.

    The deterministic fit is the better estimate of a perfect model and a biased one of an imperfect model; the
    fit with process noise is less affected. Where they differ by more than their variances allow at 5 %, the
    excess is the model's fault and widens the interval.
    """
    at = best.at
    try:
        for level in (level for level in (*LEVELS, 1e-4, TIGHT) if level * o.model.scales[0] < best.q[0]):
            at, _, _ = descend(o, at, level * o.model.scales, iterations=40, precision=1e-6)
        q = TIGHT * o.model.scales
        own = np.diag(covariance(o, at, evaluate(o, at, q, slopes=True), q, fixed))
    except (SolveError, np.linalg.LinAlgError):
        return np.zeros(len(o.free))
    difference = (at.p - best.at.p)[list(o.free)]
    allowed = stats.chi2.isf(0.05, 1) * np.abs(np.diag(cov) - own)
    return np.where(fixed, 0.0, np.maximum(difference**2 - allowed, 0.0))


def _noise(o: Objective, t: Terms, at: Point, q: Array) -> dict[str, float]:
    from optid.core.simulation import simulate

    b = o.problem
    run = simulate(o.model, at.p, at.X, b.dt, b.inputs, first=b.begins, intervals=int(b.counts.max()))
    found = {}
    for j, port in enumerate(o.model.outputs):
        errors = [
            b.measured[i : i + n, j] - run.outputs[w, :n, j]
            for w, (i, n) in enumerate(zip(b.begins, b.counts, strict=True))
        ]
        e = np.concatenate(errors)
        if np.isfinite(e).any():
            found[port.role] = float(np.sqrt(np.nanmean(e**2)))
    return found


def _certificate(o: Objective, t: Terms, q: Array) -> Certificate:
    """A node is sound when neither its defect nor its misfit is an outlier among all, at 1 % for the whole fit."""
    import pandas as pd

    n = len(t.end)
    defect = np.sqrt(((t.defect / q) ** 2).sum(axis=1))
    misfit = t.misfit[:, 0] / np.maximum(t.misfit[:, 1], 1.0)
    limit = stats.norm.isf(0.01 / (2 * n))

    def outlying(values: Array) -> Booleans:
        logs = np.log(np.maximum(values, 1e-9))
        middle = np.median(logs)
        scale = max(1.4826 * float(np.median(np.abs(logs - middle))), math.sqrt(2.0 / 50.0))
        return np.asarray((logs - middle) / scale > limit)

    big = outlying(defect) & (defect > stats.chi.isf(0.01 / n, len(q)))
    sound = np.isfinite(misfit) & ~(outlying(misfit) | big)
    return Certificate(
        pd.DataFrame(
            {
                "recording": o.problem.recording,
                "time": o.problem.time[o.problem.begins],
                "defect": defect,
                "misfit": misfit,
                "sound": sound,
            }
        )
    )


def _save(path: Path | None, o: Objective, at: Point) -> None:
    if path is None:
        return
    draft = path.with_name(path.name + ".part")
    draft.write_text(json.dumps({"fit": _identity(o), "X": at.X.tolist(), "p": at.p.tolist()}))
    draft.replace(path)


def _load(path: Path | None, o: Objective) -> Point | None:
    if path is None or not path.exists():
        return None
    try:
        kept = json.loads(path.read_text())
        X, p = np.array(kept["X"], dtype=float), np.array(kept["p"], dtype=float)
    except (OSError, ValueError, KeyError, TypeError):
        return None
    same = kept.get("fit") == _identity(o) and X.shape == (len(o.problem.begins), len(o.model.states))
    return Point(X, p) if same and p.shape == (len(o.model.parameters),) else None


def _identity(o: Objective) -> str:
    """What makes a checkpoint belong to this fit: the data, the model and what is free."""
    import hashlib

    digest = hashlib.sha256()
    for array in (o.problem.time, o.problem.inputs, o.problem.measured, o.low, o.high, o.prior):
        digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(repr((o.model.name, [q.name for q in o.model.parameters], o.free)).encode())
    return digest.hexdigest()
