"""A rig back into text with new values, keeping its comments, units and layout."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from optid.core.loading import outside_allowed
from optid.core.model import Model
from optid.core.units import GAUGE, conversion, split
from optid.effects.effect import Effect
from optid.errors import RigError, nearest
from optid.rigs.carried import carried, effect_files, plant_file
from optid.rigs.reading import parse
from optid.rigs.rig import ATMOSPHERE, Rig, by_name, default_of, with_effects


def rig_text(
    rig: Rig,
    parameters: Mapping[str, float] | None = None,
    own: Mapping[str, Mapping[str, float]] | None = None,
) -> str:
    """The text of a rig file with new values, for its own folder; nothing is written.

    Parameters
    ----------
    rig : Rig
        as read.
    parameters : Mapping[str, float] | None
        as in `write_rig`.
    own : Mapping[str, Mapping[str, float]] | None
        own values of recordings: file -> name -> SI value, for `[recordings]`.

    Raises
    ------
    RigError
        an unknown name, or a value outside its bounds.
    """
    new = dict(parameters or {})
    with outside_allowed():  # the user's own effects were run already, wherever they are
        if rig.plain is None:
            return rewritten(rig, rig.path, None, new)
        known = len(rig.plain.effects)
        plain = with_effects(rig.plain, rig.effects[known:])
        shared = {name: value for name, value in new.items() if name in by_name(plain.model)}
        return _with_recordings(rewritten(plain, rig.path, None, shared), plain.model, own or {})


def rewritten(rig: Rig, path: Path, folder: Path | None, new: Mapping[str, float]) -> str:
    """The text with new values, with paths relative to a folder; without one to its own, and nothing is copied."""
    import tomlkit

    for name in new:
        if name not in by_name(rig.model):
            raise RigError(f'unknown parameter "{name}"', where=path, hint=nearest(name, by_name(rig.model)))
    document = tomlkit.parse(rig.source)
    keys = _carry(rig, document, folder)
    plant: Any = document.setdefault("parameters", tomlkit.table())
    values = {**rig.parameters, **new}
    air = values.get(ATMOSPHERE, default_of(rig.model, ATMOSPHERE))
    known = by_name(rig.model)
    stated = dict(rig.parameters)
    for effect in (
        rig.effects
    ):  # those that the file does not have yet are written completely, in the order in which they act
        if not _key_of(effect, document):
            _table_of(f"{effect.name}.", rig, document, plant, keys)
            for name in effect.qualified(effect.at_null()):
                values.setdefault(name, float(known[name].default or 0.0))
                stated.pop(name, None)
    for name, value in values.items():
        table, own = _table_of(name, rig, document, plant, keys), name.rpartition(".")[2]
        old = table.get(own)
        # A gauge value is relative to the atmospheric pressure, so it is rewritten when that changes.
        gauge = ATMOSPHERE in new and isinstance(old, str) and old.rstrip().endswith(GAUGE)
        if value != stated.get(name) or gauge:
            table[own] = _written(float(value), old, known[name].unit, air)
    _rewrite_gauge_bounds(document, rig, air)
    _write_inputs(document, rig)
    written = tomlkit.dumps(document)
    again = parse(
        written, path, constrained=False
    )  # a fit may have ended at contradictory values: they are kept all the same
    for name, value in values.items():
        if abs(again.parameters[name] - value) > max(
            1e-12 * abs(value), 1e-300
        ):  # subnormals have no twelve digits
            raise RigError(
                f"{value!r} cannot be written so that it reads back", where=path, field=f"parameters.{name}"
            )
    return written


def _write_inputs(document: Any, rig: Rig) -> None:
    """Write which inputs are linear between their samples."""
    for role, channel in rig.channels.items():
        if channel.linear:
            document["channels"][role]["between"] = "linear"


def _with_recordings(source: str, model: Model, own: Mapping[str, Mapping[str, float]]) -> str:
    """The text with the recordings' own values of parameters, SI, by file and name."""
    import tomlkit

    document, known = tomlkit.parse(source), by_name(model)
    every: Any = document.setdefault("recordings", tomlkit.table(is_super_table=True))
    for file, values in own.items():
        entry = every.setdefault(file, tomlkit.table())
        for name, value in values.items():
            entry[name] = _written(value, entry.get(name), known[name].unit, None)
    return tomlkit.dumps(document)


def _carry(rig: Rig, document: Any, folder: Path | None) -> dict[str, str]:
    """Rewrite the paths of the user's own files relative to the new folder; returns the keys of such effects."""
    plant, own = plant_file(rig.model_name, rig.path.parent), effect_files(rig.effects)
    if folder is None:
        return {name: f"{file.path.as_posix()}:{name}" for name, file in own.items()}
    names = carried([*([plant] if plant else []), *own.values()], folder)
    if plant is not None:
        document["model"] = f"{names[plant.path]}:{rig.model_name.rpartition(':')[2]}"
    keys = {name: f"{names[file.path]}:{name}" for name, file in own.items()}
    table: Any = document.get("effects", {})
    for effect in rig.effects:
        old, new = _key_of(effect, document), keys.get(effect.name)
        if old is not None and new is not None and old != new:
            table.add(new, table.pop(old))
    return keys


def _key_of(effect: Effect, document: Any) -> str | None:
    """The effect's key in `[effects]`: its name, or its file with its name."""
    table = document.get("effects", {})
    return next((key for key in table if key == effect.name or key.endswith(f":{effect.name}")), None)


def _table_of(name: str, rig: Rig, document: Any, plant: Any, keys: Mapping[str, str]) -> Any:
    """The `[effects.NAME]` table of a parameter, created if absent; or the plant's table."""
    import tomlkit

    for effect in rig.effects:
        if name.startswith(f"{effect.name}."):
            every: Any = document.setdefault("effects", tomlkit.table(is_super_table=True))
            key = _key_of(effect, document) or keys.get(effect.name, effect.name)
            return every.setdefault(key, tomlkit.table())
    return plant


def _written(value: float, old: object, unit: str, air: float | None) -> float | str:
    """An SI value in the unit of the old entry."""
    if old is None or not isinstance(old, str):
        return value if unit == "1" else f"{value!r} {unit}"
    _, own = split(old, unit)
    number = conversion(own, unit, atmospheric=air).text(value)
    # What follows the number in the old entry, blanks included, stays.
    return number + re.sub(r"^\s*[-+\d.]+(?:[eE][-+]?\d+)?", "", old)


def _rewrite_gauge_bounds(document: Any, rig: Rig, air: float | None) -> None:
    """Keep the absolute bounds of `[fit]` where they are gauge pressures and the atmospheric pressure changed."""
    before = rig.parameters.get(ATMOSPHERE, default_of(rig.model, ATMOSPHERE))
    if before == air:
        return
    freed = {entry.name: entry for entry in rig.freed}
    for name, entry in document.get("fit", {}).items():
        for i, bound in enumerate((freed[name].low, freed[name].high)):
            old = entry["bounds"][i]
            if isinstance(old, str) and old.rstrip().endswith(GAUGE):
                entry["bounds"][i] = _written(bound, old, "Pa", air)
