"""Gains that a session starts with: a file of `optid tune`, written out, or gentle ones."""

from __future__ import annotations

import json
import math
from dataclasses import fields
from pathlib import Path
from typing import Any

from optid.errors import InputError, nearest
from optid.live.settings import Limits
from optid.pid.controller import Gains

SCHEMA = "optid.pid/1"
NAMES = tuple(field.name for field in fields(Gains))
EXAMPLE = '"kp=40 ki=60 kd=0.5", or a pid.json'


def gentle(limits: Limits) -> Gains:
    """Proportional only: the full command for an error of the whole way between the stroke limits.

    Raises:
        InputError: the stroke is not known.
    """
    low, high = limits.stroke
    if not math.isfinite(high - low):
        raise InputError(
            "the rig file states no stroke, so no gentle gains are known", where="--gains", expected=EXAMPLE
        )
    return Gains(min(limits.high, -limits.low) / (high - low) if limits.low < 0 < limits.high else 0.0)


def read_gains(text: str) -> Gains:
    """What `--gains` means; SI: V/m, V/(m s), V s/m, s.

    Args:
        text: "kp=40 ki=60", or the path of a pid.json.

    Raises:
        InputError: neither, an unknown name, or a value that is no finite number.
    """
    if text.endswith(".json"):
        return Gains(**_numbers(_stored(Path(text)), text))
    pairs = [part.partition("=") for part in text.replace(",", " ").split()]
    if not pairs or not all(name and equals for name, equals, _ in pairs):
        raise InputError(f'"{text}"', where="--gains", expected=EXAMPLE)
    return Gains(**_numbers({name: value for name, _, value in pairs}, "--gains"))


def _stored(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError("no such file", where=path) from None
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InputError(f"cannot be read ({error})", where=path, expected="a pid.json") from None
    if not isinstance(document, dict) or document.get("schema") != SCHEMA:
        found = document.get("schema") if isinstance(document, dict) else type(document).__name__
        raise InputError(f"{found}", where=path, field="schema", expected=SCHEMA)
    gains = document.get("gains")
    if not isinstance(gains, dict):
        raise InputError("missing", where=path, field="gains")
    return gains


def _numbers(entries: dict[str, Any], where: str) -> dict[str, float]:
    found = {}
    for name, value in entries.items():
        if name not in NAMES:
            raise InputError(f'no gain "{name}"', where=where, hint=nearest(name, NAMES))
        try:
            found[name] = float(value)
        except (TypeError, ValueError):
            raise InputError(f"{value}", where=where, field=name, expected="a number") from None
    if "kp" not in found:
        raise InputError("missing", where=where, field="kp", expected=EXAMPLE)
    return found
