"""Results that hold a rig file: with new values, usable as input."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Self

from optid.results.result import Result
from optid.rigs.rigfile import Rig, rig_of_text, rig_text

RIG = "rig.toml"


class ResultWithRig(Result):
    """A result with `files["rig.toml"]`, in which a plant's own file is named by its whole path.

    In a folder it is named relative to that, so that both can be moved together.
    """

    FILES: ClassVar[tuple[str, ...]] = (RIG,)

    @property
    def rig(self) -> Rig:
        """The rig with the result's values."""
        return rig_of_text(self.files[RIG], Path(self.document["about"]["rig_file"]))

    def write(self, place: Path) -> None:
        """All files of the result."""
        super().write(place)
        (place / RIG).write_bytes(rig_text(self.rig, place, where=place / RIG).encode("utf-8"))

    @classmethod
    def read(cls, place: Path, document: Mapping[str, Any]) -> Self:
        """The result in a folder whose document is read already."""
        found = super().read(place, document)
        if RIG not in found.files:
            return found
        whole = rig_text(rig_of_text(found.files[RIG], place / RIG), None)
        return cls(document, found.tables, {**found.files, RIG: whole})
