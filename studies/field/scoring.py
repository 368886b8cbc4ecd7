"""Scores of an answer: accept, tolerate, reject, or none where nothing was answered.

An accepted name whose own evidence contradicts it is tolerated at best: every parameter that makes the effect has an
interval that holds its null, or p is above the level of the test.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from optid.effects.library import find_effect
from studies.field.table import Pattern, Row

LEVEL = 0.01  # of the test on the hold-out


@dataclass(frozen=True)
class Answer:
    """What a run told.

    Attributes:
        verdict: of the diagnosis; "fitted" of a fit; "" where there is none.
        named, suspected: effects.
        values: parameter, as "effect.parameter" where it is an effect's -> (SI value, unit).
        doubts: why a name contradicts itself, in words.
    """

    verdict: str
    named: tuple[str, ...] = ()
    suspected: tuple[str, ...] = ()
    values: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()


def score(row: Row, answer: Answer) -> str:
    """ "accept", "tolerate", "reject" or "none"."""
    if not answer.verdict:
        return "none"
    if row.reject.intersection(answer.named):
        return "reject"
    if any(_matches(pattern, answer) for pattern in row.accept):
        return "tolerate" if answer.doubts else "accept"
    if any(_matches(pattern, answer) for pattern in row.tolerate):
        return "tolerate"
    return "none" if answer.verdict == "unexplained" else "reject"


def _matches(pattern: Pattern, answer: Answer) -> bool:
    told = answer.named or answer.suspected
    if answer.verdict not in pattern.verdicts or not all(_among(name, told) for name in pattern.names):
        return False
    if "*" not in pattern.beside:
        allowed = pattern.names | pattern.beside
        if any(name not in allowed and name.partition("@")[0] not in allowed for name in told):
            return False
    return all(
        name in answer.values and pattern.within(name, *answer.values[name]) for name in pattern.values
    )


def _among(name: str, told: Collection[str]) -> bool:
    """Is it told, at any site where the table states none?"""
    return any(name in (one, one.partition("@")[0]) for one in told)


def diagnosed(document: Mapping[str, Any]) -> Answer:
    """What a diagnosis.json tells."""
    named = [f for f in document["findings"] if f["effect"] is not None]
    suspected = [one["effect"] for f in document["findings"] for one in f["suspected"]]
    values = {
        f"{f['effect']}.{name}": (p["value"], p["unit"])
        for f in named
        for name, p in f["parameters"].items()
        if p["value"] is not None
    }
    doubts = tuple(doubt for f in named for doubt in _doubts(f))
    return Answer(document["verdict"], tuple(f["effect"] for f in named), tuple(suspected), values, doubts)


def fitted(document: Mapping[str, Any]) -> Answer:
    """What a fit.json tells."""
    values = {name: (p["value"], p["unit"]) for name, p in document["parameters"].items()}
    return Answer("fitted", values=values)


def _doubts(finding: Mapping[str, Any]) -> list[str]:
    name, p = finding["effect"], finding["evidence"]["p_value"]
    doubts = [] if p is not None and p <= LEVEL else [f"{name}: p = {p}"]
    effect = find_effect(name, Path())
    null, told = effect.at_null(), finding["parameters"]
    makes = [part for part in effect.strength if part in told]
    if makes and all(_holds(told[part]["ci95"], null[part]) for part in makes):
        doubts.append(f"{name}: its interval holds its null")
    return doubts


def _holds(ci: list[float | None], null: float) -> bool:
    low, high = ci
    return (low is None or low <= null) and (high is None or null <= high)
