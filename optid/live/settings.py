"""The `[live]` table of a rig file: rate, limits, safe command; every entry has a cautious default."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from optid.core.document import parsed_toml
from optid.core.recording import ChannelMap
from optid.core.units import shown, to_si
from optid.errors import RigError
from optid.rigs.channels import REFERENCE
from optid.rigs.fields import Table, known_keys, subtable
from optid.rigs.rigfile import Rig

RATE = 1000.0  # Hz, if neither the rig file nor the call states it
FULL_SWING = 0.02  # s from one command limit to the other, where no rate limit is stated
STROKE_SHARE = 0.45  # of the stroke to each side of its middle, if no stroke limits are stated
WATCHDOG = 0.05  # s without a command after which the session ends
RELAXED = 10.0  # s, the same for a simulated rig, for which a busy machine is no danger
SAFE_TIME = 10.0  # s for which the safe command is tried
DRIVERS = ("simulated", "replay", "nidaqmx", "opcua", "file")
_KEYS = (
    *(
        "rate",
        "command_limits",
        "command_rate",
        "safe_command",
        "stroke_limits",
        "speed_limit",
        "travel_limit",
    ),
    *("watchdog", "safe_time", *DRIVERS),
)


@dataclass(frozen=True)
class Limits:
    """Limits of the rig, in SI units of the recorded quantities (V, m).

    Attributes:
        low, high: of the command.
        rate: largest change of the command per second.
        safe: the command that is written when anything fails.
        stroke: positions beyond which only commands that lead back are passed.
        speed: beyond which a command in the same direction is replaced by the safe one.
        travel: the same for the distance from where the session began.
    """

    low: float
    high: float
    rate: float
    safe: float
    stroke: tuple[float, float] = (-math.inf, math.inf)
    speed: float = math.inf
    travel: float = math.inf

    def allowed(self, wish: float, before: float, position: float, span: float) -> float:
        """The command nearest to the requested one that keeps the limits.

        By convention a positive command drives towards larger positions, so beyond the stroke's limits the
        outward part of a request is replaced by the safe command. If the request or the position is NaN, the result is
        the safe command, at once: the rate limit never delays it.

        Args:
            wish: of the controller.
            before: the present command.
            position: measured.
            span: s since `before` was written.
        """
        if not (wish - wish == 0.0 and position - position == 0.0):  # finite
            return self.safe
        if (position >= self.stroke[1] and wish > self.safe) or (
            position <= self.stroke[0] and wish < self.safe
        ):
            return self.safe
        step = self.rate * span
        wish = min(max(wish, before - step), before + step)
        return min(max(wish, self.low), self.high)


@dataclass(frozen=True)
class Wiring:
    """The columns that the loop reads and writes, with their conversion to SI and back.

    Attributes:
        command: the one input.
        measured: the outputs the rig has, the controlled one first.
        time: of a recording's time, for the log.
        reference: the reference's channel, where the rig file maps one.
    """

    command: ChannelMap
    measured: tuple[ChannelMap, ...]
    time: ChannelMap
    reference: ChannelMap | None = None

    def put(self, command: float) -> float:
        """A command in SI (V), converted to the unit of its column."""
        c = self.command
        return (command / c.per_unit - c.shift) / c.factor

    def taken(self, recorded: float) -> float:
        """The reverse of `put`."""
        c = self.command
        return (recorded * c.factor + c.shift) * c.per_unit


@dataclass(frozen=True)
class Settings:
    """Settings of a session.

    Attributes:
        rate: Hz.
        limits: of the command and the axis.
        watchdog: s without a command or a measurement after which it ends.
        safe_time: s for which the safe command is retried if a driver does not accept it.
        ahead: s over which the motion is extrapolated to the end of the stroke; 0 for none.
    """

    rate: float
    limits: Limits
    watchdog: float
    safe_time: float = SAFE_TIME
    ahead: float = 0.0

    @property
    def span(self) -> float:
        """Time between samples, s."""
        return 1.0 / self.rate


def wiring_of(rig: Rig) -> Wiring:
    """The loop's channels.

    Raises:
        RigError: the plant has more than one input, or a channel's unit cannot be inverted.
    """
    inputs = [port.role for port in rig.model.recorded]
    if len(inputs) != 1:
        raise RigError(
            f"{len(inputs)} inputs", where=rig.path, field="model", expected="one command to control"
        )
    measured = tuple(rig.channels[port.role] for port in rig.model.outputs if port.role in rig.channels)
    return Wiring(rig.channels[inputs[0]], measured, rig.channels["time"], rig.channels.get(REFERENCE))


def live_settings(rig: Rig, rate: float | None = None, relaxed: bool = False) -> Settings:
    """Settings from the rig file's `[live]` table.

    Args:
        rig: as read.
        rate: Hz, overrides the table.
        relaxed: no hardware is driven, so the watchdog is long unless the table states it.

    Raises:
        RigError: an unknown entry, a wrong unit, limits that are empty or exclude the safe command.
    """
    table, where = live_table(rig), rig.path
    wiring = wiring_of(rig)
    command, position = wiring.command, wiring.measured[0]
    volts, metres = command.recorded_unit, position.recorded_unit

    def number(key: str, unit: str, default: float) -> float:
        return to_si(table[key], unit, where=where, field=f"live.{key}") if key in table else default

    recorded = wiring.time.rate
    rate = number("rate", "Hz", recorded or RATE) if rate is None else rate
    if recorded is not None and abs(rate - recorded) > 1e-9 * recorded:
        raise RigError(
            f"{rate:g} Hz but recordings without a time column have {recorded:g} Hz",
            where=where,
            field="live.rate",
            expected="the same rate, or a time column in [channels]",
        )
    waits = RELAXED if relaxed else max(WATCHDOG, 5 / rate if rate > 0 else WATCHDOG)
    watchdog, safe_time = number("watchdog", "s", waits), number("safe_time", "s", SAFE_TIME)
    full = None if command.full_scale is None else command.full_scale * command.per_unit
    if full is None and "command_limits" not in table:
        raise RigError(
            "the largest command is not known",
            where=where,
            field="live.command_limits",
            expected=f'command_limits = ["-5 {volts}", "5 {volts}"], or a full_scale of the command',
        )
    low, high = _pair(table, "command_limits", volts, (-(full or 0.0), full or 0.0), where)
    for name, value in (("rate", rate), ("watchdog", watchdog), ("safe_time", safe_time)):
        if not 0 < value < math.inf:
            raise RigError(f"{value:g}", where=where, field=f"live.{name}", expected="a positive value")
    limits = Limits(
        low,
        high,
        number("command_rate", f"{volts}/s" if volts != "1" else "Hz", (high - low) / FULL_SWING),
        number("safe_command", volts, 0.0),
        _pair(table, "stroke_limits", metres, _stroke(rig), where),
        number("speed_limit", f"{metres}/s" if metres != "1" else "Hz", math.inf),
        number("travel_limit", metres, math.inf),
    )
    if not low <= limits.safe <= high:
        raise RigError(
            f"{limits.safe:g} {volts} lies outside the command limits",
            where=where,
            field="live.safe_command",
            expected=f"{low:g} to {high:g} {volts}",
        )
    for name, value in (
        ("command_rate", limits.rate),
        ("speed_limit", limits.speed),
        ("travel_limit", limits.travel),
    ):
        if not value > 0:
            raise RigError(
                f"{value:g}",
                where=where,
                field=f"live.{name}",
                expected="a positive rate" if name == "command_rate" else "a positive limit",
            )
    return Settings(rate, limits, watchdog, safe_time)


def live_table(rig: Rig) -> Table:
    """The rig file's `[live]` table, empty when absent; unknown entries are refused."""
    table = subtable(parsed_toml(rig.source), "live", rig.path, "live", "a table")
    known_keys(table, _KEYS, rig.path, "live.")
    return table


def driver_options(rig: Rig, name: str) -> Table:
    """The table `[live.NAME]` of a driver, empty when absent."""
    return subtable(live_table(rig), name, rig.path, f"live.{name}", "a table")


def _stroke(rig: Rig) -> tuple[float, float]:
    """Default stroke limits: a share of the stroke, if the plant's parameters state it."""
    stroke = rig.parameters.get("stroke", math.inf)
    return -STROKE_SHARE * stroke, STROKE_SHARE * stroke


def _pair(
    table: Table, key: str, unit: str, default: tuple[float, float], where: Path
) -> tuple[float, float]:
    if key not in table:
        return default
    pair, field = table[key], f"live.{key}"
    if not isinstance(pair, list) or len(pair) != 2:
        raise RigError(
            f"found {shown(pair)}", where=where, field=field, expected=f'["-1 {unit}", "1 {unit}"]'
        )
    low, high = (to_si(value, unit, where=where, field=field) for value in pair)
    if not low < high:
        raise RigError(f"{shown(pair)}: the lower limit is not below the upper one", where=where, field=field)
    return low, high
