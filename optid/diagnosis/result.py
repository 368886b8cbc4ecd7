"""The result of a diagnosis: its verdict, its findings, and everything that led to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from optid.core.model import Array
from optid.diagnosis.alternatives import Alternative
from optid.diagnosis.answers import Verdict
from optid.diagnosis.localisation.region import Region
from optid.diagnosis.localisation.unknown_input import UnknownInput
from optid.diagnosis.problem import DiagnosisProblem
from optid.diagnosis.refinement import RefinedModel
from optid.diagnosis.selection.path import SelectionPath
from optid.diagnosis.testing import Evidence, HoldoutTest
from optid.effects.effect import Effect
from optid.estimation.result import Estimate

__all__ = ["Diagnosis", "Finding", "Suspicion", "Verdict"]


@dataclass(frozen=True)
class Suspicion:
    """An effect that may be missing, and why that is not proven."""

    effect: str
    why: str


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that is missing.

    Attributes:
        effect: the effect; ``None`` where none is proven.
        site: its kind of site; `place` is the plant's name of it.
        parameters: of the effect, with intervals, by own name.
        region: when and where it acts.
        shown: signals worth reporting.
        evidence: on the hold-out, against the model without it.
        train_gain: cross-validated gain of windows of the training recordings: half a mean square in variances each.
        delta_bic: twice that minus the penalty of its parameters (Schwarz).
        indistinguishable: names of effects that explain the recordings as well.
        sentence: the finding in words.
        suspected: effects that it could be, where nothing is proven.
        signal: the unknown input at the site, where it was estimated.
        law: change of that site's signal by the named effects, (samples,).
    """

    effect: Effect | None
    site: str
    place: str
    parameters: tuple[Estimate, ...]
    region: Region
    shown: tuple[str, ...]
    evidence: Evidence
    train_gain: float
    delta_bic: float
    indistinguishable: tuple[str, ...]
    sentence: str
    suspected: tuple[Suspicion, ...] = ()
    signal: UnknownInput | None = None
    law: Array | None = None


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The complete result of a diagnosis.

    Attributes:
        verdict, summary: the answer.
        base, best: the original model, fitted, and the improved one.
        base_parameters, best_parameters: with intervals.
        findings: strongest first.
        rejected: (effect, why).
        not_testable: (effect, why, smallest size that would show).
        test: on the hold-out.
        path: of the selection.
        alternatives: named effect -> look-alikes in its place.
        problem: its input.
        holdout: names of the recordings held out.
        noise: role -> sd of the measurement, SI.
    """

    verdict: Verdict
    summary: str
    base: RefinedModel
    best: RefinedModel
    base_parameters: tuple[Estimate, ...]
    best_parameters: tuple[Estimate, ...]
    findings: tuple[Finding, ...]
    rejected: tuple[tuple[str, str], ...]
    not_testable: tuple[tuple[str, str, str], ...]
    test: HoldoutTest
    path: SelectionPath
    alternatives: Mapping[str, tuple[Alternative, ...]]
    problem: DiagnosisProblem
    holdout: tuple[str, ...]
    noise: Mapping[str, float] = field(default_factory=dict)
