"""The `[channels]` table of a rig file: role -> column, unit, full scale, offset, noise."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from optid.core.model import Model
from optid.core.recording import ChannelMap
from optid.core.units import conversion, si_unit_of, to_si
from optid.errors import RigError
from optid.rigs.fields import Table, known_keys, subtable, text

REFERENCE = "reference"  # kept in a recording although no model uses it
_KEYS = ("column", "unit", "full_scale", "offset", "sd", "between")
_BETWEEN = {"held": False, "linear": True}  # course of an input between its samples
_EXAMPLE = '{ column = "x", unit = "mm" }'
_TIME = 'time = { column = "t", unit = "s" } or rate = "1000 Hz"'


def read_channels(
    table: Table, model: Model, atmospheric: float | None, where: Path
) -> dict[str, ChannelMap]:
    """The map of every channel; "time" comes first.

    Args:
        table: the `[channels]` table.
        model: its inputs and outputs are the valid roles, with "reference".
        atmospheric: ambient pressure for gauge units, Pa.
        where: the rig file, for messages.

    Raises:
        RigError: an unknown role or key, a wrong unit, no time, an input or every output without a channel.
    """
    ports = {port.role: port.unit for port in (*model.recorded, *model.outputs)}
    known_keys(table, ["time", "rate", *ports, REFERENCE], where, "channels.", "role")
    found = {"time": _time(table, where)}
    for role in table:
        if role not in ("time", "rate"):
            entry = subtable(table, role, where, f"channels.{role}", f"a table such as {_EXAMPLE}")
            found[role] = _channel(role, entry, ports.get(role), atmospheric, where)
    outputs = [port.role for port in model.outputs]
    for absent in (port.role for port in model.recorded if port.role not in found):
        raise RigError(
            "this channel is missing, and the model needs it as an input",
            where=where,
            field=f"channels.{absent}",
        )
    if not any(role in found for role in outputs):
        raise RigError(
            "no channel is mapped to an output of the model",
            where=where,
            field="channels",
            expected=f"at least one of {', '.join(outputs)}",
        )
    _one_role_each(found, where)
    commands = {port.role for port in model.recorded}
    for role in (
        role for role, channel in found.items() if role not in commands and channel.linear is not None
    ):
        raise RigError(
            "only an input has this key",
            where=where,
            field=f"channels.{role}.between",
            expected="no such key",
        )
    return {role: replace(channel, held=role in commands) for role, channel in found.items()}


def _time(table: Table, where: Path) -> ChannelMap:
    field = "channels.time"
    entry = dict(subtable(table, "time", where, field, _TIME))
    known_keys(entry, ("column", "unit", "rate"), where, f"{field}.")
    if "rate" in table and entry:
        raise RigError(
            "time and rate are both given", where=where, field="channels.rate", expected="one of the two"
        )
    if "rate" in table:
        entry, field = {"rate": table["rate"]}, "channels"
    if "rate" in entry:
        if len(entry) > 1:
            raise RigError(
                "column and rate are both given", where=where, field=field, expected="one of the two"
            )
        rate = to_si(entry["rate"], "Hz", where=where, field=f"{field}.rate")
        if rate <= 0:
            raise RigError(f"{rate:g} Hz", where=where, field=f"{field}.rate", expected="a positive rate")
        return ChannelMap("time", "", "s", "s", recorded_unit="s", rate=rate)
    if not entry:
        raise RigError("neither time nor rate is given", where=where, field=field, expected=_TIME)
    column = text(entry, "column", where, field, _TIME)
    unit = text(entry, "unit", where, f"{field}.unit", 'unit = "s"')
    rule = conversion(unit, "s", where=where, field=f"{field}.unit")
    return ChannelMap("time", column, unit, "s", factor=rule.factor, recorded_unit="s")


def _channel(
    role: str, entry: Table, model_unit: str | None, atmospheric: float | None, where: Path
) -> ChannelMap:
    field = f"channels.{role}"
    known_keys(entry, _KEYS, where, f"{field}.")
    column = text(entry, "column", where, field, f"a table such as {_EXAMPLE}")
    unit = "1"
    if "unit" in entry or model_unit != "1":
        unit = text(entry, "unit", where, f"{field}.unit", 'the unit as measured, such as unit = "mm"')
    recorded = si_unit_of(unit, where=where, field=f"{field}.unit")
    scaled = model_unit == "1" and (recorded != "1" or "full_scale" in entry)
    if scaled and "full_scale" not in entry:
        raise RigError(
            f'the unit is "{unit}", but the model expects a share of full scale',
            where=where,
            field=f"{field}.full_scale",
            expected=f'full_scale = "5 {unit}", the value of the full command',
        )
    model_unit = model_unit or recorded
    si_unit = recorded if scaled else model_unit
    rule = conversion(unit, si_unit, atmospheric=atmospheric, where=where, field=f"{field}.unit")

    def size(key: str, *, difference: bool = True) -> float:
        at = f"{field}.{key}"
        value = to_si(
            entry[key], si_unit, atmospheric=atmospheric, difference=difference, where=where, field=at
        )
        if value <= 0 and key != "offset":
            raise RigError(f"{value:g} {si_unit}", where=where, field=at, expected="a positive value")
        return value

    offset = size("offset") if "offset" in entry else 0.0
    full = size("full_scale", difference=False) if "full_scale" in entry else None
    per_unit = full if scaled and full is not None else 1.0
    return ChannelMap(
        role,
        column,
        unit,
        model_unit,
        # Dividing last keeps a command of exactly full scale at exactly 1.
        factor=rule.factor / per_unit,
        shift=(rule.offset - offset) / per_unit,
        sd=size("sd") / per_unit if "sd" in entry else None,
        linear=_linear(entry, where, field),
        full_scale=None if full is None else (full - offset) / per_unit,
        per_unit=per_unit,
        recorded_unit=recorded if scaled else model_unit,
    )


def _linear(entry: Table, where: Path, field: str) -> bool | None:
    """Is it linear between its samples? None where that is not stated."""
    if "between" not in entry:
        return None
    stated = text(entry, "between", where, f"{field}.between", 'between = "linear"')
    if stated not in _BETWEEN:
        raise RigError(f'"{stated}"', where=where, field=f"{field}.between", expected='"held" or "linear"')
    return _BETWEEN[stated]


def _one_role_each(channels: dict[str, ChannelMap], where: Path) -> None:
    """Refuse two roles on one column: an output would be predicted from itself."""
    taken: dict[str, str] = {}
    for role, channel in channels.items():
        if channel.column and channel.column in taken:
            raise RigError(
                f'column "{channel.column}" is already the {taken[channel.column]}',
                where=where,
                field=f"channels.{role}",
                expected="a column of its own",
            )
        taken[channel.column] = role
