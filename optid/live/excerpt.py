"""The last minutes of a session's recording as files of their own, for a diagnosis while the session goes on."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import BinaryIO

from optid.core.paths import from_here
from optid.live.log import LOG

SECONDS = 120.0  # at most
HELD_OUT = 1 / 3  # of them, the last part
SEEN, UNSEEN = "last_minutes.csv", "last_minutes_holdout.csv"
BLOCK = 1 << 16  # bytes in memory at a time


def offer_diagnosis(rig: Path, out: Path, rate: float) -> str:
    """Write the last minutes in two parts, and the command that finds out what the model lacks.

    Args:
        rig: the rig file.
        out: the session's folder.
        rate: Hz.

    Returns:
        The command, or why there is none.
    """
    try:
        with (out / LOG).open("rb") as log:
            head, first, end, rows = _last_whole_rows(log, round(SECONDS * rate))
            middle, _ = _rows_before(log, first, end, round(rows * HELD_OUT))
            for name, part in ((SEEN, (first, middle)), (UNSEEN, (middle, end))):
                beside = out / f".{name}.part"
                with beside.open("wb") as file:
                    file.write(head)
                    _copy(log, part, file)
                beside.replace(out / name)
    except OSError as error:
        return f"the last minutes could not be written: {error}"
    return shlex.join(
        [
            "optid",
            "diagnose",
            from_here(rig),
            from_here(out / SEEN),
            "--holdout",
            from_here(out / UNSEEN),
            "--out",
            from_here(out / "diagnosis"),
        ]
    )


def last_rows(path: Path, count: int) -> tuple[bytes, list[bytes]]:
    """The head and the last whole rows of a log that may still be growing; reads no more than they take."""
    with path.open("rb") as log:
        head, first, end, _ = _last_whole_rows(log, count)
        log.seek(first)
        rows = log.read(end - first).split(b"\n")
    return head.rstrip(b"\n"), rows[:-1]


def _last_whole_rows(log: BinaryIO, count: int) -> tuple[bytes, int, int, int]:
    """The head, where the last whole rows begin and end, and how many they are."""
    log.seek(0)
    head = log.readline()
    begin = log.tell()
    end, _ = _rows_before(log, begin, log.seek(0, os.SEEK_END), 0)  # behind it a row may be being written
    first, rows = _rows_before(log, begin, end, count)
    return head, first, end, rows


def _rows_before(log: BinaryIO, begin: int, end: int, count: int) -> tuple[int, int]:
    """Where the last so many rows before `end` begin, not before `begin`; and how many they are."""
    left, at = count + 1, end  # line ends, that of the row before them included
    while at > begin:
        size = min(BLOCK, at - begin)
        log.seek(at - size)
        block = log.read(size)
        found = block.count(b"\n")
        if found >= left:
            place = size
            for _ in range(left):
                place = block.rfind(b"\n", 0, place)
            return at - size + place + 1, count
        left, at = left - found, at - size
    return begin, count + 1 - left


def _copy(log: BinaryIO, part: tuple[int, int], file: BinaryIO) -> None:
    at, end = part
    log.seek(at)
    while at < end:
        at += file.write(log.read(min(BLOCK, end - at)))
