"""The result of every reader: the columns that the rig file maps, and the names of the others."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optid.core.readers.limits import LONGEST_NAME, NAMES, shown

Raw = NDArray[Any]
FORMATS = "CSV, Parquet, MATLAB .mat, HDF5, TDMS, MDF or MCAP"
EXTRA = 'run pip install "optid[formats]"'


def by_row(row: int) -> str:
    """Where a row stands (counted from 0 here), for a file that has no lines."""
    return f"row {row + 1}"


@dataclass(frozen=True, eq=False)
class Clock:
    """When the samples of one column were taken.

    Attributes:
        origin: ns since 1970 to which `seconds` count, 0 where the file does not say.
        seconds: shape (samples,), increasing.
        in_rig_unit: they are in the unit that the rig file states for the time, not yet in seconds.
    """

    seconds: NDArray[np.float64]
    origin: int = 0
    in_rig_unit: bool = False


@dataclass(frozen=True, eq=False)
class Column:
    """One signal as the file has it.

    Attributes:
        values: shape (samples,): numbers, durations (timedelta64), stamps (datetime64) or text.
        clock: its own, where the file gives each signal one.
        unit: as the file states it; empty where it does not.
    """

    values: Raw
    clock: Clock | None = None
    unit: str = ""


@dataclass(frozen=True, eq=False)
class Table:
    """The requested columns of a file.

    Attributes:
        columns: requested name -> column; only those that were found.
        names: names in the file, for messages; possibly not all.
        reader: name of the format.
        about: what was recognised beyond the format ("a TwinCAT Scope export, its table begins in line 14").
        left_out: name -> why it cannot be read, "has ..." or "is ...".
        notes: what was skipped, in words.
        place: where a row stands, "line 12".
    """

    columns: Mapping[str, Column]
    names: Sequence[str]
    reader: str
    about: str = ""
    left_out: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    place: Callable[[int], str] = by_row


def offered(name: str, names: Iterable[str]) -> str:
    """The name that was probably meant, or some of the existing ones; bounded, whatever the file holds."""
    known = sorted({shown(other) for other in names})
    close = difflib.get_close_matches(name[:LONGEST_NAME], known[:2000], n=1, cutoff=0.6)
    if close:
        return f'did you mean "{close[0]}"?'
    more = f" and {len(known) - NAMES} more" if len(known) > NAMES else ""
    return f"valid names: {', '.join(known[:NAMES])}{more}" if known else "there are none"
