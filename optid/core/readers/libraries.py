"""Optional libraries of readers: one that is missing or broken is reported in one line."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

from optid.core.readers.table import EXTRA
from optid.errors import RecordingError


def library(name: str, package: str, needed: str, path: Path) -> Any:
    """The module of a library that only some formats need.

    Args:
        name: of the module.
        package: as it is installed.
        needed: what needs it, "TDMS files".
        path: of the recording, for messages.

    Raises:
        RecordingError: it is not installed, or raises while it is imported.
    """
    try:
        return importlib.import_module(name)
    except Exception as error:  # one built for another NumPy raises ValueError, AttributeError and others
        absent = isinstance(error, ModuleNotFoundError)
        why = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        broken = "" if absent else f" (it is installed but cannot be imported: {why})"
        raise RecordingError(f"{needed} need {package}{broken}", where=path, hint=EXTRA) from None
