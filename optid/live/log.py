"""The recording of a session, complete on disk up to the last sample in any case."""

from __future__ import annotations

import contextlib
import math
import os
import re
import threading
from collections.abc import Sequence
from pathlib import Path

from optid.live.messages import Reply
from optid.live.settings import Wiring

PREDICTIONS = ("predicted", "simulated", "windowed")  # of the position, see `Reply`
NOTHING = Reply(0, *(math.nan,) * 6)
LOG = "recording.csv"
_PLAIN = re.compile(r"[\w .()/°%+*^-]*")
SYNC = 1.0  # s between two calls of fsync


class Log:
    """A CSV table that grows by whole rows, one system call each.

    A row is handed to the operating system before the next sample, so the death of any process loses none, and a full
    disk ends the table after a complete row. Once a second a thread calls fsync, as protection against loss of power.

    Args:
        path: file to write; must not exist.
        columns: its head.

    Raises:
        FileExistsError, OSError: it cannot be made.
    """

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_APPEND | getattr(os, "O_BINARY", 0)
        self._file = os.open(path, flags, 0o644)
        self._whole = 0
        self._append(",".join(_quoted(name) for name in columns) + "\n")
        # A year to the microsecond, then nine digits: more than any converter resolves.
        self._form = "%.14g" + ",%.9g" * (len(columns) - 1) + "\n"
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._sync, name="log", daemon=True)
        self._thread.start()

    def row(self, values: tuple[float, ...]) -> None:
        """Append one row, the time first; NaN becomes an empty cell."""
        text = self._form % values
        if "n" in text:  # nan, inf
            cells = text.rstrip("\n").split(",")
            text = ",".join("" if "n" in cell else cell for cell in cells) + "\n"
        self._append(text)

    def _append(self, text: str) -> None:
        """Append a line, completely or not at all.

        Raises:
            OSError: the disk is full, or fails; a partial line is removed.
        """
        data = text.encode()
        left = data
        try:
            while left:
                left = left[os.write(self._file, left) :]
        except OSError:
            os.ftruncate(self._file, self._whole)
            raise
        self._whole += len(data)

    def _sync(self) -> None:
        while not self._done.wait(SYNC):
            with contextlib.suppress(OSError):  # the next row reports it
                os.fsync(self._file)

    def close(self) -> None:
        """Write everything to the disk (fsync)."""
        self._done.set()
        self._thread.join()
        with contextlib.suppress(OSError):
            os.fsync(self._file)
        os.close(self._file)


def sweep(folder: Path) -> None:
    """Remove a session's log without rows, which would only prevent the next session."""
    path = folder / LOG
    with contextlib.suppress(OSError):
        with path.open("rb") as file:
            empty = not file.readline() or not file.read(1)
        if empty:
            path.unlink()


def _quoted(name: str) -> str:
    """A column's name, quoted so that no reader splits it."""
    return name if _PLAIN.fullmatch(name) else '"' + name.replace('"', '""') + '"'


class Layout:
    """The layout of a row: columns as the rig file maps them, so that every command can read the log.

    Reference and predictions beside them are in the unit of the position's column, unless the rig file maps a
    reference.
    """

    def __init__(self, wiring: Wiring) -> None:
        self._wiring, self._position = wiring, wiring.measured[0]
        self._reference = wiring.reference or self._position

    @property
    def columns(self) -> list[str]:
        """The log's head."""
        wiring, position = self._wiring, self._position.column
        own = [wiring.time.column, wiring.command.column, *(c.column for c in wiring.measured)]
        reference = wiring.reference.column if wiring.reference else "reference"
        names = [*own, reference, *(f"{position}_{kind}" for kind in PREDICTIONS)]
        names[0] = names[0] or "time"
        return [name if names.index(name) == i else f"{name}_live" for i, name in enumerate(names)]

    def row(
        self, time: float, standing: float, values: Sequence[float], reply: Reply | None
    ) -> tuple[float, ...]:
        """One row: s, V, the driver's readings, and the loop's reply."""
        wiring, position, reference = self._wiring, self._position, self._reference
        said = reply or NOTHING
        return (
            round(time, 6) / wiring.time.factor,
            wiring.put(standing),
            *values,
            (said.reference - reference.shift) / reference.factor,
            (said.predicted - position.shift) / position.factor,
            (said.simulated - position.shift) / position.factor,
            (said.windowed - position.shift) / position.factor,
        )
