"""A column of dates, times of day or durations as seconds."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from optid.core.readers.cells import Unreadable, is_missing
from optid.core.readers.stamp_text import DAY, day_of, parsed

Integers = NDArray[np.int64]
MISSING = np.iinfo(np.int64).min  # what NumPy holds for "not a time"


def seconds_of(cells: NDArray[Any]) -> tuple[Integers, bool]:
    """A column of stamps as ns, each from 1970 if it holds dates, else from midnight or from a start.

    Day and month are distinguished by the separator ("." has the day first) and by their size; with "/" the order that
    makes the times increase is used, the month first if both do.

    Args:
        cells: shape (rows,), texts; None and NaN are missing.

    Returns:
        ns, shape (rows,), `MISSING` where a cell is empty; and whether they hold dates.

    Raises:
        Unreadable: names the first cell that is no stamp.
    """
    dates, times = list[str](), np.full(len(cells), MISSING, dtype=np.int64)
    for row, cell in enumerate(cells):
        text = "" if cell is None or cell != cell else str(cell).strip().strip('"').strip()
        found = None if is_missing(text) else parsed(text)
        if found is None and not is_missing(text):
            raise Unreadable(row, text)
        dates.append(found[0] if found else "")
        times[row] = found[1] if found else MISSING
    if not any(dates):
        return times, False
    first = _with_days(dates, times, day_first=False)
    if first is None or not _increasing(first):
        second = _with_days(dates, times, day_first=True)
        if second is not None and (first is None or _increasing(second)):
            first = second
    if first is None:
        row = next(k for k, date in enumerate(dates) if date and day_of(date, True) is None)
        raise Unreadable(row, dates[row])
    return first, True


def _increasing(times: Integers) -> bool:
    return bool((np.diff(times[times != MISSING]) >= 0).all())


def _with_days(dates: list[str], times: Integers, day_first: bool) -> Integers | None:
    days = {date: day_of(date, day_first) if date else 0 for date in set(dates)}
    if any(day is None for day in days.values()):
        return None
    begun = np.array([days[date] for date in dates], dtype=np.int64) * DAY
    return np.where(times == MISSING, MISSING, times + begun)
