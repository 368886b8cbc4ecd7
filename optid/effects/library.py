"""The catalogue: the effects that a plant's sites admit, by name, and a user's own from a file."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Callable, Iterable
from functools import lru_cache
from pathlib import Path
from types import ModuleType
from typing import Any

import casadi as ca

from optid.core.loading import load_file, named_file
from optid.core.model import Model
from optid.core.sheet import Sheet
from optid.effects import catalogue, generic
from optid.effects.ageing import Ageing
from optid.effects.anywhere import MARK, Anywhere
from optid.effects.curve import Curve, Scaling
from optid.effects.effect import Effect
from optid.effects.relaxation import Relaxation
from optid.effects.sized import sized
from optid.effects.sticking import Sticking
from optid.effects.wave import Wave
from optid.errors import PlantError, RigError, nearest

# Surrogates, from the places after the kind, as in "curve@SITE@SIGNAL".
DESCRIPTIONS: dict[str, Callable[..., Effect]] = {
    kind.kind: kind for kind in (Ageing, Curve, Scaling, Relaxation, Sticking, Wave)
}


@lru_cache(maxsize=1)
def built_in() -> dict[str, Effect]:
    """All effects of the catalogue by name, in alphabetical order of their files."""
    return {effect.name: effect for module in _modules(catalogue) for effect in _effects(module)}


@lru_cache(maxsize=1)
def anywhere() -> dict[str, type[Anywhere]]:
    """The effects that any site can carry, by kind."""
    return {
        kind.kind: kind
        for module in _modules(generic)
        for kind in _classes(module)
        if issubclass(kind, Anywhere)
    }


def _modules(package: ModuleType) -> list[ModuleType]:
    return [
        importlib.import_module(f"{package.__name__}.{i.name}")
        for i in pkgutil.iter_modules(package.__path__)
    ]


def _classes(module: ModuleType) -> list[type[Effect]]:
    own = [t for t in vars(module).values() if inspect.isclass(t) and t.__module__ == module.__name__]
    return [kind for kind in own if issubclass(kind, Effect)]


def _effects(module: ModuleType) -> list[Effect]:
    return [kind() for kind in _classes(module)]


def from_file(path: Path) -> tuple[Effect, ...]:
    """The effects a user's Python file defines.

    Raises:
        RigError: no such file, it raises while it is imported, or it defines none.
    """
    found = _effects(load_file(path))
    if not found:
        raise RigError(
            "no effect in this file", where=path, expected="classes derived from optid.effects.effect.Effect"
        )
    return tuple(found)


def find_effect(name: str, base: Path) -> Effect:
    """An effect by its name in a rig file: one of the catalogue, "kind@site", a description, or "path/to/file.py:name".

    Raises:
        RigError: there is none; names the nearest.
    """
    file, colon, own = name.rpartition(":")
    if not colon:
        kind, mark, place = name.partition(MARK)
        if kind in DESCRIPTIONS and place.count(MARK) in (1, 2 if kind == Curve.kind else 1):
            return DESCRIPTIONS[kind](*place.split(MARK))
        if mark and kind in anywhere():
            return anywhere()[kind](place)
        if mark:
            raise RigError(
                f'there is no effect "{kind}" for sites in general', hint=nearest(kind, anywhere())
            )
        if name not in built_in():
            raise RigError(f'no effect "{name}"', hint=nearest(name, built_in()))
        return built_in()[name]
    effects = {effect.name: effect for effect in from_file(named_file(file, base))}
    if own not in effects:
        raise RigError(f'"{file}" has no effect "{own}"', hint=nearest(own, effects))
    return effects[own]


def admitted(model: Model, own: Iterable[Effect] = ()) -> tuple[Effect, ...]:
    """The effects, built in and the user's `own`, which a model can take and does not have yet.

    The model must offer their sites, the signals that they need there and the plant's parameters that they use; its
    outputs must show the places that they depend on. Effects for any site are offered where no other effect acts and
    the signal is not zero.
    """
    return tuple(e for e in _possible(model, own) if model.unobservable.isdisjoint(e.places))


def untestable(model: Model, own: Iterable[Effect] = ()) -> tuple[Effect, ...]:
    """The effects that are not admitted because no output shows the place that they depend on."""
    return tuple(e for e in _possible(model, own) if not model.unobservable.isdisjoint(e.places))


def _possible(model: Model, own: Iterable[Effect]) -> tuple[Effect, ...]:
    every = {effect.name: sized(effect, model.axis) for effect in (*built_in().values(), *own)}
    sites = set(model.sites)
    fitting = [e for e in every.values() if sites.issuperset(e.sites) and _takes(model, e)]
    used = {site for effect in fitting for site in effect.sites}
    free = [
        (site, size) for site, size in zip(model.sites, model.sizes, strict=True) if size and site not in used
    ]
    fitting += [kind(site, size) for site, size in free for kind in anywhere().values() if kind.suits(site)]
    taken = set(model.effects)
    return tuple(e for e in fitting if e.name not in taken and taken.isdisjoint(e.excludes))


class _Probe(Sheet):
    """A sheet with the declarations of a frozen model, to test whether an effect finds what it needs."""

    def __init__(self, model: Model, effect: Effect) -> None:
        super().__init__(model.name, (effect,))
        self._axis = model.axis
        self._plants = {
            q.name.partition("[")[0] for q in model.parameters
        }  # a group's own parameter is the plant's too
        self._roles = {port.role for port in model.inputs}

    def plant_param(self, name: str) -> ca.SX:
        if name not in self._plants:
            raise PlantError(f'no parameter "{name}"', where=self.name)
        return ca.SX.sym(name)

    def past(self, role: str, samples: int) -> ca.SX:
        if role not in self._roles:
            raise PlantError(f'no input "{role}"', where=self.name)
        return ca.SX.sym(f"{role}@{samples}")


def _takes(model: Model, effect: Effect) -> bool:
    sheet = _Probe(model, effect)
    try:
        for site, near in zip(model.sites, model.near, strict=True):
            signals: dict[str, Any] = {name: ca.SX.sym(name) for name in near}
            sheet.site(site, ca.SX.sym("nominal"), **signals)
    except PlantError:
        return False
    return True
