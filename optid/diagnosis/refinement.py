"""The chosen model at its maximum likelihood parameters, unless these predict windows worse than others."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array
from optid.diagnosis.base_fit import is_at_noise
from optid.diagnosis.fitted import FittedModel, fit_model, refit
from optid.diagnosis.problem import DiagnosisProblem
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.estimation.fisher_scoring import maximise, noise_levels, successive_halving
from optid.estimation.likelihood import Noise
from optid.estimation.likelihood_point import LikelihoodFit, LikelihoodPoint, LikelihoodProblem
from optid.estimation.multistep import multistep_loss
from optid.estimation.objective import physical_bounds
from optid.rigs.rigfile import Rig


@dataclass(frozen=True, eq=False)
class RefinedModel:
    """A model with its likelihood.

    Attributes:
        effects: beyond the rig file's; `rig` holds them.
        fit: parameters, process noise, filter and information.
        shift: difference of the maximum likelihood parameters from those used, (free,), SI.
    """

    effects: tuple[Effect, ...]
    rig: Rig
    fit: LikelihoodFit
    shift: Array

    def own_values(self, effect: Effect) -> dict[str, float]:
        """An effect's parameters by own name, SI."""
        index = self.rig.model.index
        return {q.name: float(self.fit.p[index(f"{effect.name}.{q.name}")]) for q in effect.parameters}

    def at_null(self, effect: Effect) -> Array:
        """The parameters with the effect's strengths at their nulls, (parameters,): the model without it."""
        p, null = self.fit.p.copy(), effect.at_null()
        for name in effect.strength:
            p[self.rig.model.index(f"{effect.name}.{name}")] = null[name]
        return p


def final_fit(model: FittedModel, search: DiagnosisProblem, problem: DiagnosisProblem) -> FittedModel:
    """The result of a search at full rate; one at the noise with nuisance parameters within their physical bounds.

    A model that is not errs by more than the bounds that keep searches quick, and would be slow below them.
    """
    if not is_at_noise(model, search):
        return refit(model, problem)
    rig, near = replace(model.rig, channels=problem.rig.channels), model.refitted.get(problem.train, model)
    q = problem.likelihood_problem(rig)
    q = replace(q, low=physical_bounds(q.model, q.free, q.low))
    return fit_model(problem, model.effects, rig, q, near.p, level=model.fit.level)


def likely_noise(q: LikelihoodProblem, p: Array) -> Noise:
    """The process noise of maximum likelihood at fixed parameters.

    Raises:
        SolveError: the model cannot be simulated there.
    """
    _, levels = successive_halving(q, [(p, levels) for levels in noise_levels(q)])
    return Noise(q.measurement, q.groups, levels)


def with_information(model: FittedModel) -> RefinedModel:
    """A model as fitted by multi-step prediction errors, with the filter and the information there.

    Raises:
        SolveError: the model cannot be simulated there.
    """
    return RefinedModel(
        model.effects, model.rig, _point(model).as_fit(False), np.zeros(len(model.likelihood_problem.free))
    )


def refine(model: FittedModel, problem: DiagnosisProblem) -> RefinedModel:
    """Maximise the likelihood, starting from a fit by multi-step prediction errors.

    Likelihood with process noise predicts one sample ahead. Where a law's form is wrong it attributes the model error
    to process noise, and its parameters may predict windows far worse than the same law can: then the better
    predicting parameters are used, and the difference widens the intervals.
    """
    q, here = model.likelihood_problem, _point(model)
    led, shift = here.as_fit(False), np.zeros(len(model.likelihood_problem.free))
    with contextlib.suppress(SolveError):
        likely = maximise(here)
        loss = multistep_loss(q, likely.p, problem.window, model.fit.level)
        if loss <= (1.0 + problem.criteria.smallest_share) * model.fit.loss:
            return RefinedModel(model.effects, model.rig, likely, shift)
        shift = np.abs(likely.p - led.p)[list(q.free)]
    return RefinedModel(model.effects, model.rig, led, shift)


def _point(model: FittedModel) -> LikelihoodPoint:
    q = model.likelihood_problem
    here = LikelihoodPoint(q, model.p, likely_noise(q, model.p))
    here.fixed_gain_jacobian()
    return here
