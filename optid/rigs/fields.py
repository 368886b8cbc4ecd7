"""Access to a rig file's tables, with errors that name the field."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from optid.core.units import shown
from optid.errors import RigError, nearest

Table = Mapping[str, Any]


def known_keys(
    table: Table, valid: Iterable[str], where: Path, prefix: str = "", kind: str | None = None
) -> None:
    """Refuse unknown keys.

    Raises:
        RigError: names the first unknown key and the nearest valid one.
    """
    names = list(valid)
    for key, value in table.items():
        if key not in names:
            what = kind or ("table" if isinstance(value, dict) else "key")
            raise RigError(
                f'unknown {what} "{key}"', where=where, field=prefix + key, hint=nearest(key, names)
            )


def span(low: float, high: float, unit: str) -> str:
    """An interval in words: "0.1 to 0.5 m", "at least 0 N"."""
    one = "" if unit == "1" else f" {unit}"
    if math.isinf(high):
        return f"at least {low:g}{one}" if math.isfinite(low) else "any value"
    return f"{low:g} to {high:g}{one}" if math.isfinite(low) else f"at most {high:g}{one}"


def subtable(table: Table, key: str, where: Path, field: str, expected: str) -> Table:
    """The table under a key, empty when absent.

    Raises:
        RigError: it is something else.
    """
    value = table.get(key, {})
    if not isinstance(value, dict):
        raise RigError(f"found {shown(value)}", where=where, field=field, expected=expected)
    return value


def text(table: Table, key: str, where: Path, field: str, expected: str) -> str:
    """The text under a key.

    Raises:
        RigError: absent, empty or something else.
    """
    value = table.get(key)
    if not isinstance(value, str) or not value.strip():
        found = "missing" if value is None else f"found {shown(value)}"
        raise RigError(found, where=where, field=field, expected=expected)
    return value
