"""Batch fit of a rig's free parameters to recordings: annealed smoothing, then intervals and a check of every node."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy import special

from optid.core.budget import Budget
from optid.core.checkpoint import Checkpoint
from optid.core.model import Array
from optid.core.recording import Recording
from optid.errors import InputError, NotIdentifiable, SolveError
from optid.estimation.checkpoint import Kept, key_of, load, save
from optid.estimation.covariance import covariance
from optid.estimation.identifiability import Collinearity, examine, find_ties
from optid.estimation.initial_trajectory import guess
from optid.estimation.noise_continuation import HARD, TIGHT, Pace, Solution, anneal, go_on, tightened
from optid.estimation.objective import objective_of, physical_bounds, with_nuisance_parameters
from optid.estimation.output_error import fit_by_simulation
from optid.estimation.problem import Booleans, build_problem, node_distance
from optid.estimation.result import CONFIDENCE, Z95, Certificate, Estimate, Fit, Outcome
from optid.estimation.smoother import Objective, Point, Terms, Watch
from optid.rigs.rigfile import Rig


@dataclass(frozen=True)
class FitOptions:
    """How to fit.

    Attributes:
        starts: number of starts; all but the first are drawn within bounds (or a factor 2).
        time_limit: s of the process's own time; then the best point so far is returned.
        huber: residuals beyond so many sd count linearly; infinity for least squares.
        process_noise: share of each state's usual size that a node may jump in the end; 0 is simulation error;
            ``None`` lets the marginal likelihood choose, for the states of each unit, and widens the intervals by
            the difference to a deterministic fit.
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
    """The progress of a running fit."""

    stage: str
    iteration: int
    cost: float
    fraction: float
    parameters: Mapping[str, float]


Report = Callable[[Progress], None]


@dataclass(frozen=True, eq=False)
class _Run:
    """The data shared by all starts of a fit."""

    options: FitOptions
    began: float
    progress: Report | None
    budget: Budget

    @property
    def late(self) -> bool:
        return self.budget.is_over

    def tell(self, progress: Progress) -> bool:
        """Report the progress; returns whether the budget is used up."""
        if self.progress is not None:
            self.progress(progress)
        return self.late


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
    options = options or FitOptions()
    limit = math.inf if options.time_limit is None else options.time_limit
    run = _Run(options, time.monotonic(), progress, Budget(limit))
    freed = with_nuisance_parameters(rig)
    if not rig.freed:
        raise InputError("nothing to fit", where=rig.path, field="[fit]", expected="at least one parameter")
    recordings = list(recordings)
    problem = build_problem(rig.model, recordings, options.window or node_distance(recordings))
    objective, p = objective_of(rig, freed, problem, options.huber)
    first = Point(guess(rig.model, problem, p), p)
    ties, linear = examine(objective, first)
    _refuse_idle(rig, ties)
    best = _best_of_starts(objective, first, linear, run)
    return _result(rig, best, options.process_noise is None, p, run.began)


def _best_of_starts(o: Objective, first: Point, linear: Terms, run: _Run) -> Solution:
    """The solution with the best score; the checkpoint of an interrupted fit counts as one of its starts.

    `linear` is the linearisation at the first start.
    """
    checkpoint, best = Checkpoint(run.options.checkpoint, key_of(o, first.p)), None
    for number, start in _starts(o, first, run.options, load(checkpoint)):
        so_far = best.at if best else None

        def keep(at: Point, number: int = number, so_far: Point | None = so_far) -> None:
            save(checkpoint, Kept(number, at, so_far))

        try:
            stage = f"start {number + 1} of {run.options.starts}"
            pace = Pace(partial(_watch, o, run, stage), lambda: run.late, keep)
            found = _from_start(o, start, linear if start is first else None, run.options.process_noise, pace)
        except SolveError:
            if run.options.starts == 1:
                raise
            continue
        if best is None or found.score < best.score:
            best = found
        if found.outcome is Outcome.TIME_LIMIT:
            return replace(best, outcome=Outcome.TIME_LIMIT)
    if best is None:
        raise SolveError(
            f"the fit failed from each of the {run.options.starts} starts: check start values, units and bounds"
        )
    return best


def _from_start(o: Objective, at: Point, linear: Terms | None, noise: float | None, pace: Pace) -> Solution:
    if noise is not None and noise <= HARD:
        return fit_by_simulation(o, at, linear, pace)
    found = anneal(o, at, linear, noise, pace)
    o = found.objective
    return go_on(replace(o, low=physical_bounds(o.model, o.free, o.low)), found, noise, pace)


def _refuse_idle(rig: Rig, ties: Collinearity) -> None:
    """Refuse a parameter to fit without influence on the data."""
    stated = {f.name for f in rig.freed}
    idle = [name for name in ties.idle if name in stated]
    if idle:
        raise NotIdentifiable(
            f"{', '.join(idle)}: without influence on these recordings; remove it from [fit] or record an "
            "experiment that shows it"
        )


def _starts(
    o: Objective, first: Point, options: FitOptions, kept: Kept | None
) -> Iterable[tuple[int, Point]]:
    """Numbers from 0 and points to start from: the rig file's values, then drawn ones.

    With a checkpoint: the best point, the interrupted one, and the remaining starts.
    """
    generator = np.random.default_rng(options.seed)
    if kept is not None:
        if kept.best is not None:
            yield kept.number, kept.best
        yield kept.number, kept.at
    for number in range(options.starts):
        p = first.p if number == 0 else _drawn(o, first.p, generator)
        if kept is None or number > kept.number:
            yield number, first if number == 0 else Point(guess(o.model, o.problem, p), p)


def _drawn(o: Objective, p: Array, generator: np.random.Generator) -> Array:
    """All parameters, the free ones drawn: within a factor 2, or within their usual size about values of 0 or less."""
    theta, drawn = p[list(o.free)], p.copy()
    factor, step = 2.0 ** generator.uniform(-1.0, 1.0, len(theta)), generator.uniform(-1.0, 1.0, len(theta))
    far = np.where(theta > 0, theta * factor, theta + step * o.typical)
    drawn[list(o.free)] = np.clip(far, o.low, o.high)
    return drawn


def _watch(o: Objective, run: _Run, start: str, stage: str, fraction: float) -> Watch:
    names = [o.model.parameters[i].name for i in o.free]

    def watch(iteration: int, cost: float, p: Array) -> bool:
        values = dict(zip(names, p[list(o.free)].tolist(), strict=True))
        return run.tell(Progress(f"{start}, {stage}", iteration, cost, fraction, values))

    return watch


def _result(
    rig: Rig,
    best: Solution,
    compare: bool,
    p0: Array,
    began: float,
) -> Fit:
    o, at, terms, q = best.objective, best.at, best.terms, best.q
    theta = at.p[list(o.free)]
    span = np.where(np.isfinite(o.high - o.low), o.high - o.low, np.abs(theta) + o.typical)
    bound = (theta - o.low <= 1e-9 * span) | (o.high - theta <= 1e-9 * span)
    ties: Collinearity = find_ties(o, at, terms, q, bound)
    _refuse_idle(rig, ties)
    fixed = bound | np.asarray(ties.mute)
    cov = covariance(o, at, terms, q, fixed)
    if compare and best.outcome is Outcome.CONVERGED:
        cov = cov + np.diag(_imperfection(o, best, cov, fixed))
    cov = cov + np.diag(np.where(fixed, 0.0, o.model.known_bias(o.free, theta) ** 2))
    half = Z95 * np.sqrt(np.maximum(np.diag(cov), 0.0))
    half = np.where(ties.mute, np.inf, half)
    reach = _one_sided(o, best, bound, np.asarray(ties.mute))
    estimates = []
    for k, i in enumerate(o.free):
        parameter = o.model.parameters[i]
        low, high = max(theta[k] - half[k], o.low[k]), min(theta[k] + half[k], o.high[k])
        if bound[k]:
            below = theta[k] - o.low[k] <= o.high[k] - theta[k]
            inner = min(theta[k] + reach[k], o.high[k]) if below else max(theta[k] - reach[k], o.low[k])
            low, high = (-math.inf, inner) if below else (inner, math.inf)
        estimates.append(
            Estimate(
                parameter.name,
                parameter.unit,
                float(theta[k]),
                float(low),
                float(high),
                float(p0[i]),
                bool(bound[k]),
                not bool(ties.mute[k]),
            )
        )
    values = {q_.name: float(v) for q_, v in zip(o.model.parameters, at.p, strict=True)}
    return Fit(
        best.outcome,
        tuple(estimates),
        values,
        cov,
        _noise(o, terms, at, q),
        q,
        at.X,
        ties.sentences,
        _certificate(o, terms, q),
        time.monotonic() - began,
    )


def _one_sided(o: Objective, best: Solution, bound: Booleans, mute: Booleans) -> Array:
    """95 % half-width, (free,), SI, of an estimate at its bound, as if it were free."""
    if not bound.any():
        return np.zeros(len(o.free))
    try:
        cov = covariance(o, best.at, best.terms, best.q, mute)
    except np.linalg.LinAlgError:
        return np.full(len(o.free), np.inf)
    return np.where(mute, np.inf, special.ndtri(0.95) * np.sqrt(np.maximum(np.diag(cov), 0.0)))


def _imperfection(o: Objective, best: Solution, cov: Array, fixed: Booleans) -> Array:
    """Variance added for errors of the model, (free,): Hausman's (1978) comparison of two estimates.

    The deterministic fit is the better estimate of a perfect model and a biased one of an imperfect model; the
    fit with process noise is less affected. Where they differ by more than their variances allow at the level of the
    intervals, the excess is due to the model and widens the interval.
    """
    try:
        at, terms = tightened(o, best)
        own = np.diag(covariance(o, at, terms, TIGHT * o.model.scales, fixed))
    except (SolveError, np.linalg.LinAlgError):
        return np.zeros(len(o.free))
    difference = (at.p - best.at.p)[list(o.free)]
    allowed = special.chdtri(1, 1.0 - CONFIDENCE) * np.abs(np.diag(cov) - own)
    return np.where(fixed, 0.0, np.maximum(difference**2 - allowed, np.maximum(own - np.diag(cov), 0.0)))


def _noise(o: Objective, t: Terms, at: Point, q: Array) -> dict[str, float]:
    from optid.core.simulation import simulate

    b = o.problem
    run = simulate(
        o.model,
        at.p,
        at.X,
        b.dt,
        b.inputs,
        first=b.begins,
        intervals=int(b.counts.max()),
        tolerance=o.tolerance,
    )
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
    limit = -special.ndtri(0.01 / (2 * n))

    def outlying(values: Array) -> Booleans:
        logs = np.log(np.maximum(values, 1e-9))
        middle = np.median(logs)
        scale = max(float(np.median(np.abs(logs - middle)) / special.ndtri(0.75)), math.sqrt(2.0 / 50.0))
        return np.asarray((logs - middle) / scale > limit)

    big = outlying(defect) & (defect > math.sqrt(special.chdtri(len(q), 0.01 / n)))
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
