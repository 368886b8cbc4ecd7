"""Reading JSON files of bounded size: the result is a value, or an error of one line."""

from __future__ import annotations

import json
import math
import re
import tomllib
from pathlib import Path
from typing import Any

from optid.core.resultset import located
from optid.errors import InputError

MOST = 16 * 2**20  # bytes of a JSON file; a model of 500 coefficients with its covariance takes 5 MB
_PARTS = 32  # of a TOML key: rig files have three
_DEEP_KEY = re.compile(rf"""(?<![\w."'-])(?>(?>[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){{{_PARTS}}}""")
HUGE = 1e100  # no quantity of an axis comes near in any unit; beyond, squares overflow


def read_bounded(path: Path, most: int = MOST) -> bytes:
    """The content of a file; of a device no more than `most` bytes.

    Raises:
        OSError: cannot be read.
        ValueError: it holds more than `most` bytes.
    """
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        raise ValueError(f"it is larger than {most} bytes")
    return content


def read_document(path: Path, schema: str, expected: str) -> dict[str, Any]:
    """Read a JSON document of a known schema; its numbers are finite.

    Args:
        path: the file; in a results folder whose replacement was interrupted, the complete version is read.
        schema: such as "optid.fit/1"; older versions are accepted.
        expected: what the file should be, for messages.

    Raises:
        InputError: no such file, cannot be read, no JSON, another kind of document or one of a newer optid.
    """
    return known(read_json(path, expected), schema, path)


def read_json(path: Path, expected: str) -> Any:
    """Read a JSON file of a bounded size; its numbers are finite.

    Args:
        path: the file; in a results folder whose replacement was interrupted, the complete version is read.
        expected: what the file should be, for messages.

    Raises:
        InputError: no such file, cannot be read, or no JSON.
    """
    try:
        return json.loads(read_bounded(located(path)).decode("utf-8-sig"), parse_constant=_no_number)
    except FileNotFoundError:
        raise InputError("no such file", where=path, expected=expected) from None
    except (OSError, ValueError, RecursionError) as error:
        why = "its tables or lists are nested too deeply" if isinstance(error, RecursionError) else f"{error}"
        raise InputError(f"cannot be read ({why})", where=path, expected=expected) from None


def optional_document(path: Path, most: int = MOST) -> dict[str, Any] | None:
    """An optional JSON object; ``None`` where there is none, or none that can be parsed."""
    try:
        content = json.loads(read_bounded(path, most))
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


def parsed_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ValueError: not valid, nested too deeply, or keys of more parts than anybody writes,
            which take the parser time with their square.
    """
    if (deep := _DEEP_KEY.search(text)) is not None:
        line = text.count("\n", 0, deep.start()) + 1
        raise ValueError(f"a key of more than {_PARTS} parts (line {line})")
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise ValueError("its tables or lists are nested too deeply") from None


def known(content: Any, schema: str, where: object = None) -> dict[str, Any]:
    """A parsed document, if it has the schema or an older version of it.

    Raises:
        InputError: it is not.
    """
    if not isinstance(content, dict):
        raise InputError(f"found {_kind_of(content)}", where=where, field="schema", expected=schema)
    found = content.get("schema")
    match = re.fullmatch(r"([\w.]{1,60})/(\d{1,9})", found) if isinstance(found, str) else None
    kind, _, version = schema.partition("/")
    if match is None or match.group(1) != kind:
        what = "missing" if found is None else f"{found}"[:80]
        raise InputError(what, where=where, field="schema", expected=schema)
    if int(match.group(2)) > int(version):
        written = f"; optid {str(content['version'])[:20]} wrote it" if "version" in content else ""
        raise InputError(
            f"{found} is newer than this version of optid can read{written}",
            where=where,
            field="schema",
            expected=f"{schema} or older",
            hint="upgrade optid",
        )
    return content


def finite(value: object, field: str, where: object = None, *, most: float = HUGE) -> float:
    """A number of a document.

    Raises:
        InputError: it is no number, not finite, or larger than anything physical.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"found {_kind_of(value)}", where=where, field=field, expected="a number")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not abs(number) <= most:
        raise InputError(f"{number:.5g}", where=where, field=field, expected=f"a number within +-{most:g}")
    return number


def whole(value: object, field: str, where: object = None, *, low: int = 0, high: int = 10_000) -> int:
    """A whole number of a document.

    Raises:
        InputError: it is none, or out of its range.
    """
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        found = str(value)[:40] if isinstance(value, int | float) else _kind_of(value)
        raise InputError(found, where=where, field=field, expected=f"a whole number from {low} to {high}")
    return value


def _no_number(text: str) -> float:
    raise ValueError(f"{text} is not a number")


def _kind_of(value: object) -> str:
    names = {dict: "an object", list: "a list", str: "a text", bool: "true or false", type(None): "null"}
    return names.get(type(value), "a number")
