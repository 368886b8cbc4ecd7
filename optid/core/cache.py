"""The cache that optid keeps between runs: below XDG_CACHE_HOME, verified when read, and optional."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import tempfile
import threading
from collections.abc import Callable
from functools import cache
from pathlib import Path

import platformdirs

MOST = 4000  # models kept, some tens of kilobytes each; half of them are deleted when there are more

_IMPORT = re.compile(r"^\s*from (optid[\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)
_NAME = re.compile(r"\w+")
_TELL: list[Callable[[], None]] = []
_TOLD = threading.Lock()


def cache_folder() -> Path | None:
    """The cache folder; ``None`` where the user's folder is unknown."""
    stated = os.environ.get("XDG_CACHE_HOME", "")
    if stated and Path(stated).is_absolute():  # the standard says to ignore a relative path
        return Path(stated) / "optid"
    try:
        usual = Path(platformdirs.user_cache_dir("optid"))  # older ones take a relative place
        return usual if usual.is_absolute() else Path.home() / ".cache" / "optid"
    except (OSError, RuntimeError, KeyError):  # no home folder and no entry in the user database
        return None


def kernels_folder() -> Path | None:
    """The folder of machine code."""
    home = cache_folder()
    return None if home is None else home / "kernels"


@cache
def sources(file: str) -> str:
    """Digest of a source file of optid and of all of optid that it imports, directly or not.

    What the code of a file produced is named after this, so that a change elsewhere does not invalidate it.
    """
    digest, seen, left = hashlib.sha256(), set(), [Path(file).resolve()]
    while left:
        if (source := left.pop()) in seen:
            continue
        seen.add(source)
        left += _imported(source)
    for source in sorted(seen):
        digest.update(hashlib.sha256(source.read_bytes()).digest())
    return digest.hexdigest()[:16]


def _imported(source: Path) -> list[Path]:
    """The files of optid that a source file imports."""
    root = Path(__file__).parents[2]
    lines = _IMPORT.findall(source.read_text(encoding="utf-8"))
    places = []
    for module, names in lines:
        base = root.joinpath(*module.split("."))
        places += [base.with_suffix(".py"), base / "__init__.py"]
        places += [base / f"{name}.py" for name in _NAME.findall(names)]
    return [place for place in places if place.is_file()]


def stored(key: str, make: Callable[[], bytes]) -> bytes:
    """The stored result of `make` for this key; `make` is called when there is none.

    A damaged file is replaced, and a folder that cannot be written is not used.
    """
    folder = kernels_folder()
    if folder is None:
        return make()
    place = folder / "models" / hashlib.sha256(key.encode()).hexdigest()
    held = checked(place)
    if held is None:
        held = make()
        keep(place, held)
    return held


def checked(place: Path) -> bytes | None:
    """The content stored at a path; ``None`` where there is none or it is damaged."""
    with contextlib.suppress(OSError):
        digest, held = (whole := place.read_bytes())[:32], whole[32:]
        if held and hashlib.sha256(held).digest() == digest:
            return held
    return None


def keep(place: Path, held: bytes) -> None:
    """Store it with its checksum, completely or not at all; do nothing where that is impossible."""
    with contextlib.suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        _thin(place.parent)
        file = tempfile.NamedTemporaryFile(dir=place.parent, suffix=".part", delete=False)  # noqa: SIM115
        try:
            with file:
                file.write(hashlib.sha256(held).digest() + held)
            Path(file.name).replace(place)
        except OSError:
            Path(file.name).unlink(missing_ok=True)  # the disk is full


def _thin(folder: Path) -> None:
    """Delete the older half if there are too many files."""
    files = list(folder.iterdir())
    if len(files) > MOST:
        for file in sorted(files, key=lambda one: one.stat().st_mtime)[: len(files) // 2]:
            file.unlink(missing_ok=True)


def first_compile(tell: Callable[[], None]) -> None:
    """Register a function that is called once if optid's own functions must still be compiled for this machine."""
    _TELL[:] = [tell]


def compiling() -> None:
    """Report, once, that a function is about to be compiled."""
    with _TOLD:
        tell = _TELL.pop() if _TELL else None
    if tell is not None:
        tell()
