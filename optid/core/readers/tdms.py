"""NI TDMS, the format of LabVIEW and DIAdem."""

from __future__ import annotations

import io
import logging
from collections import Counter
from pathlib import Path

from optid.core.readers.table import EXTRA, Table, tabulate
from optid.errors import RecordingError


def read(data: bytes, path: Path) -> Table:
    """Every channel of a TDMS file, named by its channel, or "group/channel" where two groups share the name.

    Raises:
        RecordingError: truncated or damaged, no channels, or npTDMS is not installed.
    """
    try:
        import nptdms
    except ImportError:
        raise RecordingError("TDMS files need npTDMS", where=path, hint=EXTRA) from None
    _quiet()
    try:
        file = nptdms.TdmsFile.read(io.BytesIO(data))
        channels = [
            (group.name, channel.name, channel[:]) for group in file.groups() for channel in group.channels()
        ]
        incomplete = getattr(file.file_status, "incomplete_final_segment", False)
    except Exception as error:  # npTDMS raises whatever the damaged bytes lead it to
        reason = " ".join(f"{type(error).__name__} {error}".split())[:120]
        raise RecordingError(
            f"the TDMS data is truncated or damaged ({reason})", where=path, expected="a complete file"
        ) from None
    if incomplete:
        raise RecordingError("the TDMS data ends in the middle", where=path, expected="a complete file")
    times = Counter(name for _, name, _ in channels)
    vectors = {
        (name if times[name] == 1 else f"{group}/{name}"): values
        for group, name, values in channels
        if len(values)
    }
    return tabulate(vectors, path, "tdms")


def _quiet() -> None:
    """Keep npTDMS from writing its own warnings to the terminal: what matters of them is raised above."""
    for name in list(logging.root.manager.loggerDict):
        if name.startswith("nptdms."):
            logging.getLogger(name).setLevel(logging.ERROR)
