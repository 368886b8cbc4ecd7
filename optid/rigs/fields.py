"""Looking things up in a rig file's tables, with complaints that name the field."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from optid.core.units import shown
from optid.errors import RigError, nearest

Table = Mapping[str, Any]


def known_keys(table: Table, valid: Iterable[str], where: Path, prefix: str = "", kind: str = "key") -> None:
    """Refuse keys that mean nothing here.

    Raises:
        RigError: names the first unknown key and the nearest valid one.
    """
    names = list(valid)
    for key in table:
        if key not in names:
            raise RigError(
                f'unknown {kind} "{key}"', where=where, field=prefix + key, hint=nearest(key, names)
            )


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
        found = f'"{key}" is missing' if value is None else f"found {shown(value)}"
        raise RigError(found, where=where, field=field, expected=expected)
    return value
