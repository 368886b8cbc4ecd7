"""A model fitted to the recordings, and the errors of its windows."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

from optid.core.model import Array
from optid.core.recording import Recording
from optid.diagnosis.problem import DiagnosisProblem
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.estimation.fixed_gain import SETTLED
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.multistep import QUIET, MultistepFit, fit_multistep
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    from optid.diagnosis.validation import Validated


@dataclass(frozen=True, eq=False)
class FittedModel:
    """A rig's model with effects, its parameters fitted by multi-step prediction errors.

    Attributes:
        effects: beyond the rig file's.
        rig: with them.
        fit: parameters, and the quiet filter there.
        validated: its cross-validated errors, by the problem that they were asked for.
        refitted: the model refitted to a search's recordings at their full rate and accuracy, by these recordings.
    """

    effects: tuple[Effect, ...]
    rig: Rig
    fit: MultistepFit
    validated: dict[DiagnosisProblem, Validated] = field(default_factory=dict, init=False)
    refitted: dict[tuple[Recording, ...], FittedModel] = field(default_factory=dict, init=False)

    @property
    def likelihood_problem(self) -> LikelihoodProblem:
        """The problem to which it was fitted."""
        return self.fit.likelihood_problem

    @property
    def p(self) -> Array:
        """All parameters."""
        return self.fit.p

    @cached_property
    def values(self) -> dict[str, float]:
        """All parameters by name, SI."""
        names = (q.name for q in self.likelihood_problem.model.parameters)
        return dict(zip(names, self.p.tolist(), strict=True))

    def own_values(self, effect: Effect) -> dict[str, float]:
        """An effect's parameters by own name, SI."""
        return {q.name: self.values[f"{effect.name}.{q.name}"] for q in effect.parameters}


def fit_model(
    problem: DiagnosisProblem,
    effects: Sequence[Effect],
    rig: Rig,
    likelihood_problem: LikelihoodProblem,
    p: Array,
    *,
    short: bool = False,
    level: float = QUIET,
    begun: MultistepFit | None = None,
) -> FittedModel:
    """Fit over short windows first, if requested, and then over whole ones, on from a fit that was `begun`.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    o = problem.options
    if short:
        p = fit_multistep(likelihood_problem, p, o.short * problem.window, turns=2, steps=o.steps).p
    fit = fit_multistep(
        likelihood_problem, p, problem.window, turns=o.turns, steps=o.steps, level=level, begun=begun
    )
    return FittedModel(tuple(effects), rig, fit)


def alternate_horizons(model: FittedModel, problem: DiagnosisProblem) -> FittedModel:
    """The model after cycles of fits over short windows and then whole ones, while these lower the loss.

    Where an axis sticks, the loss of whole windows is rough, and a fit ends in one of many small minima; that of short
    windows has fewer.
    """
    for _ in range(problem.options.turns):
        if problem.budget.is_over:
            break
        before, q = model, model.likelihood_problem
        with contextlib.suppress(SolveError):
            again = fit_model(
                problem, model.effects, model.rig, q, model.p, short=True, level=model.fit.level
            )
            model = min(before, again, key=lambda one: one.fit.loss)
        if not model.fit.loss < (1.0 - SETTLED) * before.fit.loss:
            break
    return model


def refit(model: FittedModel, problem: DiagnosisProblem) -> FittedModel:
    """Refit the result of a search at the full rate and accuracy of the recordings; the model remembers it."""
    rig = replace(model.rig, channels=problem.rig.channels)
    q = problem.likelihood_problem(rig)
    before = model.likelihood_problem.problem
    if len(q.problem.time) == len(before.time) and q.problem.tolerance == before.tolerance:
        return model
    if problem.train not in model.refitted:
        model.refitted[problem.train] = fit_model(
            problem, model.effects, rig, q, model.p, level=model.fit.level
        )
    return model.refitted[problem.train]
