"""Control structures of real drives, each a way to write the one controller of `optid.pid.pid_step`.

P position over PI velocity, with the speed taken from the position through the derivative's lag:

    w = Kv (r - y),    u = Kp (w - v) + Kp / Tn integral of (w - v),    v = dy/dt

is the two-degree-of-freedom PID with kd = Kp, ki = Kp Kv / Tn, kp = Kp Kv + Kp / Tn and set-point weight
b = Kp Kv / kp; velocity feed-forward is the derivative weight c (Åström and Hägglund, Advanced PID Control, 2006,
ch. 3.4). A drive uses Kv, Kp and Tn directly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.errors import InputError, nearest
from optid.pid.controller import Gains
from optid.pid.pid_step import KD, KI, KP, SETPOINT_WEIGHT


@dataclass(frozen=True)
class Structure:
    """A control structure: its name, the gains to optimise, and its description."""

    name: str
    free: tuple[str, ...]
    words: str
    cascade: bool = False


STRUCTURES = {
    one.name: one
    for one in (
        Structure("pid", ("kp", "ki", "kd"), "PID, derivative of the measurement"),
        Structure("pid2", ("kp", "ki", "kd", "setpoint_weight"), "PID with two degrees of freedom"),
        Structure("pd", ("kp", "kd"), "PD, derivative of the measurement"),
        Structure("pi", ("kp", "ki"), "PI"),
        Structure("p", ("kp",), "proportional"),
        Structure("p-pi", ("kp", "ki", "kd"), "P position over PI velocity", True),
    )
}


def structure_of(name: str) -> Structure:
    """By name.

    Raises:
        InputError: no such structure; names the nearest.
    """
    if name not in STRUCTURES:
        raise InputError(
            f'"{name}"', where="--structure", expected=", ".join(STRUCTURES), hint=nearest(name, STRUCTURES)
        )
    return STRUCTURES[name]


def usual_structure(simulated: bool, known: bool) -> str:
    """The default structure's name.

    An axis integrates by itself. Where its friction is only assumed, the simulation does not show how much integral
    action makes it hunt: dry friction without break-away lets it rest where a real axis does not. A constant load
    then leaves an error.

    Args:
        simulated: whether a simulation with friction judges.
        known: whether that friction is the rig's own, or a recording's.
    """
    if not simulated:
        return "pid2"
    return "pid" if known else "pd"


def free_gains(structure: Structure, simulated: bool, paths: bool = False) -> tuple[str, ...]:
    """The gains to optimise.

    Against a simulation with sensor noise a PID's derivative filter is one, and along paths a cascade's velocity
    feed-forward.
    """
    filtered = ("derivative_filter",) if simulated and structure.name == "pid" else ()
    ahead = ("derivative_weight",) if structure.cascade and paths else ()
    return (*structure.free, *filtered, *ahead)


def cascaded(gains: Array) -> Array:
    """Controller gains (n, GAINS) of a cascade, in whose rows kp stands for Kp Kv: kp and set-point weight follow."""
    out = np.array(gains)
    position = out[:, KP].copy()
    there = position != 0.0
    inner = np.divide(out[:, KD] * out[:, KI], position, out=np.zeros_like(position), where=there)
    out[:, KP] = position + inner
    out[:, SETPOINT_WEIGHT] = np.divide(
        position, out[:, KP], out=np.ones_like(position), where=out[:, KP] != 0.0
    )
    return out


def drive_values(
    gains: Gains, structure: Structure, span: float, units: tuple[str, str]
) -> list[tuple[str, float, str]]:
    """Name, value and unit of the settings of a drive.

    Args:
        gains: of the controller, SI.
        structure: of the drive.
        span: half the range of the command, for per cent; infinite for none.
        units: of command and output, SI.
    """
    command, output = units
    milli, per = (1e-3, f"m{output}") if output in ("m", "V") else (1.0, output)
    rows: list[tuple[str, float, str]] = []
    if structure.cascade and gains.kd != 0.0:
        position = gains.setpoint_weight * gains.kp
        rows = [("Kv", position / gains.kd, "1/s"), ("Kp", milli * gains.kd, f"{command} s/{per}")]
        rows += _percent("Kp", milli * gains.kd, span, f"% s/{per}")
        rows += [("Tn", 1e3 * position / gains.ki, "ms")] if gains.ki else []
        return [*rows, ("velocity feed-forward", 100.0 * gains.derivative_weight, "%")]
    rows = [("kp", milli * gains.kp, f"{command}/{per}"), *_percent("kp", milli * gains.kp, span, f"%/{per}")]
    if gains.kp:
        rows += [("1/Ti", gains.ki / gains.kp, "1/s"), ("Td", 1e3 * gains.kd / gains.kp, "ms")]
    return [*rows, ("derivative filter", 1e3 * gains.derivative_filter, "ms")]


def _percent(name: str, value: float, span: float, unit: str) -> list[tuple[str, float, str]]:
    return [(name, 100.0 * value / span, unit)] if math.isfinite(span) and span > 0.0 else []
