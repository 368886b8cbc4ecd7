"""Cells of a text table: what a number, nothing, a date or a time of day looks like, and columns made of them."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optid.core.readers.stamp_text import LONGEST, parsed

# Written where there is no value; pandas knows most of them.
MISSING = (
    "",
    "nan",
    "-nan",
    "NaN",
    "-NaN",
    "NAN",
    "NA",
    "N/A",
    "n/a",
    "<NA>",
    "#N/A",
    "#N/A N/A",
    "#NA",
    "null",
    "NULL",
    "Null",
    "none",
    "None",
    "NONE",
    "-",
    "--",
    "---",
    "*",
    "?",
    "1.#QNAN",
    "-1.#IND",
    "1.#IND",
    "-1.#QNAN",
    "nan(ind)",
    "-nan(ind)",
    "#NV",
    "#NUM!",
    "#VALUE!",
    "#DIV/0!",
    "#REF!",
    "No Data",
    "NoData",
    "no data",
    "Bad",
    "BAD",
    "Invalid",
    "invalid",
    "BURNOUT",
    "Burnout",
    "OVER",
    "UNDER",
    "OVERRANGE",
    "Overflow",
    "OVERFLOW",
    "+++++++",
    "-------",
    "*****",
    "******",
)
_MISSING = frozenset(MISSING)
_NUMBER = re.compile(r"(?:[-+] {0,12})?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eEdD][-+]?\d+)?")
_GROUPED = re.compile(r"[-+]?\d{1,3}(?:[ '.,\u00a0\u2009\u202f]\d{3})+(?:[.,]\d*)?")
_SPECIAL = re.compile(r"[-+]?(?:inf|infinity|nan|∞|true|false)", re.IGNORECASE)
# "12.5 mm", "3 %": a unit that stands in every cell of a column.
_SUFFIXED = re.compile(rf"({_NUMBER.pattern})\s?([A-Za-zµμ°%Ω‰][\w/²³^%°·*]{{0,9}})")
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:[.,]\d{3})+")
COMMA_DECIMAL = re.compile(r"[-+]?\d*,\d+(?:[eEdD][-+]?\d+)?")


def is_missing(cell: str) -> bool:
    """Nothing, or a word for nothing."""
    return cell in _MISSING


def is_number(cell: str) -> bool:
    """A number with a decimal point or comma, possibly grouped, or a word for one that is not finite."""
    if len(cell) > LONGEST:
        return False
    return bool(_NUMBER.fullmatch(cell) or _GROUPED.fullmatch(cell) or _SPECIAL.fullmatch(cell))


def is_stamp(cell: str) -> bool:
    """A date, a time of day, or both."""
    return bool(cell) and (cell[-1:].isdigit() or not cell.isalpha()) and parsed(cell) is not None


def is_value(cell: str) -> bool:
    """What a row of data holds in a mapped column."""
    return is_number(cell) or is_stamp(cell) or unit_of(cell) is not None


def unit_of(cell: str) -> str | None:
    """The unit behind a number in one cell, "12.5 mm"; None where a cell is something else."""
    match = _SUFFIXED.fullmatch(cell) if len(cell) <= LONGEST else None
    return match[2] if match else None


def without_unit(cells: NDArray[Any]) -> tuple[NDArray[Any], str]:
    """A column of texts without the unit that stands behind each number, and that unit; empty if they differ."""
    texts = [_text(cell) for cell in cells]
    units = {unit_of(text) for text in texts if not is_missing(text)}
    unit = units.pop() if len(units) == 1 else None
    if unit is None:
        return cells, ""
    return np.array([text.removesuffix(unit).rstrip() for text in texts], dtype=object), unit


class Unreadable(ValueError):
    """A column holds a cell that is no number.

    Attributes:
        row: of the first such cell, counted from 0.
        found: the cell, or what is ambiguous about it.
    """

    def __init__(self, row: int, found: str, ambiguous: bool = False) -> None:
        self.row, self.found, self.ambiguous = row, found, ambiguous
        super().__init__(found)


def numbers(cells: NDArray[Any], comma_elsewhere: bool) -> NDArray[np.float64]:
    """A column of texts (or of texts and numbers) as numbers, its decimal sign decided from all of them.

    Args:
        cells: shape (rows,), objects; None and NaN are missing.
        comma_elsewhere: other columns of the table have decimal commas, so that "1.000" may be a thousand.

    Raises:
        Unreadable: names the first cell that is no number.
    """
    texts = [_text(cell) for cell in cells]
    known = [(row, text) for row, text in enumerate(texts) if not is_missing(text)]
    for row, text in known:
        if not is_number(text):
            raise Unreadable(row, text)
    point = _decimal_sign(known, comma_elsewhere)
    group = ",'\u00a0\u2009\u202f " if point == "." else ".'\u00a0\u2009\u202f "
    drop = str.maketrans({**dict.fromkeys(group), point: ".", "d": "e", "D": "e", "∞": "inf"})
    values = np.full(len(texts), np.nan)
    for row, text in known:
        try:
            values[row] = (
                _BOOLEANS.get(text.lower()) if text.lower() in _BOOLEANS else float(_plain(text, drop))
            )
        except ValueError:
            raise Unreadable(row, text) from None
    return values


_BOOLEANS = {"true": 1.0, "false": 0.0}


def _plain(text: str, drop: dict[int, str | None]) -> str:
    return text if text.lower().lstrip("+-") in ("inf", "infinity", "nan") else text.translate(drop)


def _text(cell: object) -> str:
    if cell is None or cell != cell:  # NaN
        return ""
    return cell.strip().strip('"').strip() if isinstance(cell, str) else repr(cell)


def _decimal_sign(known: Iterable[tuple[int, str]], comma_elsewhere: bool) -> str:
    """ "." or ",", as the whole column has it.

    A column with both signs has as its decimal sign the one that comes last.
    """
    commas = points = False
    thousands: tuple[int, str] | None = None
    plain = True  # every value with a point could be grouped thousands
    for row, text in known:
        comma, point = text.rfind(","), text.rfind(".")
        if comma >= 0 and point >= 0:
            return "," if comma > point else "."
        if text.count(",") > 1 or text.count(".") > 1:
            return "." if comma >= 0 else ","
        commas, points = commas or comma >= 0, points or point >= 0
        if point >= 0:
            if _THOUSANDS.fullmatch(text):
                thousands = thousands or (row, text)
            else:
                plain = False
    if commas and points:
        return ","  # 999,5 and 1.000: grouped thousands
    if points and plain and comma_elsewhere and thousands is not None:
        raise Unreadable(*thousands, ambiguous=True)
    return "," if commas else "."
