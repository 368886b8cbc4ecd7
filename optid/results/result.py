"""The form that all results share: a document, tables and files, in memory as in a folder."""

from __future__ import annotations

import copy
import html
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from optid.core import resultset
from optid.core.document import read_bounded
from optid.results.tables import TABLES, read_tables, same_tables, write_tables
from optid.results.validity import parts
from optid.results.views import view_of

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes

REPORT = "report.html"
MOST = 64 * 2**20  # bytes of a file beside the document
FACTS = ("version", "command", "inputs")  # of the document that the folder's manifest repeats


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """The result of a job; data only.

    Two results are equal if all of their data are. Subclasses name their parts.

    Attributes
    ----------
    document : Mapping[str, Any]
        content of the result's JSON file, SI units.
    tables : Mapping[str, pd.DataFrame]
        tables too long for the document, by name: SI units, one row per sample, node or value.
    files : Mapping[str, str]
        other text files of the job by name, such as a fitted rig file.
    home : Path | None
        folder that it was read from; ``None`` for one that was made here. No part of its data.
    """

    FILE: ClassVar[str]
    SCHEMA: ClassVar[str]
    FILES: ClassVar[tuple[str, ...]] = ()  # that may lie beside the document, the report apart

    document: Mapping[str, Any]
    tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    files: Mapping[str, str] = field(default_factory=dict)
    home: Path | None = None

    def summary(self) -> str:
        """The result in a few lines of text, as the command line prints it."""
        raise NotImplementedError

    def to_frame(self) -> pd.DataFrame:
        """The result's main table."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """The content of the result's JSON file, the caller's own copy.

        Returns
        -------
        dict[str, Any]
            a copy of the document.
        """
        return copy.deepcopy(dict(self.document))

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the result with matplotlib.

        Parameters
        ----------
        axes : Axes | None
            to draw on; those of a new figure when absent.

        Returns
        -------
        Axes
            The axes.
        """
        drawn: Axes = view_of(self.SCHEMA).plot(self, axes)
        return drawn

    def report(self) -> str:
        """A self-contained HTML page with zoomable figures.

        Returns
        -------
        str
            the page.
        """
        if REPORT in self.files:
            return self.files[REPORT]
        page: str = view_of(self.SCHEMA).page(self)
        return page

    def save(self, folder: str | Path) -> Path:
        """Write everything into a folder, completely or not at all; `optid.load` reads it back.

        Parameters
        ----------
        folder : str | Path
            made if absent.

        Returns
        -------
        Path
            The folder.

        Raises
        ------
        OSError
            the folder cannot be written; its content is as before.
        """
        place = Path(folder)
        place.mkdir(parents=True, exist_ok=True)
        staged = resultset.staging(place)
        try:
            self.write(staged)
            facts = {name: self.document[name] for name in FACTS if name in self.document}
            resultset.commit(place, staged, facts)
        except BaseException:
            shutil.rmtree(staged, ignore_errors=True)
            raise
        return place

    def write(self, place: Path) -> None:
        """Write all files into a folder that exists: the document, the tables, other files and the report.

        Parameters
        ----------
        place : Path
            an existing folder.
        """
        text = json.dumps(self.document, indent=1, ensure_ascii=False, allow_nan=False)
        (place / self.FILE).write_text(text + "\n", encoding="utf-8")
        write_tables(place / TABLES, self.tables)
        for name, content in self.files.items():
            (place / name).write_bytes(content.encode("utf-8"))
        if REPORT not in self.files:
            (place / REPORT).write_text(self.report(), encoding="utf-8")

    @property
    def written(self) -> tuple[str, ...]:
        """Names of the files that `write` leaves."""
        return (self.FILE, *(name for name in self.files if name != REPORT), REPORT)

    @classmethod
    def read(cls, place: Path, document: Mapping[str, Any]) -> Self:
        """The result in a folder whose document is read already.

        Parameters
        ----------
        place : Path
            the folder it lies in.
        document : Mapping[str, Any]
            the content of its JSON file.
        """
        found = {name: resultset.located(place / name) for name in cls.FILES}
        files = {
            name: read_bounded(path, MOST).decode("utf-8") for name, path in found.items() if path.is_file()
        }
        tables = parts(read_tables(resultset.located(place / TABLES)), place / TABLES)
        return cls(document, tables, files, place)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Result) or type(self) is not type(other):
            return NotImplemented
        return (
            dict(self.document) == dict(other.document)
            and dict(self.files) == dict(other.files)
            and same_tables(self.tables, other.tables)
        )

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        first, *rest = self.summary().splitlines()
        return f"<{type(self).__name__}: {first}{' …' if rest else ''}>"

    def _repr_html_(self) -> str:
        """For notebooks: the summary and the plot."""
        from optid.results.picture import svg

        return f"<pre>{html.escape(self.summary())}</pre>{svg(self.plot().get_figure(root=True))}"
