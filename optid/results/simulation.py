"""A simulation along recordings."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from optid.core.quantity import quantity
from optid.results.result import Result
from optid.results.words import score_rows, table

if TYPE_CHECKING:
    import pandas as pd

KINDS = ("window", "free_run")
NOT_CHANNELS = ("schema", "version", "command", "inputs", "about", "files")  # of metrics.json


class SimulationResult(Result):
    """How well a rig's model predicts recordings.

    `tables["prediction"]`: one row per sample: recording, time (s), and for each measured channel NAME (as recorded),
    NAME_free_run and NAME_window, SI; with a fit's uncertainty NAME_free_run_low and so on, the 95 % band that the
    parameters' covariance gives, measurement noise not counted. `tables["inputs"]` holds the inputs.
    """

    FILE: ClassVar[str] = "metrics.json"
    SCHEMA: ClassVar[str] = "optid.simulation/1"

    @property
    def metrics(self) -> Mapping[str, Mapping[str, Mapping[str, Any]]]:
        """Channel -> "window" or "free_run" -> fit_percent, rmse, unit."""
        return {name: entry for name, entry in self.document.items() if name not in NOT_CHANNELS}

    def summary(self) -> str:
        """Fit and error of both kinds of prediction.

        Returns
        -------
        str
            a few lines.
        """
        horizon, lines = self.document["about"]["horizon"], []
        for kind, words in (("window", f"{horizon:g} s windows"), ("free_run", "free run")):
            scores = {role: kinds[kind] for role, kinds in self.metrics.items()}
            lines += table((words, "fit", "rmse"), score_rows(scores))
        for start in self.document["about"]["starts"]:
            where = ", ".join(
                f"{name.replace('_', ' ')} {quantity(value, start['units'][name])}"
                for name, value in start["state"].items()
            )
            lines.append(f"  free run from {start['time']:.6g} s, start estimated: {where}")
        lines += [f"  {note}" for note in self.document["about"]["notes"]]
        return "\n".join(lines)

    def to_frame(self) -> pd.DataFrame:
        """The prediction, one row per sample.

        Returns
        -------
        pd.DataFrame
            SI units, unless a column says otherwise.
        """
        return self.tables["prediction"].copy()

    def write(self, place: Path) -> None:
        """Also write prediction.csv, without the recording's name where there is only one.

        Parameters
        ----------
        place : Path
            an existing folder.
        """
        super().write(place)
        frame = self.tables["prediction"]
        alone = len(set(frame["recording"])) == 1
        (frame.drop(columns="recording") if alone else frame).to_csv(place / "prediction.csv", index=False)

    @property
    def written(self) -> tuple[str, ...]:
        """Names of the files that `write` leaves."""
        return ("prediction.csv", *super().written)
