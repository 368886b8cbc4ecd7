"""The results of the stages before the verdict."""

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
    """Everything on which a verdict is based.

    Attributes:
        problem: the training recordings; `search` has them at the rate of the search.
        path: path of the selection; `alternatives` are look-alikes in place of its effects.
        surrogate: description of a mismatch that the named effects do not explain.
        base, best: the original model, and the one that is the answer.
        test: test on the hold-out; `holdout` are its recordings' names.
        wide: whether the best model is the base with wider bounds.
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
        """Whether the best model has effects of the catalogue or the user's, and no surrogate."""
        return bool(self.best.effects) and not any(isinstance(e, Description) for e in self.best.effects)
