"""The plants: built-in ones by name, a user's own from a Python file."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from optid.errors import RigError, nearest

# Name in a rig file -> "module:function"; a module is imported when its plant is asked for.
BUILT_IN = {
    "servo-pneumatic": "optid.rigs.servo_pneumatic:servo_pneumatic",
    "emps": "optid.rigs.emps:emps",
    "cascaded-tanks": "optid.rigs.cascaded_tanks:cascaded_tanks",
}

Plant = Callable[..., None]


def find_plant(name: str, base: Path) -> Plant:
    """The plant function a rig file names.

    Args:
        name: a built-in plant, or "path/to/file.py:function".
        base: folder that a relative path starts from: the rig file's own.

    Raises:
        RigError: no such plant, file or function, or the file raises while it is imported. The caller
            names the rig file.
    """
    if name in BUILT_IN:
        module, function = BUILT_IN[name].split(":")
        return _function(importlib.import_module(module), function, name)
    file, colon, function = name.rpartition(":")
    if not colon or not file.endswith(".py"):
        raise RigError(
            f'no built-in plant "{name}"', expected='a built-in name or "path/to/file.py:function"',
            hint=nearest(name, BUILT_IN),
        )  # fmt: skip
    return _function(_load(base / file), function, name)


def _function(module: ModuleType, function: str, name: str) -> Plant:
    if not hasattr(module, function):
        own = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
        raise RigError(f'"{name}": the file has no function "{function}"', hint=nearest(function, own))
    plant = getattr(module, function)
    if not callable(plant) or isinstance(plant, type):
        raise RigError(
            f'"{name}": "{function}" is of type {type(plant).__name__}' if not isinstance(plant, type) else
            f'"{name}": "{function}" is a class',
            expected="a function plant(sheet, *, option=default)",
        )  # fmt: skip
    found: Plant = plant
    return found


def _load(path: Path) -> ModuleType:
    """Run a user's file as a module of its own, afresh each time: it may have been edited."""
    if not path.is_file():
        what = "is a directory" if path.is_dir() else "does not exist"
        near = sorted(p.name for p in path.parent.glob("*.py")) if path.parent.is_dir() else []
        raise RigError(f'the plant\'s file "{path}" {what}', hint=nearest(path.name, near) if near else None)
    key = f"optid_plant_{abs(hash(path.resolve())):x}"
    spec = importlib.util.spec_from_file_location(key, path)
    if spec is None or spec.loader is None:
        raise RigError(f'the plant\'s file "{path}" cannot be loaded', expected="a Python file")
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
