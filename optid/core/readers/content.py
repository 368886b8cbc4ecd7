"""A file's bytes: read completely, from a finite source, and unpacked within bounds."""

from __future__ import annotations

import difflib
import os
import stat
import zlib
from pathlib import Path

from optid.core.readers.limits import PIPE, Budget
from optid.errors import RecordingError


def file_bytes(path: Path) -> bytes:
    """The bytes of a file, or of a pipe of bounded length.

    Raises:
        RecordingError: absent, a directory, a device, empty, not readable.
    """
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            if stat.S_ISCHR(mode) or stat.S_ISBLK(mode):
                raise RecordingError("this is a device, not a file", where=path, expected="a file")
            data = file.read() if stat.S_ISREG(mode) else file.read(PIPE + 1)
    except FileNotFoundError:
        raise RecordingError("no such file", where=path, hint=_neighbour(path)) from None
    except IsADirectoryError:
        raise RecordingError("this is a directory", where=path, expected="a recording file") from None
    except PermissionError:
        # Windows reports a directory this way, too.
        message = "this is a directory" if path.is_dir() else "no permission to read it"
        raise RecordingError(message, where=path, expected="a readable file") from None
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise RecordingError(f"cannot be read ({error})", where=path) from None
    except MemoryError:
        raise RecordingError("the file is larger than the memory", where=path) from None
    if not stat.S_ISREG(mode) and len(data) > PIPE:
        raise RecordingError(f"the pipe holds more than {PIPE >> 20} MB", where=path, expected="a file")
    return data


def unzipped(data: bytes, budget: Budget, path: Path) -> bytes:
    """The content of a .gz file.

    Raises:
        RecordingError: truncated, damaged, or unpacking to more than it can hold.
    """
    if data[:2] != b"\x1f\x8b":
        raise RecordingError(
            "the name ends in .gz, but the content is not gzip data", where=path, expected="a .gz file"
        )
    try:
        return budget.inflate(data, "the gzip data", window=zlib.MAX_WBITS | 16)
    except zlib.error as error:
        raise RecordingError(
            f"the gzip data is truncated or damaged ({error})", where=path, expected="a complete .gz file"
        ) from None


def _neighbour(path: Path) -> str | None:
    try:
        near = sorted(entry.name for entry in path.parent.iterdir()) if path.parent.is_dir() else []
    except OSError:
        return None
    close = difflib.get_close_matches(path.name, near[:2000], n=1, cutoff=0.6)
    return f'did you mean "{close[0]}"?' if close else None
