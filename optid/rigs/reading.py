"""The text of a rig file into a rig: names, units, bounds and effects are checked field by field."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from optid.core.document import parsed_toml
from optid.core.model import Model
from optid.core.parameter import Parameter
from optid.core.units import shown, to_si
from optid.effects.effect import Effect
from optid.effects.library import find_effect
from optid.effects.sized import sized
from optid.errors import RigError
from optid.rigs.channels import read_channels
from optid.rigs.constraints import refuse_contradictions
from optid.rigs.fields import Table, known_keys, span, subtable, text
from optid.rigs.rig import ATMOSPHERE, Freed, Rig, by_name, default_of, model_of

TABLES = ("name", "model", "options", "parameters", "fit", "channels", "recordings", "effects", "live")
_MISTYPED = 0.85  # similarity of a tag to a parameter's name from which it counts as a typing error
_ON_BOUND = 1e-9  # relative: a fitted value at its bound may miss it by rounding when written as text


def parse(source: str, path: Path, *, constrained: bool = True) -> Rig:
    """A rig from the text of its file; `constrained`: values that contradict each other are refused.

    Raises:
        RigError: it is not TOML, or an entry is not valid.
    """
    try:
        document = parsed_toml(source)
    except ValueError as error:
        raise RigError(f"not valid TOML: {error}", where=path) from None
    known_keys(document, TABLES, path)
    model_name = text(document, "model", path, "model", 'a plant such as model = "servo-pneumatic"')
    name = text(document, "name", path, "name", "a text") if "name" in document else path.stem
    options = subtable(document, "options", path, "options", "a table of the plant's options")
    stated = subtable(document, "effects", path, "effects", "a table for each effect")
    effects = _effects(stated, path)
    model = model_of(model_name, options, (), path)
    if effects:
        effects = tuple(sized(effect, model.axis) for effect in effects)
        model = model_of(model_name, options, effects, path)
    parameters = _parameters(subtable(document, "parameters", path, "parameters", "a table"), model, path)
    for effect in effects:
        parameters |= _effect_parameters(effect, stated, parameters, path)
    if constrained:
        refuse_contradictions(model, parameters, path)
    air = parameters.get(ATMOSPHERE, default_of(model, ATMOSPHERE))
    freed = _freed(subtable(document, "fit", path, "fit", "a table"), model, parameters, path)
    channels = read_channels(
        subtable(document, "channels", path, "channels", "a table of roles"), model, air, path
    )
    own = _recordings(
        subtable(document, "recordings", path, "recordings", "a table of files"), model, air, path
    )
    for file, entry in own.items() if constrained else ():
        values = {name: value for name, value in entry.items() if isinstance(value, float)}
        refuse_contradictions(model, {**parameters, **values}, path, f"recordings.{file}")
    return Rig(
        name, model_name, dict(options), effects, model, parameters, freed, channels, path, source, own
    )


def _recordings(table: Table, model: Model, air: float | None, path: Path) -> dict[str, dict[str, Any]]:
    """Tags of each file, as text, and values of its own parameters, SI."""
    known, found = by_name(model), {}
    for file in table:
        entry = subtable(table, file, path, f"recordings.{file}", "tags and parameters of that file")
        found[file] = {
            key: _own_value(known, key, value, air, path, f"recordings.{file}.{key}")
            for key, value in entry.items()
        }
    return found


def _own_value(
    known: Mapping[str, Parameter], key: str, value: object, air: float | None, path: Path, at: str
) -> str | float:
    """A tag, as text, or a parameter's value, SI."""
    if key not in known:
        if meant := difflib.get_close_matches(key, known, 1, _MISTYPED):
            raise RigError(f'no parameter "{key}"', where=path, field=at, hint=f'did you mean "{meant[0]}"?')
        return str(value)
    number = to_si(value, known[key].unit, atmospheric=air, where=path, field=at)
    _within(known[key], number, value, path, at)
    return number


def _effects(table: Table, path: Path) -> tuple[Effect, ...]:
    found = []
    for name in table:
        subtable(table, name, path, f"effects.{name}", "a table of the effect's parameters")
        try:
            found.append(find_effect(name, path.parent))
        except RigError as error:
            raise RigError(str(error), where=path, field=f"effects.{name}") from error
    return tuple(found)


def _effect_parameters(
    effect: Effect, stated: Table, air: Mapping[str, float], path: Path
) -> dict[str, float]:
    """SI values of an effect's table under their names in the model."""
    key = next(key for key in stated if key == effect.name or key.endswith(f":{effect.name}"))
    known = {parameter.name: parameter for parameter in effect.parameters}
    known_keys(stated[key], known, path, f"effects.{key}.", "parameter")
    found = {}
    for name, entry in stated[key].items():
        value = to_si(
            entry,
            known[name].unit,
            atmospheric=air.get(ATMOSPHERE),
            where=path,
            field=f"effects.{key}.{name}",
        )
        _within(known[name], value, entry, path, f"effects.{key}.{name}")
        found[name] = value
    if effect.entire and (absent := [name for name in known if name not in found]):
        raise RigError(
            f"no value for {', '.join(absent)}",
            where=path,
            field=f"effects.{key}",
            expected="all parameters of the effect, as optid wrote them",
        )
    return effect.qualified(found)


def _parameters(table: Table, model: Model, path: Path) -> dict[str, float]:
    known = {name: parameter for name, parameter in by_name(model).items() if "." not in name}
    known_keys(table, known, path, "parameters.", "parameter")
    values: dict[str, float] = {}
    # The atmospheric pressure first: gauge pressures are relative to it, so it must be absolute.
    for name in sorted(table, key=lambda name: name != ATMOSPHERE):
        air = values.get(ATMOSPHERE, default_of(model, ATMOSPHERE)) if name != ATMOSPHERE else None
        at = f"parameters.{name}"
        value = to_si(table[name], known[name].unit, atmospheric=air, where=path, field=at)
        _within(known[name], value, table[name], path, at)
        values[name] = value
    absent = [name for name, parameter in known.items() if name not in table and parameter.default is None]
    if absent:
        extra = [name for name, parameter in known.items() if name not in table and name not in absent]
        raise RigError(
            f"no value for {', '.join(absent)}",
            where=path,
            field="parameters",
            hint=f"with defaults, so optional: {', '.join(extra)}" if extra else None,
        )
    return {name: values[name] for name in table}


def _within(parameter: Parameter, value: float, entry: object, path: Path, at: str) -> None:
    low, high = parameter.bounds
    if not low <= value <= high:
        raise RigError(
            f"{shown(entry)} is outside the physical range",
            where=path,
            field=at,
            expected=span(low, high, parameter.unit),
        )


def _freed(table: Table, model: Model, values: dict[str, float], path: Path) -> tuple[Freed, ...]:
    """The `[fit]` entries; a value in `values` that misses its bound by rounding alone is moved onto it."""
    known = by_name(model)
    known_keys(table, known, path, "fit.", "parameter")
    return tuple(_freed_one(known[name], entry, values, path) for name, entry in table.items())


def _freed_one(parameter: Parameter, entry: object, values: dict[str, float], path: Path) -> Freed:
    name, unit, at = parameter.name, parameter.unit, f"fit.{parameter.name}"
    air = values.get(ATMOSPHERE) if name != ATMOSPHERE else None
    one = "" if unit == "1" else f" {unit}"
    example = "{ bounds = [1, 2] }" if unit == "1" else f'{{ bounds = ["1{one}", "2{one}"] }}'
    if not isinstance(entry, dict):
        raise RigError(f"found {shown(entry)}", where=path, field=at, expected=f"{name} = {example}")
    known_keys(entry, ("bounds", "sd", "per"), path, f"{at}.")
    per = (
        text(entry, "per", path, f"{at}.per", 'per = "recording" or the name of a tag')
        if "per" in entry
        else None
    )
    pair = entry.get("bounds")
    if not isinstance(pair, list) or len(pair) != 2:
        found = "no bounds" if pair is None else f"found {shown(pair)}"
        raise RigError(found, where=path, field=f"{at}.bounds", expected=f"{name} = {example}")
    low, high = (to_si(bound, unit, atmospheric=air, where=path, field=f"{at}.bounds") for bound in pair)
    if low >= high:
        raise RigError(
            f"{shown(pair)}: the lower bound is not below the upper one", where=path, field=f"{at}.bounds"
        )
    least, most = parameter.bounds
    if low < least or high > most:
        raise RigError(
            f"{shown(pair)} reaches beyond the physical range",
            where=path,
            field=f"{at}.bounds",
            expected=f"bounds within {span(least, most, unit)}",
        )
    start = values.get(name, parameter.default)
    if start is not None and not low <= start <= high:
        nearest_bound = min(max(start, low), high)
        if abs(start - nearest_bound) > _ON_BOUND * abs(nearest_bound):
            raise RigError(
                f"the start value {start:g}{one} lies outside the bounds",
                where=path,
                field=at,
                expected=span(low, high, unit),
            )
        values[name] = nearest_bound
    sd = to_si(entry["sd"], unit, difference=True, where=path, field=f"{at}.sd") if "sd" in entry else None
    if sd is not None and sd <= 0:
        raise RigError(f"{sd:g}{one}", where=path, field=f"{at}.sd", expected="a positive standard deviation")
    return Freed(name, low, high, sd, per)
