"""A parsed rig file: the model with its values, bounds and channels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from optid.core.loading import blame
from optid.core.model import Model
from optid.core.parameter import Parameter
from optid.core.recording import ChannelMap
from optid.core.sheet import build
from optid.effects.effect import Effect
from optid.effects.sized import sized
from optid.errors import InputError, PlantError, RigError
from optid.rigs import find_plant
from optid.rigs.fields import Table

ATMOSPHERE = "atmospheric_pressure"  # reference of gauge pressures


@dataclass(frozen=True)
class Freed:
    """A parameter to fit: SI bounds, and the standard deviation of its prior, if any.

    `per` is "recording" or a tag where each recording, or each group of one tag, has a value of its own.
    """

    name: str
    low: float
    high: float
    sd: float | None = None
    per: str | None = None


@dataclass(frozen=True, eq=False)
class Rig:
    """A parsed rig file.

    Attributes
    ----------
    name : str
        the rig's.
    model_name : str
        the plant as the file names it.
    options : Mapping[str, object]
        options of the plant that the file states.
    effects : tuple[Effect, ...]
        effects inserted into the plant, from `[effects.NAME]`.
    model : Model
        the plant's equations with them.
    parameters : Mapping[str, float]
        SI values of those the file states, an effect's as "effect.parameter";
        `model.vector(rig.parameters)` adds the defaults.
    freed : tuple[Freed, ...]
        parameters to fit.
    channels : Mapping[str, ChannelMap]
        role -> how a recording's column is read; "time" is among them.
    path : Path
        the file.
    source : str
        its text.
    recordings : Mapping[str, Mapping[str, str | float]]
        name of a recording's file -> its tags, and SI values of its own parameters.
    groups : Mapping[str, tuple[str, ...]]
        name of a parameter -> the groups of recordings with their own value; empty in a rig as read.
    plain : Rig | None
        the rig as read, if this one was made for recordings with own parameters.
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


def rebuilt(rig: Rig) -> Rig:
    """The rig with its model rebuilt from options, effects and groups."""
    return replace(rig, model=model_of(rig.model_name, rig.options, rig.effects, rig.path, rig.groups))


def model_of(
    name: str,
    options: Table,
    effects: tuple[Effect, ...],
    path: Path,
    groups: Mapping[str, tuple[str, ...]] | None = None,
) -> Model:
    """The equations of a plant with effects, and with own parameters for groups of recordings.

    Raises:
        RigError: no such plant, it cannot be built, or it raises.
    """
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
    model = model_of(rig.model_name, rig.options, every, rig.path, rig.groups)
    freed = [Freed(f"{effect.name}.{q.name}", *q.bounds) for effect in new for q in effect.fitted]
    parameters = {**rig.parameters, **(values or {})}
    return replace(rig, effects=every, model=model, parameters=parameters, freed=(*rig.freed, *freed))


def by_name(model: Model) -> dict[str, Parameter]:
    """A model's parameters by name."""
    return {parameter.name: parameter for parameter in model.parameters}


def default_of(model: Model, name: str) -> float | None:
    """A parameter's default, SI; nothing where it has none or the model lacks it."""
    parameter = by_name(model).get(name)
    return parameter.default if parameter else None
