"""Rig files: TOML in, a model with values, bounds and channels out; and back without losing a comment."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from optid.core.document import parsed_toml, read_bounded
from optid.core.loading import blame, outside_allowed
from optid.core.model import Model
from optid.core.parameter import Parameter
from optid.core.recording import ChannelMap
from optid.core.resultset import located
from optid.core.sheet import build
from optid.core.units import GAUGE, conversion, shown, split, to_si
from optid.effects.effect import Effect
from optid.effects.library import find_effect
from optid.effects.sized import sized
from optid.errors import InputError, PlantError, RigError, nearest
from optid.rigs import find_plant
from optid.rigs.carried import carried, effect_files, plant_file
from optid.rigs.channels import read_channels
from optid.rigs.constraints import refuse_contradictions
from optid.rigs.fields import Table, known_keys, span, subtable, text

TABLES = ("name", "model", "options", "parameters", "fit", "channels", "recordings", "effects", "live")
MOST = 4 * 2**20  # bytes of a rig file
_MISTYPED = 0.85  # likeness of a tag to a parameter's name, from which on it is one mistyped
ATMOSPHERE = "atmospheric_pressure"  # what gauge pressures count from
_ON_BOUND = (
    1e-9  # relative: a fitted value that stands on its bound may miss it by rounding on the way to text
)


@dataclass(frozen=True)
class Freed:
    """A parameter a fit may move: SI bounds, and the standard deviation of what was known before, if any.

    `per` is "recording" or a tag where each recording, or each group of one tag, has a value of its own.
    """

    name: str
    low: float
    high: float
    sd: float | None = None
    per: str | None = None


@dataclass(frozen=True, eq=False)
class Rig:
    """A rig file, understood.

    Attributes
    ----------
    name : str
        the rig's.
    model_name : str
        the plant as the file names it.
    options : Mapping[str, object]
        choices of the plant the file states.
    effects : tuple[Effect, ...]
        missing physics inserted into the plant, from `[effects.NAME]`.
    model : Model
        the plant's equations with them.
    parameters : Mapping[str, float]
        SI values of those the file states, an effect's as "effect.parameter";
        `model.vector(rig.parameters)` adds the defaults.
    freed : tuple[Freed, ...]
        what a fit may move.
    channels : Mapping[str, ChannelMap]
        role -> how a recording's column is read; "time" is among them.
    path : Path
        the file.
    source : str
        its text.
    recordings : Mapping[str, Mapping[str, str | float]]
        name of a recording's file -> its tags, and SI values of parameters that it has of its own.
    groups : Mapping[str, tuple[str, ...]]
        name of a parameter -> the groups of recordings that have a value of their own; none in a rig as read.
    plain : Rig | None
        the rig as read, where it was made for recordings that differ.
    """

    name: str
    model_name: str
    options: Mapping[str, object]
    effects: tuple[Effect, ...]
    model: Model
    parameters: Mapping[str, float]
    freed: tuple[Freed, ...]
    channels: Mapping[str, ChannelMap]
    path: Path
    source: str = field(repr=False)
    recordings: Mapping[str, Mapping[str, str | float]] = field(default_factory=dict)
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    plain: Rig | None = None


def read_rig(path: str | Path) -> Rig:
    """Read a rig file and build its model.

    Parameters
    ----------
    path : str | Path
        of the rig file.

    Returns
    -------
    Rig
        rig file, understood.

    Raises
    ------
    RigError
        cannot be read, is no TOML, or says something that cannot be; names file and field, what was
        found and what was expected.
    """
    path = Path(path)
    return _parse(_text(path), path)


def rig_of_text(source: str, path: str | Path) -> Rig:
    """A rig from the text of its file, as a job left it: its values may contradict each other.

    Parameters
    ----------
    source : str
        the text.
    path : str | Path
        what errors name, and where a user's own files are looked for.

    Raises
    ------
    RigError
        as `read_rig`.
    """
    return _parse(source, Path(path), constrained=False)


def _write_inputs(document: Any, rig: Rig) -> None:
    """Say which inputs go on straight between their samples."""
    for role, channel in rig.channels.items():
        if channel.linear:
            document["channels"][role]["between"] = "linear"


def write_rig(rig: Rig, path: str | Path, parameters: Mapping[str, float] | None = None) -> None:
    """Write a rig file with new values, keeping its comments, units and layout.

    The file appears whole or not at all, and reads back to the same values within 1e-12. Where it goes to another
    folder, copies of the user's own plant and effect files go with it.

    Parameters
    ----------
    rig : Rig
        as read.
    path : str | Path
        file to write; its folder must exist.
    parameters : Mapping[str, float] | None
        SI values by name; the others stay as they stand. A parameter the file did not state is
        added in its SI unit.

    Raises
    ------
    RigError
        an unknown name, a value outside its bounds, or a place that cannot be written.
    """
    path = Path(path)
    _replace(path, _rewritten(rig, path, path.parent, parameters or {}))


def _with_recordings(source: str, model: Model, own: Mapping[str, Mapping[str, float]]) -> str:
    """The text with values of parameters that recordings have of their own, SI, by file and name."""
    import tomlkit

    document, known = tomlkit.parse(source), _by_name(model)
    every: Any = document.setdefault("recordings", tomlkit.table(is_super_table=True))
    for file, values in own.items():
        entry = every.setdefault(file, tomlkit.table())
        for name, value in values.items():
            entry[name] = _written(value, entry.get(name), known[name].unit, None)
    return tomlkit.dumps(document)


def rig_text(
    rig: Rig,
    parameters: Mapping[str, float] | None = None,
    own: Mapping[str, Mapping[str, float]] | None = None,
) -> str:
    """The text of a rig file with new values, for the folder in which it stands; nothing is written.

    Parameters
    ----------
    rig : Rig
        as read.
    parameters : Mapping[str, float] | None
        as in `write_rig`.
    own : Mapping[str, Mapping[str, float]] | None
        of a rig whose recordings differ: file -> name -> SI value, for `[recordings]`.

    Raises
    ------
    RigError
        an unknown name, or a value outside its bounds.
    """
    new = dict(parameters or {})
    with outside_allowed():  # effects of the user's own were run already, wherever they lie
        if rig.plain is None:
            return _rewritten(rig, rig.path, None, new)
        known = len(rig.plain.effects)
        plain = with_effects(rig.plain, rig.effects[known:])
        shared = {name: value for name, value in new.items() if name in _by_name(plain.model)}
        return _with_recordings(_rewritten(plain, rig.path, None, shared), plain.model, own or {})


def _rewritten(rig: Rig, path: Path, folder: Path | None, new: Mapping[str, float]) -> str:
    """The text with new values, as seen from a folder; from its own where that is absent, and nothing is copied."""
    import tomlkit

    for name in new:
        if name not in _by_name(rig.model):
            raise RigError(f'unknown parameter "{name}"', where=path, hint=nearest(name, _by_name(rig.model)))
    document = tomlkit.parse(rig.source)
    keys = _carry(rig, document, folder)
    plant: Any = document.setdefault("parameters", tomlkit.table())
    values = {**rig.parameters, **new}
    air = values.get(ATMOSPHERE, _default(rig.model, ATMOSPHERE))
    known = _by_name(rig.model)
    stated = dict(rig.parameters)
    for (
        effect
    ) in rig.effects:  # those the file does not hold yet are written whole, in the order in which they act
        if not _key_of(effect, document):
            _table_of(f"{effect.name}.", rig, document, plant, keys)
            for name in effect.qualified(effect.at_null()):
                values.setdefault(name, float(known[name].default or 0.0))
                stated.pop(name, None)
    for name, value in values.items():
        table, own = _table_of(name, rig, document, plant, keys), name.rpartition(".")[2]
        old = table.get(own)
        # A gauge value counts from the atmospheric pressure, so it is rewritten when that one moves.
        gauge = ATMOSPHERE in new and isinstance(old, str) and old.rstrip().endswith(GAUGE)
        if value != stated.get(name) or gauge:
            table[own] = _written(float(value), old, known[name].unit, air)
    _rewrite_gauge_bounds(document, rig, air)
    _write_inputs(document, rig)
    written = tomlkit.dumps(document)
    again = _parse(
        written, path, constrained=False
    )  # a fit may have ended in what cannot be: it is still kept
    for name, value in values.items():
        if abs(again.parameters[name] - value) > max(
            1e-12 * abs(value), 1e-300
        ):  # subnormals have no twelve digits
            raise RigError(f"{value!r} does not read back", where=path, field=f"parameters.{name}")
    return written


def _text(path: Path) -> str:
    try:
        return read_bounded(located(path), MOST).decode("utf-8-sig")
    except FileNotFoundError:
        near = sorted(p.name for p in path.parent.glob("*.toml")) if path.parent.is_dir() else []
        raise RigError("no such file", where=path, hint=nearest(path.name, near) if near else None) from None
    except UnicodeDecodeError as error:
        raise RigError(f"byte {error.start} is not UTF-8", where=path, expected="a TOML text file") from None
    except (IsADirectoryError, PermissionError):
        what = "this is a directory" if path.is_dir() else "no permission to read it"
        raise RigError(what, where=path, expected="a readable rig file") from None
    except (OSError, ValueError) as error:
        raise RigError(f"cannot be read ({error})", where=path) from None


def _parse(source: str, path: Path, *, constrained: bool = True) -> Rig:
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
    model = _model(model_name, options, (), path)
    if effects:
        effects = tuple(sized(effect, model.axis) for effect in effects)
        model = _model(model_name, options, effects, path)
    parameters = _parameters(subtable(document, "parameters", path, "parameters", "a table"), model, path)
    for effect in effects:
        parameters |= _effect_parameters(effect, stated, parameters, path)
    if constrained:
        refuse_contradictions(model, parameters, path)
    air = parameters.get(ATMOSPHERE, _default(model, ATMOSPHERE))
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
    """Tags of each file, as text, and values of parameters that it has of its own, SI."""
    known, found = _by_name(model), {}
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


def rebuilt(rig: Rig) -> Rig:
    """The rig with the model that its options, effects and groups make."""
    return replace(rig, model=_model(rig.model_name, rig.options, rig.effects, rig.path, rig.groups))


def _model(
    name: str,
    options: Table,
    effects: tuple[Effect, ...],
    path: Path,
    groups: Mapping[str, tuple[str, ...]] | None = None,
) -> Model:
    try:
        plant = find_plant(name, path.parent)
    except InputError as error:
        raise RigError(str(error), where=path, field="model") from error
    except ImportError as error:
        raise RigError(f'"{name}" cannot be imported ({error})', where=path, field="model") from error
    try:
        return build(plant, effects, groups, **options)
    except PlantError as error:
        about_option = "option" in (error.field or "") or "no option" in str(error)
        raise RigError(str(error), where=path, field="options" if about_option else "model") from error
    except Exception as error:  # a user's equations can raise anything
        file = path.parent / name.rpartition(":")[0]
        raise RigError(f'"{name}" raised {blame(error, file)}', where=path, field="model") from error


def with_effects(rig: Rig, effects: Iterable[Effect], values: Mapping[str, float] | None = None) -> Rig:
    """The rig with more effects in its plant, their parameters free.

    Parameters
    ----------
    rig : Rig
        as read.
    effects : Iterable[Effect]
        to insert after those it has.
    values : Mapping[str, float] | None
        SI values of all parameters to change, an effect's as "effect.parameter"; defaults (no effect) else.

    Raises
    ------
    RigError
        the plant does not offer a site of theirs.
    """
    new = tuple(sized(effect, rig.model.axis) for effect in effects)
    every = (*rig.effects, *new)
    model = _model(rig.model_name, rig.options, every, rig.path, rig.groups)
    freed = [Freed(f"{effect.name}.{q.name}", *q.bounds) for effect in new for q in effect.fitted]
    parameters = {**rig.parameters, **(values or {})}
    return replace(rig, effects=every, model=model, parameters=parameters, freed=(*rig.freed, *freed))


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
            expected="all numbers of the law, as they were written",
        )
    return effect.qualified(found)


def _by_name(model: Model) -> dict[str, Parameter]:
    return {parameter.name: parameter for parameter in model.parameters}


def _default(model: Model, name: str) -> float | None:
    parameter = _by_name(model).get(name)
    return parameter.default if parameter else None


def _parameters(table: Table, model: Model, path: Path) -> dict[str, float]:
    known = {name: parameter for name, parameter in _by_name(model).items() if "." not in name}
    known_keys(table, known, path, "parameters.", "parameter")
    values: dict[str, float] = {}
    # The atmospheric pressure first: gauge pressures count from it, and it cannot count from itself.
    for name in sorted(table, key=lambda name: name != ATMOSPHERE):
        air = values.get(ATMOSPHERE, _default(model, ATMOSPHERE)) if name != ATMOSPHERE else None
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
            f"{shown(entry)} is outside what is physical",
            where=path,
            field=at,
            expected=span(low, high, parameter.unit),
        )


def _freed(table: Table, model: Model, values: dict[str, float], path: Path) -> tuple[Freed, ...]:
    """The `[fit]` entries; moves a value in `values` onto a bound it misses by rounding alone."""
    known = _by_name(model)
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
            f"{shown(pair)}: the low bound is not below the high one", where=path, field=f"{at}.bounds"
        )
    least, most = parameter.bounds
    if low < least or high > most:
        raise RigError(
            f"{shown(pair)} reaches beyond what is physical",
            where=path,
            field=f"{at}.bounds",
            expected=f"bounds within {span(least, most, unit)}",
        )
    start = values.get(name, parameter.default)
    if start is not None and not low <= start <= high:
        nearest_bound = min(max(start, low), high)
        if abs(start - nearest_bound) > _ON_BOUND * abs(nearest_bound):
            raise RigError(
                f"its start {start:g}{one} lies outside the bounds",
                where=path,
                field=at,
                expected=span(low, high, unit),
            )
        values[name] = nearest_bound
    sd = to_si(entry["sd"], unit, difference=True, where=path, field=f"{at}.sd") if "sd" in entry else None
    if sd is not None and sd <= 0:
        raise RigError(f"{sd:g}{one}", where=path, field=f"{at}.sd", expected="a positive standard deviation")
    return Freed(name, low, high, sd, per)


def _carry(rig: Rig, document: Any, folder: Path | None) -> dict[str, str]:
    """Let a rig's document name the user's own files as they are seen from its new folder; keys of such effects."""
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
    """The `[effects.NAME]` table that a parameter stands in, made where absent; or the plant's."""
    import tomlkit

    for effect in rig.effects:
        if name.startswith(f"{effect.name}."):
            every: Any = document.setdefault("effects", tomlkit.table(is_super_table=True))
            key = _key_of(effect, document) or keys.get(effect.name, effect.name)
            return every.setdefault(key, tomlkit.table())
    return plant


def _written(value: float, old: object, unit: str, air: float | None) -> float | str:
    """An SI value as the file states such values: in the unit of the old entry."""
    if old is None or not isinstance(old, str):
        return value if unit == "1" else f"{value!r} {unit}"
    _, own = split(old, unit)
    number = conversion(own, unit, atmospheric=air).text(value)
    # What follows the number in the old entry, blanks included, stays.
    return number + re.sub(r"^\s*[-+\d.]+(?:[eE][-+]?\d+)?", "", old)


def _rewrite_gauge_bounds(document: Any, rig: Rig, air: float | None) -> None:
    """Keep the absolute bounds of `[fit]` where they are stated as gauge pressures and the air moved."""
    before = rig.parameters.get(ATMOSPHERE, _default(rig.model, ATMOSPHERE))
    if before == air:
        return
    freed = {entry.name: entry for entry in rig.freed}
    for name, entry in document.get("fit", {}).items():
        for i, bound in enumerate((freed[name].low, freed[name].high)):
            old = entry["bounds"][i]
            if isinstance(old, str) and old.rstrip().endswith(GAUGE):
                entry["bounds"][i] = _written(bound, old, "Pa", air)


def _replace(path: Path, content: str) -> None:
    """Write beside the target and move into place, so that no half file is ever seen."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with beside.open("w", encoding="utf-8", newline="") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise RigError(f"cannot be written ({error})", where=path) from None
