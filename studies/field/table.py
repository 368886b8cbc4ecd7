"""The declarative table of real recordings: what is run, and what engineers accept, tolerate and reject."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optid.core.units import to_si

ANSWERS = Path(__file__).parent / "answers.toml"


@dataclass(frozen=True)
class Pattern:
    """A kind of answer.

    Attributes:
        verdicts: of which it is one.
        names: effects that it tells, all of them; suspects where the verdict names nothing.
        beside: effects that it may tell as well; "*" allows all.
        values: parameter -> (least, most), as quantities with units.
        unsigned: a size counts, not its sign.
    """

    verdicts: tuple[str, ...]
    names: frozenset[str]
    beside: frozenset[str]
    values: Mapping[str, tuple[str, str]]
    unsigned: bool = False

    def within(self, name: str, value: float, unit: str) -> bool:
        """Does a parameter's value, in SI, lie where the pattern has it?"""
        low, high = (to_si(bound, unit) for bound in self.values[name])
        return low <= (abs(value) if self.unsigned else value) <= high


@dataclass(frozen=True)
class Row:
    """One run: a rig file, recordings, and the answers to it.

    Attributes:
        command: "diagnose" or "fit".
        rig, train, holdout: as in the table; see there.
        parameters: entries of the rig file's table that are stated otherwise.
        reject: names that settle the row, whatever else is told.
        truth, source: what is so, and who says it.
    """

    name: str
    rig: str
    train: tuple[str, ...]
    holdout: tuple[str, ...]
    truth: str
    source: str
    accept: tuple[Pattern, ...]
    tolerate: tuple[Pattern, ...]
    reject: frozenset[str]
    parameters: Mapping[str, str]
    command: str = "diagnose"


def read_table(path: Path = ANSWERS) -> tuple[Row, ...]:
    """All rows, in the order of the file; a row takes what it does not state from its template."""
    held = tomllib.loads(path.read_text(encoding="utf-8"))
    templates = held.get("templates", {})
    return tuple(_row({**templates.get(one.get("template", ""), {}), **one}) for one in held["rows"])


def _row(held: Mapping[str, Any]) -> Row:
    accept, tolerate = (tuple(map(_pattern, held.get(part, ()))) for part in ("accept", "tolerate"))
    return Row(
        name=held["name"],
        rig=held["rig"],
        train=tuple(held["train"]),
        holdout=tuple(held.get("holdout", ())),
        truth=held["truth"],
        source=held["source"],
        accept=accept,
        tolerate=tolerate,
        reject=frozenset(held.get("reject", ())),
        parameters=held.get("parameters", {}),
        command=held.get("command", "diagnose"),
    )


def _pattern(held: Mapping[str, Any]) -> Pattern:
    return Pattern(
        verdicts=tuple(held["verdict"]),
        names=frozenset(held["names"]),
        beside=frozenset(held.get("beside", ())),
        values={name: (low, high) for name, (low, high) in held.get("values", {}).items()},
        unsigned=held.get("unsigned", False),
    )
