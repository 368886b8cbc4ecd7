"""What the stages before the verdict left, handed on as one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from optid.diagnosis.alternatives import Alternative
from optid.diagnosis.problem import DiagnosisProblem
from optid.diagnosis.refinement import RefinedModel
from optid.diagnosis.selection import SelectionPath
from optid.diagnosis.surrogate.search import Surrogate
from optid.diagnosis.testing import HoldoutTest
from optid.effects.description import Description


@dataclass(frozen=True, eq=False)
class Stages:
    """Everything that a verdict rests on.

    Attributes:
        problem: the recordings to fit; `search` holds them at the rate of the search.
        path: how the selection went; `alternatives` are look-alikes in the place of its names.
        surrogate: what describes a mismatch that the names do not explain.
        base, best: the model as it came, and the one that stands for the answer.
        test: what the hold-out says; `holdout` are its recordings' names.
        wide: the best model is the base with wider bounds.
    """

    problem: DiagnosisProblem
    search: DiagnosisProblem
    path: SelectionPath
    alternatives: Mapping[str, tuple[Alternative, ...]]
    surrogate: Surrogate | None
    base: RefinedModel
    best: RefinedModel
    test: HoldoutTest
    holdout: tuple[str, ...]
    wide: bool

    @property
    def names(self) -> bool:
        """The best model holds effects of the catalogue or the user's, and nothing without a name."""
        return bool(self.best.effects) and not any(isinstance(e, Description) for e in self.best.effects)
