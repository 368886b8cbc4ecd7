"""The rig's own model, fitted from every start that its plant suggests."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.stats import median_abs_deviation

from optid.core.model import Array
from optid.core.threads import parallel_map
from optid.diagnosis.evaluation import open_variance
from optid.diagnosis.fitted import FittedModel, alternate_horizons, fit_model, refit
from optid.diagnosis.problem import DiagnosisProblem, Stage, measurement_noise
from optid.diagnosis.validation import cross_validate
from optid.errors import SolveError
from optid.estimation.likelihood import huber_weight
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.multistep import MultistepFit, fit_multistep, quiet_filter, quiet_noise
from optid.quality.noise import MOTION
from optid.rigs.rigfile import Freed


def fit_base(problem: DiagnosisProblem) -> tuple[FittedModel, DiagnosisProblem]:
    """The base model, and the problem with the expected errors of a correct model's windows.

    Raises:
        SolveError: the model cannot be simulated at any start.
    """
    problem.report(Stage.BASE_FIT, "fitting the base model")
    q, o = problem.likelihood_problem(problem.rig), problem.options
    starts = search_starts(q, q.model.vector(problem.rig.parameters))

    def short(p: Array) -> MultistepFit | SolveError:
        try:
            return fit_multistep(q, p, o.short * problem.window, turns=2, steps=o.steps)
        except SolveError as error:
            return error

    fits = parallel_map(short, starts)
    near = [one for one in fits if isinstance(one, MultistepFit)]
    if not near:
        raise next(one for one in fits if isinstance(one, SolveError))
    best = min(near, key=lambda one: one.loss)
    problem = replace(problem, open_variance=open_variance(q, best.p, quiet_noise(q), problem.window))
    q = problem.likelihood_problem(problem.rig)
    near = [one for one in near if one.loss <= o.near * best.loss]
    whole = parallel_map(
        lambda one: fit_multistep(q, one.p, problem.window, turns=o.turns, steps=o.steps), near
    )
    best = min(whole, key=lambda one: one.loss)
    # The expected errors depend on where the axis rests: computed again at the fitted parameters.
    noise = quiet_noise(q, best.level)
    problem = replace(problem, open_variance=open_variance(q, best.p, noise, problem.window))
    q = problem.likelihood_problem(problem.rig)
    fit = fit_multistep(q, best.p, problem.window, turns=o.turns, steps=o.steps, level=best.level)
    return alternate_horizons(FittedModel((), problem.rig, fit), problem), problem


def with_open_variance(problem: DiagnosisProblem, model: FittedModel) -> DiagnosisProblem:
    """The problem with the expected errors of a correct model's windows at these parameters."""
    if problem.open_variance is not None:
        return problem
    q = problem.likelihood_problem(problem.rig)
    noise = quiet_noise(q, model.fit.level)
    return replace(problem, open_variance=open_variance(q, model.p, noise, problem.window))


def with_residual_noise(
    problem: DiagnosisProblem, base: FittedModel, search: DiagnosisProblem
) -> DiagnosisProblem:
    """The problem with the coloured noise that a base at the noise leaves: no motion hides its colour there.

    The first window of a recording begins in a state that is not known yet and does not count.
    """
    coloured = [role for role, one in problem.rig.channels.items() if one.colour]
    if not coloured or not is_at_noise(base, search):
        return problem
    q, channels = problem.likelihood_problem(problem.rig), dict(problem.rig.channels)
    begins = np.repeat(q.problem.time[q.problem.begins], q.problem.counts + 1)
    filtered = quiet_filter(q, base.p, base.fit.level)
    if filtered is None:
        return problem
    left = np.where((q.problem.time - begins < problem.window)[:, None], math.nan, filtered.innovations[0])
    for j, port in enumerate(q.model.outputs):
        known = left[np.isfinite(left[:, j]), j]  # a sensor slower than the log has no value at most samples
        rough = float(median_abs_deviation(known, scale="normal")) if port.role in coloured else 0.0
        if not rough > 0.0:
            continue
        known = known * huber_weight(known / rough)
        square = float(np.mean(known**2))
        found = max(float(np.mean(known[1:] * known[:-1])) / square, 0.0)
        if found < MOTION:
            channels[port.role] = replace(channels[port.role], sd=math.sqrt(square), colour=found)
    rig = replace(problem.rig, channels=channels)
    return replace(problem, rig=rig, noise=measurement_noise(rig, problem.train), _questions={})


def at_full_rate(
    base: FittedModel, search: DiagnosisProblem, problem: DiagnosisProblem
) -> tuple[FittedModel, DiagnosisProblem] | None:
    """The base and the problem of the search at the recordings' own rate; ``None`` where nothing could change.

    A command that jumps or turns inside a decimated hold acts at another time there: a stiff cylinder then misses its
    pressures, and a play follows another command.
    """
    if search.train is problem.train or is_at_noise(base, search):
        return None
    full = with_open_variance(problem, base)
    return refit(base, full), replace(full, budget=search.budget)


def is_at_noise(model: FittedModel, problem: DiagnosisProblem) -> bool:
    """Whether a model's cross-validated windows are as good as the noise allows."""
    return cross_validate(model, problem).error_over_noise <= problem.criteria.error_over_noise


def search_starts(q: LikelihoodProblem, p: Array) -> list[Array]:
    """The parameters with each alternative start that the plant states for the free ones, one at a time."""
    sets = [q.model.parameters[i].starts for i in q.free]
    count = max((len(one) for one in sets), default=0)
    found: list[Array] = []
    for k in range(max(count, 1)):
        start = p.copy()
        for i, own, low, high in zip(q.free, sets, q.low, q.high, strict=True):
            if own:
                start[i] = np.clip(own[min(k, len(own) - 1)], low, high)
        if not any(np.array_equal(start, other) for other in found):
            found.append(start)
    return found


def relax_bounds(base: FittedModel, problem: DiagnosisProblem) -> FittedModel | None:
    """The base model with the [fit] table's bounds widened to the plant's own, if that explains everything."""
    rig, own = base.rig, {q.name: q.bounds for q in base.rig.model.parameters}
    if is_at_noise(base, problem):
        return None
    edge = {f.name for f in rig.freed if _at_edge(f, base.values[f.name]) and (f.low, f.high) != own[f.name]}
    if not edge:
        return None
    freed = tuple(
        replace(f, low=own[f.name][0], high=own[f.name][1]) if f.name in edge else f for f in rig.freed
    )
    wide = replace(rig, freed=freed)
    model = fit_model(problem, (), wide, problem.likelihood_problem(wide), base.p, short=True)
    return model if is_at_noise(model, problem) else None


def _at_edge(freed: Freed, value: float) -> bool:
    return min(value - freed.low, freed.high - value) <= 1e-6 * max(abs(value), freed.high - freed.low)
