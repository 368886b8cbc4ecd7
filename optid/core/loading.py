"""A user's own Python files: plants, effects, drivers. They are programs: running a rig file runs them."""

from __future__ import annotations

import hashlib
import importlib.abc
import importlib.machinery
import importlib.util
import os
import sys
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from optid.core.document import read_bounded
from optid.core.resultset import located
from optid.errors import RigError, nearest

MOST = 4 * 2**20  # bytes of a file: nobody writes a longer program
LONGEST = 200  # signs of a path that a message holds
OUTSIDE = "--outside-files"
_PREFIX = "optid_user_"
# A session's processes read the rig file again: the permission passes to them in the environment.
_VARIABLE = "OPTID_OUTSIDE_FILES"


@dataclass(frozen=True)
class Loaded:
    """A file as it was run."""

    path: Path
    content: bytes

    @property
    def digest(self) -> str:
        """SHA-256, hexadecimal."""
        return hashlib.sha256(self.content).hexdigest()


_LOADED: dict[str, Loaded] = {}  # by the name of their module
_ALLOWED: ContextVar[bool] = ContextVar("outside", default=False)


def loaded() -> tuple[Loaded, ...]:
    """The files that were run so far."""
    return tuple(_LOADED.values())


def loaded_from(thing: object) -> Loaded | None:
    """The file that a function, or the class of an object, comes from; ``None`` if it is not from a user's file."""
    module = getattr(thing, "__module__", None) or type(thing).__module__
    return _LOADED.get(module)


@contextmanager
def outside_allowed() -> Iterator[None]:
    """Let rig files name Python files that lie outside their folders."""
    token, before = _ALLOWED.set(True), os.environ.get(_VARIABLE)
    os.environ[_VARIABLE] = "1"
    try:
        yield
    finally:
        _ALLOWED.reset(token)
        os.environ.pop(_VARIABLE)
        if before is not None:
            os.environ[_VARIABLE] = before


def named_file(file: str, folder: Path) -> Path:
    """The Python file that a rig file in a folder names.

    Raises:
        RigError: it lies outside that folder, and that was not allowed.
    """
    path = folder / file
    try:
        inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError) as error:
        raise RigError(f'"{file}" is not a path ({error})') from None
    if not (inside or _ALLOWED.get() or os.environ.get(_VARIABLE) == "1"):
        raise RigError(
            f'"{file}" lies outside the folder of the rig file, and a Python file is a program that would be run',
            expected="a file in that folder or below",
            hint=f"copy it there, or allow it with {OUTSIDE}",
        )
    return path


def load_file(path: Path) -> ModuleType:
    """Run a user's Python file as a separate module, again each time: it may have been edited.

    Raises:
        RigError: no such file, or it raises while it is imported.
    """
    try:
        there = path.is_file() or located(path).is_file()
    except OSError as error:  # a name that no file can have
        shown = str(path) if len(str(path)) <= LONGEST else f"...{str(path)[-LONGEST:]}"
        raise RigError(f'"{shown}" is not a path ({error.strerror})', expected="a Python file") from None
    if not there:
        what = "is a directory" if path.is_dir() else "does not exist"
        near = sorted(p.name for p in path.parent.glob("*.py")) if path.parent.is_dir() else []
        raise RigError(f'the file "{path}" {what}', hint=nearest(path.name, near) if near else None)
    try:
        content = read_bounded(located(path), MOST)
    except (OSError, ValueError) as error:
        raise RigError(f'the file "{path}" cannot be read ({error})', expected="a Python file") from None
    key = f"{_PREFIX}{hashlib.sha256(os.fsencode(path.resolve())).hexdigest()[:16]}"
    loader = _Source(path, content)
    module = importlib.util.module_from_spec(importlib.machinery.ModuleSpec(key, loader, origin=str(path)))
    module.__file__ = str(path.resolve())  # lets a file find modules beside it
    sys.modules[key] = module  # dataclasses and type hints inside look their module up here
    try:
        loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[key]
        raise RigError(f'importing "{path}" raised {blame(error, path)}') from error
    _LOADED[key] = Loaded(path.resolve(), content)
    return module


class _Source(importlib.abc.SourceLoader):
    """Runs the text that was read once, so that the digest is of what ran."""

    def __init__(self, path: Path, content: bytes) -> None:
        self._path, self._content = path, content

    def get_filename(self, fullname: str) -> str:
        """Where its lines are, for tracebacks."""
        return str(self._path)

    def get_data(self, path: str | bytes) -> bytes:
        """Its text; compiled files beside it are not used."""
        if path != str(self._path):
            raise OSError(path)
        return self._content


def blame(error: BaseException, path: Path) -> str:
    """The exception that a user's code raised, and the last line of that code: "NameError: ... (line 7)"."""
    if isinstance(error, SyntaxError) and error.lineno is not None:
        return f"SyntaxError: {error.msg} (line {error.lineno})"
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if Path(frame.filename) == path]
    return f"{type(error).__name__}: {error}" + (f" (line {lines[-1]})" if lines else "")
