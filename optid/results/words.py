"""Tables of text, for terminals and notebooks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from optid.core.quantity import plain, quantity, reading


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines with columns as wide as their widest cell."""
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in (head, *rows)
    ]


def score_rows(scores: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """Role, fit and rmse in words, one row per channel."""
    return [
        (role.replace("_", " "), percent(score["fit_percent"]), error(score["rmse"], score["unit"]))
        for role, score in scores.items()
    ]


def percent(value: float | None) -> str:
    """A share in per cent; a dash where there is none."""
    return "–" if value is None else f"{value:.2f} %"


def error(value: float | None, unit: str) -> str:
    """A root mean square error with its unit; a dash where there is none."""
    return "–" if value is None else quantity(value, unit)


def parameter_rows(
    parameters: Mapping[str, Mapping[str, Any]], marks: Mapping[str, str]
) -> list[tuple[str, ...]]:
    """Name, value, 95 % interval and a mark of each parameter."""
    return [(name, *_value(entry), marks.get(name, "")) for name, entry in parameters.items()]


def _value(entry: Mapping[str, Any]) -> tuple[str, str]:
    """The value and its interval, in the unit that suits the value."""
    factor, shown = reading(entry["value"], entry["unit"])
    low, high = ("open" if end is None else plain(end * factor, 5) for end in entry["ci95"])
    return f"{plain(entry['value'] * factor, 5)} {shown}".rstrip(), f"{low} to {high}"
