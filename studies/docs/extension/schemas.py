"""The JSON documents, from the schema files that the tests validate them against."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import optid

FOLDER = Path(optid.__file__).parent / "results" / "schemas"
HEAD = """# JSON documents

Every command writes a JSON document with the keys `schema`, `version`, `command` and `inputs` (SHA-256 of each input
file). The schema files (JSON Schema, draft 2020-12) are in `optid/results/schemas` and part of the package; tests
validate every kind of result against them. Keys may be added within a version of a schema; the keys listed here are
neither renamed nor removed. See the [policy](../../house/policy.md). Values are in the unit given with them.
"""


def pages() -> dict[str, str]:
    """File name -> text."""
    return {"index.md": "\n".join([HEAD, *(_section(path) for path in sorted(FOLDER.glob("*.schema.json")))])}


def _section(path: Path) -> str:
    schema = json.loads(path.read_text(encoding="utf-8"))
    rows = "\n".join(_rows(schema, schema.get("$defs", {}), ""))
    title = f"## {schema['title']}\n\n{schema['description']} File: `{path.name}`.\n"
    return f"{title}\n| key | type | meaning |\n|---|---|---|\n{rows}\n"


def _rows(schema: dict[str, Any], defs: dict[str, Any], before: str) -> list[str]:
    found: list[str] = []
    required = schema.get("required", ())
    for key, raw in schema.get("properties", {}).items():
        own = _resolved(raw, defs)
        name = f"{before}{key}"
        always = "" if key in required or before else " (where it applies)"
        words = (raw.get("description") or own.get("description", "")).replace("|", "\\|")
        found.append(f"| `{name}` | {_type(own)} | {words}{always} |")
        inner = _resolved(own.get("items", {}), defs)
        if before.count(".") < 2 and "properties" in own:
            found += _rows(own, defs, f"{name}.")
        elif before.count(".") < 2 and "properties" in inner:
            found += _rows(inner, defs, f"{name}[].")
    return found


def _resolved(schema: Any, defs: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(schema, dict):
        return {}
    if "$ref" in schema:
        return {**defs[schema["$ref"].rpartition("/")[2]], **schema}
    return schema


def _type(schema: dict[str, Any]) -> str:
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{value}`" for value in schema["enum"])
    kind = schema.get("type", "any")
    return " or ".join(kind) if isinstance(kind, list) else str(kind)
