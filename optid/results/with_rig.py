"""Results that contain a rig file with new values, usable as input."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from optid.core.loading import outside_allowed
from optid.results.result import Result
from optid.rigs.rigfile import Rig, rig_of_text, write_rig

RIG = "rig.toml"


class ResultWithRig(Result):
    """A result with `files["rig.toml"]`.

    In a folder copies of the user's own plant and effect files lie beside it, so that the folder stands alone.
    """

    FILES: ClassVar[tuple[str, ...]] = (RIG,)

    @property
    def rig(self) -> Rig:
        """The rig with the result's values."""
        if self.home is not None:
            return rig_of_text(self.files[RIG], self.home / RIG)
        with outside_allowed():  # what was run here before
            return rig_of_text(self.files[RIG], Path(self.document["about"]["rig_file"]))

    def write(self, place: Path) -> None:
        """All files of the result.

        Parameters
        ----------
        place : Path
            an existing folder.
        """
        super().write(place)
        if RIG in self.files:
            write_rig(self.rig, place / RIG)
