"""A forward step: the catalogue is ranked, the nearest are fitted in full, and the best acceptable one is selected."""

from __future__ import annotations

import contextlib
import math
from functools import partial

from optid.core.model import Array
from optid.core.threads import parallel_map
from optid.diagnosis.fitted import FittedModel, alternate_horizons, fit_model
from optid.diagnosis.problem import DiagnosisProblem, Stage
from optid.diagnosis.proposals import Proposal, Proposals, propose
from optid.diagnosis.selection.path import Contender, Round
from optid.diagnosis.validation import Validated, cross_validate, rejection_reason
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.errors import SolveError
from optid.estimation.multistep import QUIET, MultistepFit, fit_multistep


def forward_step(
    current: FittedModel,
    first: Validated,
    before: Validated,
    problem: DiagnosisProblem,
    begin: Array | None = None,
    below: float = math.inf,
) -> Round:
    """A step from the current model, or of its proposals from other parameters, those with a loss `below` a bound."""
    effects = admitted(current.rig.model, problem.own)
    near = before.error_over_noise <= problem.criteria.error_over_noise
    # A linear step and the model's own quiet filter are reliable only for a model at the noise.
    # A quarter of the smallest gain in the error is half of it in the loss, which is quadratic in the error.
    promise, level = (problem.criteria.smallest_gain / 2.0, current.fit.level) if near else (None, QUIET)
    proposals = propose(current, effects, problem, promise, level, begin)
    few = worth_fitting(proposals, near, bool(current.effects), problem)
    few = [each for each in few if each.loss < below]
    problem.report(Stage.SELECTION, f"fitting {', '.join(one.effect.name for one in few)}")
    fits = parallel_map(partial(fit_proposal, current, problem), few)
    fitted = [(one.effect, model) for one, model in zip(few, fits, strict=True) if model is not None]
    least = min((model.fit.loss for _, model in fitted), default=0.0)

    def converged_contender(pair: tuple[Effect, FittedModel]) -> Contender | None:
        effect, model = pair
        if model.fit.loss <= problem.options.near * least:
            model = alternate_horizons(model, problem)
        return _validated_contender(current, first, before, problem, len(effects), effect, model)

    contenders = sorted(
        (one for one in parallel_map(converged_contender, fitted) if one is not None),
        key=lambda one: (bool(one.why), one.validated.windows.sum()),
    )
    taken = next((one for one in contenders if not one.why), None)
    return Round(current, proposals, tuple(contenders), taken)


def worth_fitting(found: Proposals, near: bool, named: bool, problem: DiagnosisProblem) -> list[Proposal]:
    """Proposals to fit fully, depending on whether the model is at the noise and already has an effect."""
    o, least = problem.options, min((one.loss for one in found.ranked), default=0.0)
    few = [one for one in found.ranked[: o.contenders] if one.loss <= o.near * least]
    if not near:
        return few
    # A loss is quadratic in the error: a candidate with half the smallest gain here does not reach it in a full fit.
    # Without any effect the first is fitted anyway, as the test asks whether it gains anything.
    most = (1.0 - problem.criteria.smallest_gain) * found.alone
    return [one for k, one in enumerate(few) if one.loss <= most or (k == 0 and not named)]


def contend(
    current: FittedModel,
    first: Validated,
    before: Validated,
    problem: DiagnosisProblem,
    tried: int,
    one: Proposal,
    begun: MultistepFit | None = None,
) -> Contender | None:
    """A proposal fully fitted, from where it was `begun`, and validated; ``None`` where the simulation diverges."""
    model = fit_proposal(current, problem, one, begun)
    return (
        None
        if model is None
        else _validated_contender(current, first, before, problem, tried, one.effect, model)
    )


def _validated_contender(
    current: FittedModel,
    first: Validated,
    before: Validated,
    problem: DiagnosisProblem,
    tried: int,
    effect: Effect,
    model: FittedModel,
) -> Contender | None:
    """A fitted model with another effect, validated; ``None`` where the simulation diverges."""
    with contextlib.suppress(SolveError):
        validated = cross_validate(model, problem)
        size = effect.size(model.own_values(effect))
        alone = not current.effects
        why = rejection_reason(size, first, before, validated, problem.criteria, tried, alone)
        return Contender(effect, model, validated, why)
    return None


def fit_proposal(
    current: FittedModel, problem: DiagnosisProblem, one: Proposal, begun: MultistepFit | None = None
) -> FittedModel | None:
    """A proposal fully fitted, from where it was `begun`; ``None`` where the simulation diverges."""
    begun = begin_proposal(current, problem, one) if begun is None else begun
    if begun is None:
        return None
    effects, q = (*current.effects, one.effect), one.likelihood_problem
    return fit_model(problem, effects, q.rig, q, begun.p, begun=begun)


def begin_proposal(current: FittedModel, problem: DiagnosisProblem, one: Proposal) -> MultistepFit | None:
    """The proposal after one iteration; ``None`` where the simulation diverges."""
    q, steps, level = one.likelihood_problem, problem.options.steps, current.fit.level
    with contextlib.suppress(SolveError):
        return fit_multistep(q, one.p, problem.window, turns=1, steps=steps, level=level, most=1)
    return None
