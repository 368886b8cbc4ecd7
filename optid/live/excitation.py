"""Commands over time for an open-loop experiment: a sequence of pulses, steps, ramps, multisines, or a file."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from optid.core.model import Array
from optid.core.paths import is_file
from optid.core.readers import read_recording
from optid.core.units import to_si
from optid.errors import InputError, nearest
from optid.live.reference import Reference
from optid.live.settings import Settings
from optid.rigs.rigfile import Rig

WHERE = "--command"
EXAMPLE = '"impulse 2 V 40 ms", "steps 1 V 0.5 s, ramp -1 V 1 V 2 s, multisine 1 V 0.5 Hz 20 Hz 10 s", or a recording'
REST, TAIL = 0.5, 1.0  # s of the safe command before the first part, and after a pulse and the last part
LINES = 400  # largest number of lines of a multisine
AHEAD = 0.05  # s before the end of the stroke at which an axis in open loop is stopped
_VALUE = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\s\d+-][^\s]*)?")

Part = list[tuple[float, float]]  # (s for which it holds, command)


@dataclass(frozen=True)
class Excitation(Reference):
    """Commands (SI, V), each held from its time on; the last one is the safe command."""

    @property
    def seconds(self) -> float:
        """Length, with the rest at its end."""
        return self.times[-1] + TAIL


def read_command(text: str, rig: Rig, settings: Settings, role: str, unit: str) -> Excitation:
    """Parse `--command`.

    Args:
        text: parts such as "impulse 2 V 40 ms", separated by commas, or the path of a recording with a command.
        rig: names the recording's columns.
        settings: rate, safe command, limits of every part.
        role: of the command.
        unit: SI unit of the command.

    Raises:
        InputError: neither, an unknown part, a wrong unit, or a command beyond the limits.
    """
    safe = settings.limits.safe
    if Path(text).suffix and is_file(text):
        record = read_recording(Path(text), rig)
        time, values = record.time - record.time[0], record[role].recorded
        end = float(time[-1] + (time[-1] - time[-2]))
        levels = np.where(np.isfinite(values), values, safe)
        return _within(Excitation((*time.tolist(), end), (*levels.tolist(), safe)), settings, unit)
    holds: Part = [(REST, safe)]
    for part in text.split(","):
        holds += _part(part.strip(), settings, unit)
    times = np.r_[0.0, np.cumsum([seconds for seconds, _ in holds])]
    excitation = Excitation(tuple(times.tolist()), (*(level for _, level in holds), safe))
    return _within(excitation, settings, unit)


def _part(text: str, settings: Settings, unit: str) -> Part:
    kind, _, rest = text.partition(" ")
    if kind not in KINDS:
        raise InputError(f'"{text}"', where=WHERE, expected=EXAMPLE, hint=nearest(kind, KINDS))
    make, units = KINDS[kind]
    found = _VALUE.findall(rest)
    wanted = [unit if one == "V" else one for one in units]
    if len(found) != len(wanted) or _VALUE.sub("", rest).strip():
        raise InputError(
            f'"{text}"', where=WHERE, field=kind, expected=f"values in {', '.join(wanted)}; {EXAMPLE}"
        )
    values = [
        to_si(f"{n} {u}".strip() if u else float(n), w, where=WHERE, field=kind)
        for (n, u), w in zip(found, wanted, strict=True)
    ]
    if any(value <= 0 for value, one in zip(values, units, strict=True) if one != "V"):
        raise InputError(
            f'"{text}"', where=WHERE, field=kind, expected="durations and frequencies more than 0"
        )
    return make(settings, *values)


def _rest(settings: Settings, seconds: float) -> Part:
    return [(seconds, settings.limits.safe)]


def _step(settings: Settings, level: float, seconds: float) -> Part:
    return [(seconds, level)]


def _impulse(settings: Settings, level: float, seconds: float) -> Part:
    return [(seconds, level), (TAIL, settings.limits.safe)]


def _steps(settings: Settings, level: float, seconds: float) -> Part:
    safe = settings.limits.safe
    return [(seconds, level), (seconds, safe), (seconds, 2 * safe - level), (seconds, safe)]


def _ramp(settings: Settings, begin: float, end: float, seconds: float) -> Part:
    return _sampled(np.linspace(begin, end, 1 + max(1, round(seconds * settings.rate)))[:-1], settings)


def _multisine(settings: Settings, size: float, low: float, high: float, seconds: float) -> Part:
    """Lines of equal size with Schroeder's phases (IEEE Trans. Inf. Theory 16, 1970), around the safe command."""
    first, last = max(1, math.ceil(low * seconds - 1e-9)), math.floor(high * seconds + 1e-9)
    if first > last or high >= settings.rate / 2:
        expected = f"a line of {1 / seconds:g} Hz or more between, and less than {settings.rate / 2:g} Hz"
        raise InputError(
            f"{low:g} to {high:g} Hz in {seconds:g} s", where=WHERE, field="multisine", expected=expected
        )
    lines = np.unique(np.linspace(first, last, min(last - first + 1, LINES)).round())
    k = np.arange(1, lines.size + 1)
    t = np.arange(round(seconds * settings.rate)) * settings.span / seconds
    wave = np.zeros(t.size)
    for line, phase in zip(lines, -np.pi * k * (k - 1) / lines.size, strict=True):
        wave += np.cos(2 * np.pi * line * t + phase)
    return _sampled(settings.limits.safe + abs(size) * wave / np.abs(wave).max(), settings)


def _sampled(values: Array, settings: Settings) -> Part:
    return [(settings.span, value) for value in values.tolist()]


# Part -> its function, and the units of its values; "V" is the command's own.
KINDS: dict[str, tuple[Callable[..., Part], tuple[str, ...]]] = {
    "rest": (_rest, ("s",)),
    "step": (_step, ("V", "s")),
    "steps": (_steps, ("V", "s")),
    "impulse": (_impulse, ("V", "s")),
    "ramp": (_ramp, ("V", "V", "s")),
    "multisine": (_multisine, ("V", "Hz", "Hz", "s")),
}


def _within(excitation: Excitation, settings: Settings, unit: str) -> Excitation:
    limits = settings.limits
    slack = 1e-9 * (limits.high - limits.low)
    for value in (min(excitation.values), max(excitation.values)):
        if not limits.low - slack <= value <= limits.high + slack:
            raise InputError(
                f"{value:g} {unit} lies beyond the command limits",
                where=WHERE,
                expected=f"{limits.low:g} to {limits.high:g} {unit}",
                hint="[live] command_limits in the rig file sets them",
            )
    return excitation
