"""Dates, times of day and durations as seconds."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optid.core.readers.cells import Unreadable, is_missing, is_stamp

Integers = NDArray[np.int64]
DAY = 86_400 * 10**9  # ns
MISSING = np.iinfo(np.int64).min  # what NumPy holds for "not a time"
_CLOCK = re.compile(r"(\d{1,6}):(\d{2})(?::(\d{2}))?(?:[.,:;](\d{1,12}))?\s*(?:([AaPp])\.?[Mm]\.?)?")
_DAYS = re.compile(r"(-)?(?:(\d+) days?,?\s*)?(.*)")
_YEAR_FIRST = re.compile(r"(\d{4})[-/.](\d{1,2})[-/.](\d{1,2})")
_YEAR_LAST = re.compile(r"(\d{1,2})([-/.])(\d{1,2})[-/.](\d{2,4})")
_MONTH_NAMED = re.compile(r"(\d{1,2})[- ]([A-Za-z]{3})[A-Za-z]*[- ](\d{2,4})")
_ZONE = re.compile(r"\s*(?:Z|UTC|GMT|([-+])(\d{2}):?(\d{2})?)$")
_MONTHS = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"]
_GERMAN = {"mär": 3, "mai": 5, "okt": 10, "dez": 12}


def seconds_of(cells: NDArray[Any]) -> tuple[Integers, bool]:
    """A column of stamps as ns, each from 1970 if it holds dates, else from midnight or from a start.

    Day and month are told apart by the sign between them ("." has the day first) and by their size; "/" leaves the
    order open, and that which makes the times increase is taken, the month first if both do.

    Args:
        cells: shape (rows,), texts; None and NaN are missing.

    Returns:
        ns, shape (rows,), `MISSING` where a cell is empty; and whether they hold dates.

    Raises:
        Unreadable: names the first cell that is no stamp.
    """
    texts = ["" if cell is None or cell != cell else str(cell).strip().strip('"').strip() for cell in cells]
    for row, text in enumerate(texts):
        if not is_missing(text) and not is_stamp(text):
            raise Unreadable(row, text)
    first = _nanoseconds(texts, day_first=False)
    if first is None or not _increasing(first[0]):
        second = _nanoseconds(texts, day_first=True)
        if second is not None and (first is None or _increasing(second[0])):
            first = second
    if first is None:
        raise Unreadable(0, texts[0])
    return first


def _increasing(times: Integers) -> bool:
    return bool((np.diff(times[times != MISSING]) >= 0).all())


def _nanoseconds(texts: list[str], day_first: bool) -> tuple[Integers, bool] | None:
    found, days = np.full(len(texts), MISSING, dtype=np.int64), dict[str, int | None]()
    dated = False
    for row, text in enumerate(texts):
        if is_missing(text):
            continue
        date, clock = _parted(text)
        if date not in days:
            days[date] = _day(date, day_first) if date else 0
        day, time = days[date], _time_of_day(clock)
        if day is None or time is None:
            return None
        dated = dated or bool(date)
        found[row] = day * DAY + time
    return found, dated


def _parted(text: str) -> tuple[str, str]:
    """Date and time of day; either may be empty."""
    colon = text.find(":")
    if colon < 0:
        return text, ""
    cut = colon
    while cut and text[cut - 1].isdigit():
        cut -= 1
    date = text[:cut].rstrip(" T_\t")
    return ("", text) if "day" in date or date in ("", "-") else (date, text[cut:])


def _day(date: str, day_first: bool) -> int | None:
    """Days since 1970."""
    numbers: tuple[int, int, int] | None = None
    if match := _YEAR_FIRST.fullmatch(date):
        numbers = int(match[1]), int(match[2]), int(match[3])
    elif match := _YEAR_LAST.fullmatch(date):
        a, b = int(match[1]), int(match[3])
        first_is_day = a > 12 or (b <= 12 and (match[2] == "." or day_first))
        year = int(match[4]) + (2000 if len(match[4]) == 2 else 0)
        numbers = (year, b, a) if first_is_day else (year, a, b)
    elif match := _MONTH_NAMED.fullmatch(date):
        name = match[2].lower()
        month = _MONTHS.index(name) + 1 if name in _MONTHS else _GERMAN.get(name, 0)
        numbers = int(match[3]) + (2000 if len(match[3]) == 2 else 0), month, int(match[1])
    if numbers is None:
        return None
    try:
        return int(np.datetime64("{:04d}-{:02d}-{:02d}".format(*numbers), "D").astype(np.int64))
    except ValueError:
        return None


def _time_of_day(text: str) -> int | None:
    """ns since midnight, with the offset of a time zone taken out; also a duration such as 25:00:00 or 1 day 0:00."""
    if not text:
        return 0
    shift = 0
    if match := _ZONE.search(text):
        if match[1]:
            shift = (int(match[2]) * 60 + int(match[3] or 0)) * (60 if match[1] == "+" else -60)
        text = text[: match.start()]
    sign, days, clock = _DAYS.fullmatch(text.strip()).groups()  # type: ignore[union-attr]
    match = _CLOCK.fullmatch(clock)
    if match is None:
        return None
    large, middle, small, fraction, half = match.groups()
    hours, minutes, seconds = int(large), int(middle), int(small or 0)
    if small is None and fraction is not None:  # minutes, seconds and a fraction
        hours, minutes, seconds = 0, int(large), int(middle)
    if half:
        hours = hours % 12 + (12 if half in "pP" else 0)
    total = ((hours * 60 + minutes) * 60 + seconds - shift) * 10**9
    total += int((fraction or "0")[:9].ljust(9, "0")) + int(days or 0) * DAY
    return -total if sign else total
