"""The next experiment, in the form of plan.json."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from optid.core.quantity import plain
from optid.results.result import Result
from optid.results.words import table

if TYPE_CHECKING:
    import pandas as pd

EXPERIMENT = "experiment.csv"


class PlanResult(Result):
    """A reference that distinguishes rival effects, and how well it does.

    `tables["experiment"]`: time (s), reference, position (m) and command, as the rig's model predicts them.
    `files["experiment.csv"]`: the same as the rig file maps recordings.
    """

    FILE: ClassVar[str] = "plan.json"
    SCHEMA: ClassVar[str] = "optid.plan/1"
    FILES: ClassVar[tuple[str, ...]] = (EXPERIMENT,)

    def summary(self) -> str:
        """The pieces of the reference, and each pair of rivals with its separation.

        Returns
        -------
        str
            a few lines.
        """
        d = self.document
        head = f"{d['seconds']:g} s at {d['rate']:g} Hz: {'; '.join(piece['name'] for piece in d['pieces'])}"
        rows = [
            (
                row["there"],
                row["instead"] or "nothing",
                f"{row['sd']:.2f}",
                f"{row['sd_plain_steps']:.2f}",
                "no length" if row["seconds_needed"] is None else plain(row["seconds_needed"]),
            )
            for row in d["pairs"]
        ]
        lines = table(("there", "mistaken for", "sd", "by plain steps", "seconds needed"), rows)
        said = "sd: between the two, the first at the smallest size worth a name; "
        said += f"{d['needed_sd']:g} give one error in a hundred"
        return "\n".join([head, *lines, said])

    def to_frame(self) -> pd.DataFrame:
        """One row per pair of rivals: there, instead, sd, sd_plain_steps, seconds_needed.

        Returns
        -------
        pd.DataFrame
            SI units, unless a column says otherwise.
        """
        import pandas as pd

        return pd.DataFrame(self.document["pairs"])
