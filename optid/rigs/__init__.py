"""The plants: built-in ones by name, a user's own from a Python file."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from optid.core.loading import load_file, named_file
from optid.errors import RigError, nearest

# Name in a rig file -> "module:function"; a module is imported when its plant is used.
BUILT_IN = {
    "servo-pneumatic": "optid.rigs.servo_pneumatic:servo_pneumatic",
    "emps": "optid.rigs.emps:emps",
    "rotary-axis": "optid.rigs.rotary_axis:rotary_axis",
    "servo-hydraulic": "optid.rigs.servo_hydraulic:servo_hydraulic",
    "cascaded-tanks": "optid.rigs.cascaded_tanks:cascaded_tanks",
}

Plant = Callable[..., None]


def find_plant(name: str, base: Path) -> Plant:
    """The plant function that a rig file names.

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
            f'no built-in plant "{name}"',
            expected='a built-in name or "path/to/file.py:function"',
            hint=nearest(name, BUILT_IN),
        )
    return _function(load_file(named_file(file, base)), function, name)


def _function(module: ModuleType, function: str, name: str) -> Plant:
    if not hasattr(module, function):
        own = [key for key, value in vars(module).items() if callable(value) and not key.startswith("_")]
        raise RigError(f'"{name}": the file has no function "{function}"', hint=nearest(function, own))
    plant = getattr(module, function)
    if not callable(plant) or isinstance(plant, type):
        raise RigError(
            f'"{name}": "{function}" is of type {type(plant).__name__}'
            if not isinstance(plant, type)
            else f'"{name}": "{function}" is a class',
            expected="a function plant(sheet, *, option=default)",
        )
    found: Plant = plant
    return found
