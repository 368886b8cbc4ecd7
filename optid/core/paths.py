"""Tests of a path that never raise: a name that is too long, or holds a null, is no file."""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path


def is_file(path: str | os.PathLike[str]) -> bool:
    """Whether it is a regular file."""
    with contextlib.suppress(OSError, ValueError):
        return Path(path).is_file()
    return False


def is_folder(path: str | os.PathLike[str]) -> bool:
    """Whether it is a folder."""
    with contextlib.suppress(OSError, ValueError):
        return Path(path).is_dir()
    return False


def digest_of(path: str | os.PathLike[str]) -> str | None:
    """SHA-256 of a regular file, hexadecimal; ``None`` of anything else: a device or a pipe may have no end."""
    if not is_file(path):
        return None
    with contextlib.suppress(OSError), Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
    return None


def from_here(path: Path) -> str:
    """As it is typed in the current folder: relative where it lies below."""
    here = Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)
