"""The result of a fleet: its rows and their statistics."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from optid.errors import InputError
from optid.results.result import REPORT, Result
from optid.results.tables import TABLES, read_tables, write_tables
from optid.results.views import view_of

if TYPE_CHECKING:
    import pandas as pd

ROWS = "fleet.parquet"
SHOWN = 20  # failed rows that a summary lists


class FleetResult(Result):
    """Rows finished, rigs that changed, rigs that differ from their siblings, and what siblings share.

    `tables["rows"]` holds a row per rig and run, `tables["nights"]` p-values by rig and night, `tables["trends"]` every
    quantity's slope and change-point, `tables["measures"]` what the rows measured, `tables["t"]` rigs against
    quantities on the last night.
    """

    FILE: ClassVar[str] = "fleet.json"
    SCHEMA: ClassVar[str] = "optid.fleet/1"

    @property
    def failed(self) -> list[dict[str, str]]:
        """Rows that ended without a result: name, outcome, and last message."""
        return list(self.document["failed"])

    @property
    def told(self) -> list[dict[str, Any]]:
        """Rigs reported as changed: rig, first date, quantity, way ("grows" or "falls"), t, p_rig, q."""
        return list(self.document["told"])

    def summary(self) -> str:
        """The outcomes of the rows, and the rigs that changed.

        Returns
        -------
        str
            a few lines.
        """
        d = self.document
        counts = (
            ", ".join(f"{count} {outcome}" for outcome, count in d["outcomes"].items()) or "none finished"
        )
        lines = [f"{d['rows']} rows of {d['rigs']} rigs: {counts}"]
        lines += [f"  {one['name']}: {one['outcome']}: {one['said']}" for one in self.failed[:SHOWN]]
        if len(self.failed) > SHOWN:
            lines.append(f"  and {len(self.failed) - SHOWN} more")
        if "nights" in self.tables:
            share = f"at most {100 * d['level']:g} % of the rigs reported are expected to be false alarms"
            lines.append(f"{len(self.told)} of {d['rigs']} rigs changed ({share})")
            lines += [f"  {sentence}" for sentence in d["sentences"]]
        for one in d["unlike"][:SHOWN]:
            lines.append(
                f"  {one['rig']}: {one['quantity'].replace('_', ' ')} is {one['value']:.4g}, "
                f"siblings have {one['usual']:.4g} (q = {one['q']:.2g})"
            )
        return "\n".join(lines)

    def to_frame(self) -> pd.DataFrame:
        """One row per rig and run, as in `fleet.parquet`.

        Returns
        -------
        pd.DataFrame
            name, rig, date, job, outcome, verdict, effects and more of each.
        """
        import pandas as pd

        return self.tables.get("rows", pd.DataFrame()).copy()

    def write(self, place: Path) -> None:
        """Write the document, `fleet.parquet`, the other tables and the report into a folder that exists.

        Parameters
        ----------
        place : Path
            the folder.
        """
        text = json.dumps(self.document, indent=1, ensure_ascii=False, allow_nan=False)
        (place / self.FILE).write_text(text + "\n", encoding="utf-8")
        _to_parquet(self.to_frame(), place / ROWS)
        write_tables(place / TABLES, {name: one for name, one in self.tables.items() if name != "rows"})
        view_of(self.SCHEMA).write_library(place)
        (place / REPORT).write_text(self.report(), encoding="utf-8")

    @property
    def written(self) -> tuple[str, ...]:
        """Names of the files that `write` leaves."""
        return (self.FILE, ROWS, REPORT)

    @classmethod
    def read(cls, place: Path, document: Mapping[str, Any]) -> Self:
        """The result in a folder whose document is read already.

        Parameters
        ----------
        place : Path
            the folder.
        document : Mapping[str, Any]
            its `fleet.json`.

        Returns
        -------
        FleetResult
            equal to the one that was written.
        """
        import pandas as pd

        tables = read_tables(place / TABLES)
        if (place / ROWS).is_file():
            try:
                rows = pd.read_parquet(place / ROWS)
            except ImportError:
                raise
            except Exception as error:  # pyarrow's own exceptions and others on damaged bytes
                why = " ".join(f"{error}".split())[:120]
                raise InputError(
                    f"cannot be read ({why})", where=place / ROWS, expected="rows of a fleet"
                ) from None
            tables |= {} if rows.empty else {"rows": rows}
        return cls(document, tables, {}, place)


def _to_parquet(rows: pd.DataFrame, path: Path) -> None:
    try:
        rows.to_parquet(path, index=False)
    except ImportError:
        raise InputError(
            "Parquet needs the package pyarrow", where=path, hint='pip install "optid[fleet]"'
        ) from None
