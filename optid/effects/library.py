"""The catalogue: every effect that a plant's sites admit, by name; a user's own from a file."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path

from optid.core.loading import load_file
from optid.core.model import Model
from optid.effects import catalogue
from optid.effects.effect import Effect
from optid.errors import RigError, nearest


@lru_cache(maxsize=1)
def built_in() -> dict[str, Effect]:
    """All effects of the catalogue by name, in alphabetical order of their files."""
    found: dict[str, Effect] = {}
    for info in pkgutil.iter_modules(catalogue.__path__):
        module = importlib.import_module(f"{catalogue.__name__}.{info.name}")
        for effect in _effects(vars(module).values(), module.__name__):
            found[effect.name] = effect
    return found


def _effects(things: Iterable[object], module: str) -> list[Effect]:
    own = [t for t in things if inspect.isclass(t) and issubclass(t, Effect) and t.__module__ == module]
    return [kind() for kind in own if kind is not Effect]


def from_file(path: Path) -> tuple[Effect, ...]:
    """The effects a user's Python file defines.

    Raises:
        RigError: no such file, it raises while it is imported, or it defines none.
    """
    module = load_file(path)
    found = _effects(vars(module).values(), module.__name__)
    if not found:
        raise RigError(
            "no effect in this file", where=path, expected="classes derived from optid.effects.effect.Effect"
        )
    return tuple(found)


def find_effect(name: str, base: Path) -> Effect:
    """An effect by its name in a rig file: one of the catalogue, or "path/to/file.py:name".

    Raises:
        RigError: there is none; names the nearest.
    """
    file, colon, own = name.rpartition(":")
    if not colon:
        if name not in built_in():
            raise RigError(f'no effect "{name}"', hint=nearest(name, built_in()))
        return built_in()[name]
    effects = {effect.name: effect for effect in from_file(base / file)}
    if own not in effects:
        raise RigError(f'"{file}" has no effect "{own}"', hint=nearest(own, effects))
    return effects[own]


def admitted(model: Model, own: Iterable[Effect] = ()) -> tuple[Effect, ...]:
    """The effects, built in and the user's `own`, whose sites a model offers and which it does not have yet."""
    every = {effect.name: effect for effect in (*built_in().values(), *own)}
    sites = set(model.sites)
    return tuple(e for e in every.values() if sites.issuperset(e.sites) and e.name not in model.effects)
