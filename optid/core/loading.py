"""A user's own Python files: plants, effects, drivers."""

from __future__ import annotations

import importlib.util
import sys
import traceback
from pathlib import Path
from types import ModuleType

from optid.errors import RigError, nearest


def load_file(path: Path) -> ModuleType:
    """Run a user's Python file as a module of its own, afresh each time: it may have been edited.

    Raises:
        RigError: no such file, or it raises while it is imported.
    """
    if not path.is_file():
        what = "is a directory" if path.is_dir() else "does not exist"
        near = sorted(p.name for p in path.parent.glob("*.py")) if path.parent.is_dir() else []
        raise RigError(f'the file "{path}" {what}', hint=nearest(path.name, near) if near else None)
    key = f"optid_user_{abs(hash(path.resolve())):x}"
    spec = importlib.util.spec_from_file_location(key, path)
    if spec is None or spec.loader is None:
        raise RigError(f'the file "{path}" cannot be loaded', expected="a Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[key] = module  # dataclasses and type hints inside look their module up here
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[key]
        raise RigError(f'importing "{path}" raised {blame(error, path)}') from error
    return module


def blame(error: BaseException, path: Path) -> str:
    """What a user's code raised, and the last line of that code on the way: "NameError: ... (line 7)"."""
    if isinstance(error, SyntaxError) and error.lineno is not None:
        return f"SyntaxError: {error.msg} (line {error.lineno})"
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if Path(frame.filename) == path]
    return f"{type(error).__name__}: {error}" + (f" (line {lines[-1]})" if lines else "")
