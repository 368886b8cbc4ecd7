"""Structured text of functions and one function block made to Python, statement by statement; knows nothing of optid.

It takes one statement a line, as the exports write them, and refuses what it does not know.
"""

from __future__ import annotations

import math
import re

WORDS = {"AND": "and", "OR": "or", "NOT": "not", "MOD": "%", "<>": "!=", "=": "=="}
TOKEN = re.compile(r"\d+\.\d+(?:E[-+]?\d+)?|\d+|[A-Za-z_]\w*|<>|<=|>=|:=|[-+*/()<>=,\[\]]|\s+")


def divide(x: float, y: float) -> float:
    """As IEEE 754 has it."""
    if y == 0.0:
        return math.nan if x == 0.0 or x != x else math.copysign(math.inf, x)
    return x / y


BUILT_IN = {
    "ABS": abs,
    "SQRT": math.sqrt,
    "DINT_TO_LREAL": float,
    "LREAL_TO_DINT": round,
    "DIV": lambda a, b: a // b,
}


def expression(text: str) -> str:
    out, at = [], 0
    while at < len(text):
        found = TOKEN.match(text, at)
        assert found, f"not structured text: {text[at:]!r}"
        at = found.end()
        token = found.group()
        out.append(f" {WORDS[token]} " if token in WORDS else token)
    return "".join(out)


def compiled(source: str) -> dict[str, object]:
    """Functions by name, and the block as a class with the method `call`."""
    text = re.sub(r"\(\*.*?\*\)", "", source, flags=re.DOTALL)
    text = re.sub(r"\[\n([^\]]*?)\n\s*\]", lambda m: "[" + " ".join(m.group(1).split()) + "]", text)
    space: dict[str, object] = dict(BUILT_IN) | {"divide": divide}
    for kind, name, body in re.findall(r"(FUNCTION_BLOCK|FUNCTION) (\w+)(.*?)\nEND_\1\b", text, re.DOTALL):
        exec("\n".join(_function(name, body) if kind == "FUNCTION" else _block(name, body)), space)
    return space


def _sections(body: str) -> tuple[dict[str, list[tuple[str, str, str]]], list[str]]:
    held: dict[str, list[tuple[str, str, str]]] = {}
    for kind, listed in re.findall(r"^(VAR\w*)\n(.*?)^END_VAR", body, re.DOTALL | re.MULTILINE):
        for line in filter(None, map(str.strip, listed.splitlines())):
            found = re.fullmatch(r"(\w+) : ([^:;]+?)(?: := (.*))?;", line)
            assert found, line
            held.setdefault(kind, []).append((found[1], found[2], found[3] or ""))
    rest = body[body.rindex("END_VAR") + len("END_VAR") :]
    return held, [line.strip() for line in rest.splitlines() if line.strip()]


def _function(name: str, body: str) -> list[str]:
    held, statements = _sections(body)
    names = [n for kind in ("VAR_IN_OUT", "VAR_INPUT") for n, _, _ in held.get(kind, [])]
    local = [f"    {n} = {_start(kind, value)}" for n, kind, value in held.get("VAR", [])]
    return [
        f"def {name}({', '.join(names)}):",
        *local,
        *_statements(statements, name),
        f"    return {name}_out",
    ]


def _block(name: str, body: str) -> list[str]:
    held, statements = _sections(body)
    every = [entry for kind in held for entry in held[kind]]
    names = [n for n, _, _ in every]
    takes = [n for n, _, _ in held["VAR_INPUT"]]
    back = ", ".join(f"'{n}': {n}" for n in names)
    return [
        f"class {name}:",
        "    def __init__(self):",
        *(f"        self.{n} = {_start(kind, value)}" for n, kind, value in every),
        f"    def call(self, {', '.join(takes)}):",
        *(f"        {n} = self.{n}" for n in names if n not in takes),
        *(f"    {line}" for line in _statements(statements, name)),
        f"        self.__dict__.update({{{back}}})",
    ]


def _start(kind: str, value: str) -> str:
    if kind.startswith("ARRAY"):
        found = re.match(r"ARRAY\[0\.\.(\d+)\] OF LREAL", kind)
        assert found, kind
        length = int(found[1]) + 1
        assert not value or value.count(",") + 1 == length, (
            f"{length} numbers, and {value.count(',') + 1} given"
        )
        return value or f"[0.0] * {length}"
    return expression(value) if value else {"LREAL": "0.0", "DINT": "0", "BOOL": "False"}[kind]


def _statements(lines: list[str], own: str) -> list[str]:
    out, depth = [f"    {own}_out = 0.0"], 1
    for line in lines:
        pad = "    " * depth
        if found := re.fullmatch(r"IF (.*) THEN", line):
            out.append(f"{pad}if {_value(found[1])}:")
            depth += 1
        elif line == "ELSE":
            out.append(f"{'    ' * (depth - 1)}else:")
        elif found := re.fullmatch(r"FOR (\w+) := (.*) TO (.*?)( BY -1)? DO", line):
            ends = (f"{_value(found[3])} - 1, -1") if found[4] else f"{_value(found[3])} + 1"
            out.append(f"{pad}for {found[1]} in range({_value(found[2])}, {ends}):")
            depth += 1
        elif line in ("END_IF;", "END_FOR;"):
            depth -= 1
        elif line == "RETURN;":
            out.append(f"{pad}return {own}_out")
        else:
            found = re.fullmatch(r"([\w\[\]()+\-* ]+?) := (.*);", line)
            assert found, f"no statement: {line}"
            target = f"{own}_out" if found[1] == own else expression(found[1])
            out.append(f"{pad}{target} = {_value(found[2])}")
    return out


def _value(text: str) -> str:
    """An expression whose divisions are IEEE 754's: the exports put both sides and the whole into brackets."""
    if text == "zero / zero":
        return "divide(0.0, 0.0)"
    return expression(text)
