"""The results of the stages before the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from optid.diagnosis.alternatives import Alternative
from optid.diagnosis.problem import DiagnosisProblem
from optid.diagnosis.refinement import RefinedModel
from optid.diagnosis.selection.path import SelectionPath
from optid.diagnosis.surrogate.search import Surrogate
from optid.diagnosis.testing import HoldoutTest
from optid.effects.description import Description


@dataclass(frozen=True, eq=False)
class SearchResult:
    """The results of the stages that see the training recordings alone.

    Attributes:
        problem: the training recordings; `search` has them at the rate of the search.
        path: path of the selection; `alternatives` are look-alikes in place of its effects.
        surrogate: description of a mismatch that the named effects do not explain.
        wide: whether the answer is the base with wider bounds.
    """

    problem: DiagnosisProblem
    search: DiagnosisProblem
    path: SelectionPath
    alternatives: Mapping[str, tuple[Alternative, ...]]
    surrogate: Surrogate | None
    wide: bool


@dataclass(frozen=True, eq=False)
class TestedResult(SearchResult):
    """Everything on which a verdict is based.

    Attributes:
        base, best: the original model, and the one that is the answer.
        test: test on the hold-out; `holdout` are its recordings' names.
        confirmed: path to the effects that the hold-out confirms, where it does not confirm all.
    """

    base: RefinedModel
    best: RefinedModel
    test: HoldoutTest
    holdout: tuple[str, ...]
    confirmed: SelectionPath | None = None

    @property
    def names(self) -> bool:
        """Whether the best model has effects of the catalogue or the user's, and no surrogate."""
        return bool(self.best.effects) and not any(isinstance(e, Description) for e in self.best.effects)

    @property
    def unconfirmed(self) -> tuple[str, ...]:
        """Effects of the best model that the hold-out does not confirm, where it confirms another."""
        level, tests = self.problem.criteria.level, self.test.names
        failed = tuple(e.name for e in self.best.effects if not tests[e.name].p_value <= level)
        return failed if self.names and len(failed) < len(self.best.effects) else ()
