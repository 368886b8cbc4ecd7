"""Start gains of a session: from a file of `optid tune`, given explicitly, or cautious defaults."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from pathlib import Path

from optid.errors import InputError, nearest
from optid.live.settings import Limits, Settings
from optid.pid.controller import Gains
from optid.pid.controller import Settings as PidSettings
from optid.tuning.files import load

NAMES = tuple(field.name for field in fields(Gains))
EXAMPLE = '"kp=40 ki=60 kd=0.5", or a pid.json'


def gentle(limits: Limits) -> Gains:
    """Proportional gain only: full command for an error of the whole range between the stroke limits.

    Raises:
        InputError: the stroke is not known.
    """
    low, high = limits.stroke
    if not math.isfinite(high - low):
        raise InputError(
            "the rig file gives no stroke, so there are no default gains", where="--gains", expected=EXAMPLE
        )
    return Gains(min(limits.high, -limits.low) / (high - low) if limits.low < 0 < limits.high else 0.0)


def read_gains(text: str, settings: Settings) -> tuple[Gains, PidSettings | None]:
    """Parse `--gains`; SI: V/m, V/(m s), V s/m, s.

    Args:
        text: "kp=40 ki=60", or the path of a pid.json.
        settings: of the session.

    Returns:
        The gains, and from a pid.json the other settings of its controller.

    Raises:
        InputError: neither, an unknown name, a value that is not a finite number, or gains for another sample time.
    """
    if text.endswith(".json"):
        stored = load(Path(text))
        if not math.isclose(stored.settings.sample_time, settings.span, rel_tol=1e-6):
            raise InputError(
                f"{stored.settings.sample_time:g} s",
                where=text,
                field="sample_time",
                expected=f"{settings.span:g} s, the sampling interval of the session",
                hint="tune at the session's rate, or run it with --rate",
            )
        return stored.gains, stored.settings
    pairs = [part.partition("=") for part in text.replace(",", " ").split()]
    if not pairs or not all(name and equals for name, equals, _ in pairs):
        raise InputError(f'"{text}"', where="--gains", expected=EXAMPLE)
    return Gains(**_numbers({name: value for name, _, value in pairs})), None


def controller_settings(settings: Settings, own: PidSettings | None) -> PidSettings:
    """Settings of the session's controller: its own limits, clipped to the session's."""
    limits = settings.limits
    own = own or PidSettings(settings.span)
    return replace(
        own,
        sample_time=settings.span,
        low=max(own.low, limits.low),
        high=min(own.high, limits.high),
        rate=min(own.rate, limits.rate),
    )


def _numbers(entries: dict[str, str]) -> dict[str, float]:
    found = {}
    for name, value in entries.items():
        if name not in NAMES:
            raise InputError(f'no gain "{name}"', where="--gains", hint=nearest(name, NAMES))
        try:
            found[name] = float(value)
        except ValueError:
            raise InputError(f'"{value}"', where="--gains", field=name, expected="a number") from None
    if "kp" not in found:
        raise InputError("missing", where="--gains", field="kp", expected=EXAMPLE)
    return found
