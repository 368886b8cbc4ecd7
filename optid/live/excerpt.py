"""The last minutes of a session's recording as files of their own, for a diagnosis while the session goes on."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

from optid.core.paths import from_here
from optid.live.log import LOG

SECONDS = 120.0  # at most
HELD_OUT = 1 / 3  # of them, the last part
SEEN, UNSEEN = "last_minutes.csv", "last_minutes_holdout.csv"
WIDEST = 256  # bytes of a row, at most


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
        head, rows = last_rows(out / LOG, round(SECONDS * rate))
        at = round(len(rows) * (1 - HELD_OUT))
        for name, part in ((SEEN, rows[:at]), (UNSEEN, rows[at:])):
            beside = out / f".{name}.part"
            beside.write_bytes(b"\n".join((head, *part)) + b"\n")
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
    with path.open("rb") as file:
        head = file.readline().rstrip(b"\n")
        begin, end = file.tell(), file.seek(0, os.SEEK_END)
        start = max(begin, end - WIDEST * count)
        file.seek(start)
        rows = file.read(end - start).split(b"\n")
    rows.pop()  # nothing, or a row that is being written
    if start > begin:
        rows.pop(0)  # the end of one
    return head, rows[-count:]
