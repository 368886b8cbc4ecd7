"""Validation against the schema files: the part of JSON Schema that they use, with the location of an error."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from optid.errors import InputError

_TYPES: dict[str, Callable[[Any], bool]] = {
    "object": lambda value: isinstance(value, dict),
    "array": lambda value: isinstance(value, list),
    "string": lambda value: isinstance(value, str),
    "boolean": lambda value: isinstance(value, bool),
    "null": lambda value: value is None,
    "number": lambda value: isinstance(value, int | float) and not isinstance(value, bool),
    "integer": lambda value: isinstance(value, int) and not isinstance(value, bool),
}


class MissingField(InputError, KeyError):
    """A document lacks a field; a `KeyError` too, for templates that ask whether it is there."""

    def __str__(self) -> str:
        return Exception.__str__(self)  # a `KeyError` shows its argument in quotes


class Part(dict[str, Any]):
    """An object of a document: a field that is used and missing is an error of the file."""

    file: Path | None = None

    def __missing__(self, field: str) -> Any:
        raise MissingField("missing", where=self.file, field=field, expected="a complete result of optid")


def parts(value: Any, file: Path) -> Any:
    """A parsed document whose objects, however deep, are parts."""
    if isinstance(value, dict):
        part = Part({name: parts(one, file) for name, one in value.items()})
        part.file = file
        return part
    return [parts(one, file) for one in value] if isinstance(value, list) else value


def refuse_invalid(document: Mapping[str, Any], schema: str, where: object) -> None:
    """Refuse a document that does not conform to its schema.

    Parameters
    ----------
    document : Mapping[str, Any]
        as read.
    schema : str
        such as "optid.fit/1"; other versions are not checked.
    where : object
        its file, for messages.

    Raises
    ------
    InputError
        names the first field that is missing or of another type.
    """
    if document.get("schema") != schema:
        return
    known = _schema(schema)
    for field, found, expected in _faults(document, known, known, ""):
        raise InputError(found, where=where, field=field[:200], expected=expected)


@cache
def _schema(name: str) -> dict[str, Any]:
    file = name.removeprefix("optid.").replace("/", "-")
    place = resources.files("optid.results") / "schemas" / f"{file}.schema.json"
    content: dict[str, Any] = json.loads(place.read_text(encoding="utf-8"))
    return content


def _faults(
    value: Any, part: Mapping[str, Any], whole: Mapping[str, Any], at: str
) -> Iterator[tuple[str, ...]]:
    """All errors: field, what was found and what was expected."""
    if "$ref" in part:
        part = whole["$defs"][part["$ref"].rpartition("/")[2]]
    kinds = part.get("type", ())
    kinds = (kinds,) if isinstance(kinds, str) else kinds
    if kinds and not any(_TYPES[kind](value) for kind in kinds):
        yield at, _shown(value), " or ".join(kinds)
    elif isinstance(value, dict):
        yield from _object_faults(value, part, whole, at)
    elif isinstance(value, list):
        if not part.get("minItems", 0) <= len(value) <= part.get("maxItems", len(value)):
            yield at, f"{len(value)} entries", f"{part.get('minItems', 0)} to {part.get('maxItems')}"
        for k, one in enumerate(value) if "items" in part else ():
            yield from _faults(one, part["items"], whole, f"{at}[{k}]")
    elif "enum" in part and value not in part["enum"]:
        yield at, _shown(value), " or ".join(map(str, part["enum"]))


def _object_faults(
    value: Mapping[str, Any], part: Mapping[str, Any], whole: Mapping[str, Any], at: str
) -> Iterator[tuple[str, ...]]:
    lead = f"{at}." if at else ""
    properties, others = part.get("properties", {}), part.get("additionalProperties")
    for name in part.get("required", ()):
        if name not in value:
            yield f"{lead}{name}", "missing", str(properties.get(name, {}).get("description", "it"))
    for name, one in value.items():
        inner = properties.get(name, others)
        if isinstance(inner, dict):
            yield from _faults(one, inner, whole, f"{lead}{name}")


def _shown(value: object) -> str:
    text = json.dumps(value)
    return f"found {text if len(text) <= 60 else text[:56] + ' ...'}"
