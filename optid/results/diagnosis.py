"""The result of a diagnosis, as in diagnosis.json."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from optid.core.quantity import typeset
from optid.diagnosis.answers import Verdict
from optid.results.with_rig import ResultWithRig
from optid.results.words import score_rows, table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["DiagnosisResult", "Finding", "Verdict"]


@dataclass(frozen=True)
class Finding:
    """One thing that is missing.

    Attributes
    ----------
    effect : str | None
        its name; ``None`` where nothing of the catalogue explains the mismatch.
    site : str
        "valve", "flow", "force", "sensor", or a site of the plant's own.
    parameters : Mapping[str, Any]
        name -> value, unit, ci95, SI.
    where : Mapping[str, Any]
        channels in which it is visible, intervals (recording, from, to; s) and ranges of the states.
    evidence : Mapping[str, Any]
        p_value and holdout_fit_gain of the test on the held-out recordings; delta_bic on the training recordings.
    indistinguishable_from : tuple[str, ...]
        names of effects that explain the recordings as well.
    suspected : tuple[tuple[str, str], ...]
        (effect, why): effects that it could be, and why they are not proven.
    sentence : str
        the finding in words.
    """

    effect: str | None
    site: str
    parameters: Mapping[str, Any]
    where: Mapping[str, Any]
    evidence: Mapping[str, Any]
    indistinguishable_from: tuple[str, ...]
    sentence: str
    suspected: tuple[tuple[str, str], ...] = ()


class DiagnosisResult(ResultWithRig):
    """Which physics the model leaves out, where, how certain it is, and its gain on held-out recordings.

    `tables["holdout"]`: one row per held-out sample: recording, time (s), and for each measured channel
    NAME, NAME_before and NAME_after: windows of the original model and of the improved one, SI. For finding k there
    may be `tables["map k"]` (mismatch over time), `tables["state k NAME"]` (over a signal) and `tables["signal k"]`
    (the missing signal, sample by sample, with the identified law). `tables["rivals"]`, one row per rival:
    round, effect, error_over_noise, loss and why. `files["rig.toml"]`: the improved rig file.
    """

    FILE: ClassVar[str] = "diagnosis.json"
    SCHEMA: ClassVar[str] = "optid.diagnosis/1"

    @property
    def verdict(self) -> Verdict:
        """The verdict."""
        return Verdict(self.document["verdict"])

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is missing, strongest first."""
        return tuple(
            Finding(
                f["effect"],
                f["site"],
                f["parameters"],
                f["where"],
                f["evidence"],
                tuple(f["indistinguishable_from"]),
                f.get("sentence", ""),
                tuple((one["effect"], one["why"]) for one in f.get("suspected", ())),
            )
            for f in self.document["findings"]
        )

    @property
    def baseline(self) -> Mapping[str, Any]:
        """Parameters and hold-out scores of the original model, fitted."""
        return dict(self.document["baseline"])

    @property
    def improved(self) -> Mapping[str, Any]:
        """The same for the model with the effects found."""
        return dict(self.document["improved"])

    def summary(self) -> str:
        """The verdict, its reasons, and the errors before and after on the held-out recordings.

        Returns
        -------
        str
            a few lines.
        """
        lines = [f"{self.verdict.value}: {typeset(self.document['summary'])}"]
        for title, part in (("held out, before", self.baseline), ("held out, after", self.improved)):
            if part["holdout"]:
                lines += table((title, "fit", "rmse"), score_rows(part["holdout"]))
        return "\n".join(lines)

    def to_frame(self) -> pd.DataFrame:
        """One row per parameter of a finding: effect, site, parameter, value, low, high, unit (SI), p_value.

        Returns
        -------
        pd.DataFrame
            SI units, unless a column says otherwise.
        """
        import pandas as pd

        rows = [
            (f.effect, f.site, name, q["value"], *q["ci95"], q["unit"], f.evidence.get("p_value"))
            for f in self.findings
            for name, q in (f.parameters or {"": {"value": None, "ci95": (None, None), "unit": ""}}).items()
        ]
        columns = ("effect", "site", "parameter", "value", "low", "high", "unit", "p_value")
        return pd.DataFrame(rows, columns=list(columns))
