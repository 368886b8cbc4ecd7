"""The result of checking recordings before any fit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from optid.core.quantity import quantity, typeset
from optid.results.result import Result

if TYPE_CHECKING:
    import pandas as pd


class CheckResult(Result):
    """The quality of recordings and the identifiability of the parameters.

    `tables["signals"]` holds the recordings: recording, time (s) and a column for each channel, SI.
    """

    FILE: ClassVar[str] = "check.json"
    SCHEMA: ClassVar[str] = "optid.check/1"

    @property
    def fit_for_identification(self) -> bool:
        """Whether no remark is an error and each parameter to fit has influence."""
        return "fit" in self.document["fit_for"]

    def summary(self) -> str:
        """Each recording with its remarks, the identifiability of the parameters, and what the data can be used for.

        Returns
        -------
        str
            a few lines.
        """
        lines = []
        for one in self.document["recordings"]:
            size = f"{one['samples']} samples, {one['duration']:.4g} s at {one['rate']:.5g} Hz"
            lines.append(f"{one['name']}: {size}, {', '.join(one['channels'])}")
            lines += [f"  {remark['severity']:8}{typeset(remark['message'])}" for remark in one["remarks"]]
            lines += [f"  {'note':8}{note}" for note in one["notes"]]
            lines += [f"  {'lag':8}{lag['words']}" for lag in one.get("lags", ())]
        return "\n".join([*lines, *self.identifiability, *self.detectability, str(self.document["summary"])])

    @property
    def identifiability(self) -> list[str]:
        """The identifiability of the parameters, as lines; none where it was not computed."""
        told = self.document["identifiability"]
        if told is None:
            return []
        known = f"rank {told['rank']} of {told['parameters']}"
        if told["condition"] is not None:
            known += f", condition number of the sensitivities {told['condition']:.2g}"
        head = f"identifiability of {told['parameters']} parameters at the rig file's values, before any fit:"
        idle = told["without_influence"]
        missing = [f"  no influence on the data: {', '.join(idle)}; a fit would be refused"] if idle else []
        return [head, f"  {known}", *missing, *(f"  {sentence}" for sentence in told["sentences"])]

    @property
    def detectability(self) -> list[str]:
        """The sizes from which effects are visible and distinguishable, as lines; none where they were not computed."""
        told = self.document.get("detectability")
        if told is None:
            return []
        head = (
            "smallest detectable sizes at the rig file's values (effect: visible from; distinguishable from "
            "others from):"
        )
        return [head, *(f"  {_detectable(one)}" for one in told)]

    def to_frame(self) -> pd.DataFrame:
        """One row per remark: recording, severity, channel, kind, message, from and to (s).

        Returns
        -------
        pd.DataFrame
            SI units, unless a column says otherwise.
        """
        import pandas as pd

        columns = ("recording", "severity", "channel", "kind", "message", "from", "to")
        rows = [
            (
                one["name"],
                r["severity"],
                r["channel"],
                r["kind"],
                r["message"],
                *(r["interval"] or (None, None)),
            )
            for one in self.document["recordings"]
            for r in one["remarks"]
        ]
        return pd.DataFrame(rows, columns=list(columns))


def _detectable(one: Mapping[str, Any]) -> str:
    shows, told = (_sizes(one[name]) for name in ("shows_from", "told_from"))
    if not shows:
        return f"{one['effect']}: not at any size"
    alike = f"; similar effects: {', '.join(one['alike'])}" if one["alike"] else ""
    return f"{one['effect']}: {shows}; {told or 'not at any size'}{alike}"


def _sizes(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {quantity(one['value'], one['unit'])}" for name, one in values.items())
