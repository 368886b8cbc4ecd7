"""A fit with its predictions, and the profile of one of its parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from optid.core.model import Array
from optid.estimation.result import Estimate, Outcome
from optid.results.result import Result
from optid.results.with_rig import ResultWithRig
from optid.results.words import parameter_rows, score_rows, table

if TYPE_CHECKING:
    import pandas as pd


class FitResult(ResultWithRig):
    """Fitted parameters, how well they predict, and what the fit leaves open.

    `tables["prediction"]`: one row per sample: use ("training", "held out"), recording, time (s), and for each measured
    channel NAME, NAME_free_run and NAME_window, SI. `tables["nodes"]`: the fit's state at each node and whether it is
    sound. `tables["covariance"]`: of the fitted parameters, SI, in the order of `parameters`.
    `files["rig.toml"]`: the rig file with the fitted values.
    """

    FILE: ClassVar[str] = "fit.json"
    SCHEMA: ClassVar[str] = "optid.fit/1"

    @property
    def outcome(self) -> Outcome:
        """How the fit ended."""
        return Outcome[str(self.document["outcome"]).upper()]

    @property
    def parameters(self) -> dict[str, Estimate]:
        """Fitted parameters by name, SI."""
        return {name: self._estimate(name, entry) for name, entry in self.document["parameters"].items()}

    @property
    def values(self) -> dict[str, float]:
        """All parameters of the model by name, fitted and stated, SI."""
        return dict(self.document["values"])

    @property
    def covariance(self) -> Array:
        """Covariance of the fitted parameters in the order of `parameters`, SI, shape (parameters, parameters)."""
        return self.tables["covariance"].to_numpy(dtype=float)

    @property
    def process_noise(self) -> Array:
        """Standard deviation of each state's jump at a node, SI, shape (states,)."""
        return np.array(self.document["process_noise"], dtype=float)

    @property
    def train(self) -> Mapping[str, Mapping[str, Any]]:
        """Channel -> fit_percent, rmse, unit of the windows on the recordings fitted to."""
        return dict(self.document["train"])

    @property
    def holdout(self) -> Mapping[str, Mapping[str, Any]]:
        """Channel -> fit_percent, rmse, unit of the windows on the recordings held out; empty without any."""
        return dict(self.document["holdout"])

    @property
    def refuted(self) -> str:
        """Why the held-out recordings contradict the fit as a whole; empty where they do not."""
        missed = self.document.get("holdout_missed", ())
        return "; ".join(one["advice"] for one in missed if one["fit_percent"] < 0.0)

    def _estimate(self, name: str, entry: Mapping[str, Any]) -> Estimate:
        low, high = entry["ci95"]
        return Estimate(
            name,
            entry["unit"],
            entry["value"],
            -math.inf if low is None else low,
            math.inf if high is None else high,
            entry["start"],
            name in self.document["at_bound"],
            name not in self.document["not_identifiable"],
        )

    @property
    def marks(self) -> dict[str, str]:
        """Remarks on parameters that the data do not determine."""
        marks = dict.fromkeys(self.document["at_bound"], "at its bound")
        return marks | dict.fromkeys(self.document["not_identifiable"], "not identifiable")

    def summary(self) -> str:
        """How it ended, the fitted parameters, those that cannot be separated, and the scores.

        Returns
        -------
        str
            a few lines.
        """
        d = self.document
        asked = {name: entry for name, entry in d["parameters"].items() if name in d["asked"]}
        lines = [f"{self.outcome.value} ({d['seconds']:.1f} s)"]
        lines += table(("parameter", "value", "95 % interval", ""), parameter_rows(asked, self.marks))
        lines += [f"  {tie}" for tie in d["ties"]]
        lines += [f"  {one['words']}" for one in d["profiles"].values()]
        for use, scores in (("training", self.train), ("held out", self.holdout)):
            if scores:
                lines += table((f"{use}, {d['horizon']:g} s windows", "fit", "rmse"), score_rows(scores))
        told = [] if self.outcome.failed else [*d["missed"], *d.get("holdout_missed", ())]
        lines += [miss["advice"] for miss in told]
        return "\n".join(lines)

    def to_frame(self) -> pd.DataFrame:
        """One row per fitted parameter: unit, value, low, high, start (SI), at_bound, identifiable.

        Returns
        -------
        pd.DataFrame
            SI units, unless a column says otherwise.
        """
        import pandas as pd

        return pd.DataFrame([vars(e) for e in self.parameters.values()]).set_index("name")


class ProfileResult(Result):
    """Profile likelihood of one parameter.

    `tables["profile"]`: value (SI), deviance (how much worse it is than the best one), and the other fitted parameters
    along the valley.
    """

    FILE: ClassVar[str] = "profile.json"
    SCHEMA: ClassVar[str] = "optid.profile/1"

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the profile, SI; infinite where the data give no limit within the range of the profile."""
        low, high = self.document["ci95"]
        return (-math.inf if low is None else low, math.inf if high is None else high)

    def summary(self) -> str:
        """The interval of the profile, compared with the fit's own.

        Returns
        -------
        str
            a few lines.
        """
        return str(self.document["words"])

    def to_frame(self) -> pd.DataFrame:
        """The profile, one row per value.

        Returns
        -------
        pd.DataFrame
            SI units, unless a column says otherwise.
        """
        return self.tables["profile"].copy()
