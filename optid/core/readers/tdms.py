"""NI TDMS, the format of LabVIEW, DIAdem and FlexLogger."""

from __future__ import annotations

import io
import logging
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.readers.libraries import library
from optid.core.readers.limits import Budget
from optid.core.readers.table import Clock, Column, Table
from optid.errors import RecordingError

_TIMES = ("time", "t", "zeit", "timestamp", "x_value", "x_values")


def read(data: bytes, path: Path, wanted: tuple[str, ...], budget: Budget) -> Table:
    """The requested channels of a TDMS file, each with its waveform's clock where it has one.

    They are named by the channel, or "group/channel" where two groups share it.

    Raises:
        RecordingError: truncated or damaged, no channels, or npTDMS is not installed.
    """
    nptdms = _library(path)
    try:
        with nptdms.TdmsFile.open(io.BytesIO(data)) as file:
            incomplete = bool(getattr(file.file_status, "incomplete_final_segment", False))
            channels = [(group.name, channel) for group in file.groups() for channel in group.channels()]
            names = _names([(group, channel.name) for group, channel in channels])
            columns, left_out = {}, {}
            for (group, channel), name in zip(channels, names, strict=True):
                for asked in {name, f"{group}/{channel.name}"} & set(wanted):
                    column = _column(channel, budget)
                    if isinstance(column, str):
                        left_out[asked] = column
                    else:
                        columns[asked] = _with_time_of_group(column, channel, channels, budget)
    except RecordingError:
        raise
    except Exception as error:  # damaged bytes make npTDMS raise exceptions of any kind
        reason = " ".join(f"{type(error).__name__} {error}".split())[:120]
        raise RecordingError(
            f"the TDMS data is truncated or damaged ({reason})", where=path, expected="a complete file"
        ) from None
    if incomplete:
        raise RecordingError("the TDMS data ends in the middle", where=path, expected="a complete file")
    if not channels:
        raise RecordingError("the TDMS file has no channels", where=path, expected="at least one channel")
    twice = {name for name, count in Counter(channel.name for _, channel in channels).items() if count > 1}
    for name in wanted:
        if name in twice:
            groups = [n for n in names if n.endswith(f"/{name}")]
            left_out[name] = f"is in {len(groups)} groups: select one, {' or '.join(groups[:4])}"
    return Table(columns, names, "tdms", "", left_out)


def _library(path: Path) -> Any:
    nptdms = library("nptdms", "npTDMS", "TDMS files", path)
    _quiet()
    return nptdms


def _names(channels: list[tuple[str, str]]) -> list[str]:
    times = Counter(name for _, name in channels)
    return [name if times[name] == 1 else f"{group}/{name}" for group, name in channels]


def _column(channel: Any, budget: Budget) -> Column | str:
    size = len(channel)
    if not size:
        return "holds no samples"
    budget.take(size * 8, f'the channel "{channel.name}"')
    values = np.asarray(channel[:])
    properties = channel.properties
    unit = str(properties.get("unit_string", ""))
    step = properties.get("wf_increment")
    if not isinstance(step, int | float) or not step > 0:
        return Column(values, unit=unit)
    begun = properties.get("wf_start_time")
    origin = 0 if begun is None else int(np.datetime64(begun, "ns").astype(np.int64))
    first = float(properties.get("wf_start_offset", 0.0) or 0.0)
    return Column(values, Clock(first + np.arange(size, dtype=np.float64) * float(step), origin), unit)


def _with_time_of_group(
    column: Column, channel: Any, channels: list[tuple[str, Any]], budget: Budget
) -> Column:
    """With the clock of the time channel in its group, where it has no waveform's clock."""
    group = [one for _, one in channels if one.group_name == channel.group_name and one.name != channel.name]
    times = next((one for one in group if one.name.lower() in _TIMES and len(one) == len(channel)), None)
    if column.clock is not None or times is None or channel.name.lower() in _TIMES:
        return column
    budget.take(len(times) * 8, f'the channel "{times.name}"')
    raw = np.asarray(times[:])
    if raw.dtype.kind not in "iuf" or len(raw) < 2 or not bool((np.diff(raw) > 0).all()):
        return column
    return replace(column, clock=Clock(raw.astype(np.float64), in_rig_unit=True))


def _quiet() -> None:
    """Suppress npTDMS's own warnings on the terminal: errors that matter are raised above."""
    for name in list(logging.root.manager.loggerDict):
        if name.startswith("nptdms."):
            logging.getLogger(name).setLevel(logging.ERROR)
