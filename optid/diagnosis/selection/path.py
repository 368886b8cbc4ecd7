"""The path of a selection: its steps, what each tried, and the models without each effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem
from optid.diagnosis.proposals import Proposals
from optid.diagnosis.validation import Validated, cross_validate
from optid.effects.effect import Effect


@dataclass(frozen=True, eq=False)
class Contender:
    """A model with one more effect, and why it was rejected; "" if it is acceptable."""

    effect: Effect
    model: FittedModel
    validated: Validated
    why: str


@dataclass(frozen=True, eq=False)
class Round:
    """One step: its model, the proposals, those fully fitted, and the one selected."""

    model: FittedModel
    proposals: Proposals
    contenders: tuple[Contender, ...]
    taken: Contender | None


@dataclass(frozen=True, eq=False)
class SelectionPath:
    """The path of the selection.

    Attributes:
        base, best: the original model, and the result of the selection.
        first, validated: their cross-validated errors.
        rounds: every step; `earlier` are those of a search at another rate from which this one goes on.
        without: effect name -> the best model without that effect, with its errors.
        dropped: (effect, why) of those made redundant by others.
        ended_early: the budget was used up before everything was tried.
    """

    base: FittedModel
    best: FittedModel
    first: Validated
    validated: Validated
    rounds: tuple[Round, ...]
    without: Mapping[str, tuple[FittedModel, Validated]] = field(default_factory=dict)
    dropped: tuple[tuple[Effect, str], ...] = ()
    ended_early: bool = False
    earlier: tuple[Round, ...] = ()

    @property
    def nearest(self) -> Contender | None:
        """The best contender, selected or not."""
        every = [one for step in self.rounds for one in step.contenders]
        return min(every, key=lambda one: one.validated.windows.sum(), default=None)

    @property
    def strongest(self) -> FittedModel | None:
        """The model of the best contender."""
        return None if self.nearest is None else self.nearest.model


def nothing_selected(base: FittedModel, problem: DiagnosisProblem) -> SelectionPath:
    """A path without steps."""
    first = cross_validate(base, problem)
    return SelectionPath(base, base, first, first, ())


def without_each(path: SelectionPath, answer: FittedModel) -> dict[str, FittedModel]:
    """The answer without each of its effects, by their names; the base for one that is not in the path."""
    if answer is path.best:
        return {name: model for name, (model, _) in path.without.items()}
    return {effect.name: path.base for effect in answer.effects}
