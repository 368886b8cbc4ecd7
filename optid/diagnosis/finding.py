"""What a diagnosis answers: its verdict, what it found, and everything that led there."""

from __future__ import annotations

import enum
from dataclasses import dataclass

from optid.core.recording import Array
from optid.diagnosis.candidate import Candidate, Data
from optid.diagnosis.disturbance import Located
from optid.diagnosis.judge import Comparison
from optid.diagnosis.residuals import Residuals
from optid.diagnosis.search import Search
from optid.diagnosis.where import Region
from optid.effects.effect import Effect
from optid.estimation.result import Estimate


class Verdict(enum.Enum):
    """What a diagnosis says; the value is the word in its file."""

    CONSISTENT = "consistent"
    PARAMETERS = "parameters"
    MISSING_PHYSICS = "missing-physics"
    UNEXPLAINED = "unexplained"


@dataclass(frozen=True, eq=False)
class Finding:
    """One thing that is missing.

    Attributes:
        effect: its effect; ``None`` where nothing of the catalogue explains the mismatch.
        site: its kind of site; `place` the plant's own name of it.
        parameters: of the effect, with intervals, by own name.
        region: when and where.
        shown: signals worth telling.
        evidence: on the hold-out, of the likeliest model against that without it; its gain in fit is the result's.
        train_gain: fall of -2 log likelihood on the training recordings, likewise of the likeliest.
        delta_bic: that fall less what its parameters cost.
        indistinguishable: names of effects that explain the recordings as well.
        sentence: what an engineer would say.
        signal: the unknown signal at the site, where it was estimated on the model as it came.
        law: what the named effects make of that site's signal, (samples,).
    """

    effect: Effect | None
    site: str
    place: str
    parameters: tuple[Estimate, ...]
    region: Region
    shown: tuple[str, ...]
    evidence: Comparison
    train_gain: float
    delta_bic: float
    indistinguishable: tuple[str, ...]
    sentence: str
    signal: Located | None = None
    law: Array | None = None


@dataclass(frozen=True)
class Closest:
    """Names that fell short: effects, the share of the squared error that they clear, and the share needed."""

    effects: tuple[str, ...]
    cleared: float
    needed: float

    def __str__(self) -> str:
        """As a reason against them."""
        return f"clears {100 * self.cleared:.0f} % of the squared error, where {100 * self.needed:.0f} % are needed"


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """All that was found.

    Attributes:
        verdict, summary: the answer.
        base, best: the fitted model as it came, and improved.
        base_parameters, best_parameters: with intervals.
        findings: strongest first.
        rejected: (effect, why).
        not_testable: (effect, why, smallest size that would show).
        noise: role -> sd of the measurement, SI.
        residuals: tests of what remains on the hold-out.
        search: how it went.
        data: what it was given.
        closest: what came closest to explaining what is unexplained.
    """

    verdict: Verdict
    summary: str
    base: Candidate
    best: Candidate
    base_parameters: tuple[Estimate, ...]
    best_parameters: tuple[Estimate, ...]
    findings: tuple[Finding, ...]
    rejected: tuple[tuple[str, str], ...]
    not_testable: tuple[tuple[str, str, str], ...]
    noise: dict[str, float]
    residuals: Residuals
    search: Search
    data: Data
    closest: Closest | None
