"""ASAM MDF of version 3 and 4, as CANape, INCA, ControlDesk and data loggers write it. Each group has its clock."""

from __future__ import annotations

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.readers.limits import Budget
from optid.core.readers.table import Clock, Column, Table
from optid.errors import RecordingError

EXTRA = 'run pip install "optid[logs]"'


def read(data: bytes, path: Path, wanted: tuple[str, ...], budget: Budget) -> Table:
    """The requested channels of an MDF file, each with its group's clock.

    They are named by the channel, or "2/NAME" for that of the third group where several groups have it.

    Raises:
        RecordingError: truncated or damaged, or asammdf is not installed.
    """
    try:
        from asammdf import MDF
    except ImportError as error:
        broken = (
            ""
            if isinstance(error, ModuleNotFoundError)
            else f" (it is installed but cannot be imported: {error})"
        )
        raise RecordingError(f"MDF files need asammdf{broken}", where=path, hint=EXTRA) from None
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)
    if b"HD" not in data[64:68]:  # where both versions have their header
        raise RecordingError("the MDF data is truncated", where=path, expected="a complete file")
    columns: dict[str, Column] = {}
    left_out: dict[str, str] = {}
    try:
        with MDF(io.BytesIO(data)) as file:
            names = [str(name) for name in file.channels_db]
            origin = int(file.start_time.timestamp()) * 10**9 if file.start_time else 0
            for name in wanted:
                places = _places(file, name)
                found = _column(file, places, origin, budget) if places else None
                if isinstance(found, str):
                    left_out[name] = found
                elif found is not None:
                    columns[name] = found
    except RecordingError:
        raise
    except Exception as error:  # damaged bytes make asammdf raise exceptions of any kind
        reason = " ".join(f"{type(error).__name__} {error}".split())[:120]
        raise RecordingError(
            f"the MDF data is truncated or damaged ({reason})", where=path, expected="a complete file"
        ) from None
    return Table(columns, names, "mdf", "", left_out)


def _places(file: Any, name: str) -> list[tuple[int, int]]:
    """(group, index) of the channels of a name."""
    if name in file.channels_db:
        return list(file.channels_db[name])
    group, _, rest = name.partition("/")
    return [place for place in file.channels_db.get(rest, ()) if group == str(place[0])]


def _column(file: Any, places: list[tuple[int, int]], origin: int, budget: Budget) -> Column | str:
    masters = [place for place in places if file.masters_db.get(place[0]) == place[1]]
    if len(places) > 1 and len(masters) < len(places):
        groups = " or ".join(f"{group}/..." for group, _ in places[:4])
        return f"is in {len(places)} groups: select one by its number, {groups}"
    group, index = places[0]
    budget.take(int(file.groups[group].channel_group.cycles_nr) * 16, f"channel {index} of group {group}")
    signal = file.get(group=group, index=index, raw=False)
    values, times = np.asarray(signal.samples), np.asarray(signal.timestamps, dtype=np.float64)
    if values.ndim != 1 or values.dtype.kind not in "iufb":
        return "holds text" if values.dtype.kind in "SUO" else f"holds arrays of shape {values.shape[1:]}"
    if not len(values):
        return "holds no samples"
    clock = Clock(times, origin) if len(times) > 1 and bool((np.diff(times) > 0).all()) else None
    return Column(values, clock, str(signal.unit or ""))
