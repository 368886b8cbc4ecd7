"""Layouts of measurement programs, oscilloscopes and controllers: how they are recognised, and their peculiarities.

Most need nothing beyond `layout`: facts above the header, units below it, any columns beside the mapped ones. Here are
those whose columns do not mean what a plain table's would, and the names used in error messages.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.core.readers.layout import Layout, bare_name
from optid.core.readers.table import Clock, Column

Columns = dict[int, Column]
Change = Callable[[Layout, Columns], tuple[Columns, tuple[str, ...]]]

_TWINCAT = "a TwinCAT Scope export"
# A column of these names that stands more than once is the clock of what stands right of it.
_CLOCKS = frozenset(
    (
        "name",
        "x_value",
        "x_values",
        "time",
        "t",
        "zeit",
        "timestamp",
        "time_stamp",
        "x",
        "time_s",
        "times",
        "seconds",
    )
)


@dataclass(frozen=True)
class Logger:
    """One kind of file.

    Attributes:
        title: how messages call it.
        mark: what its head holds.
        change: what its columns need, if anything.
    """

    title: str
    mark: re.Pattern[str]
    change: Change | None = None


def _marked(pattern: str) -> re.Pattern[str]:
    return re.compile(pattern, re.MULTILINE | re.IGNORECASE)


def _rigol(layout: Layout, columns: Columns) -> tuple[Columns, tuple[str, ...]]:
    """The first column counts samples; start and increment stand in the row of units."""
    scale = next((row for row in layout.between if row and row[0].lower().startswith("sequence")), None)
    names = [name.lower() for name in layout.names]
    if scale is None or "increment" not in names or 0 not in columns:
        return columns, ()
    at = names.index("increment")
    start = float(scale[at - 1]) if names[at - 1] == "start" else 0.0
    step = float(scale[at])
    counted = columns[0].values.astype(np.float64)
    times = Column(start + step * counted, unit="s")
    return {**columns, 0: times}, (
        f"times are {start:g} s plus {step:g} s a sample, as the file's head says",
    )


LOGGERS = (
    Logger(_TWINCAT, _marked(r"^SymbolComment\b|^Starttime of export|^SampleTime\[ms\]|^Name\t.*\nFile\t")),
    Logger("a LabVIEW measurement file", _marked(r"^LabVIEW Measurement")),
    Logger("a LeCroy oscilloscope's text file", _marked(r"^LECROY")),
    Logger("a Rigol oscilloscope's CSV", _marked(r"^X,CH\d.*Increment"), _rigol),
    Logger(
        "a Tektronix oscilloscope's CSV",
        _marked(r"^Model,(MSO|DPO|MDO|TDS|TBS)|^\"?Record Length\"?,|^TIME,CH\d"),
    ),
    Logger("a Keysight or Agilent oscilloscope's CSV", _marked(r"^x-axis,.*\n\s*second")),
    Logger("a PicoScope CSV", _marked(r"^Time[,;\t]Channel [A-H]")),
    Logger("a Siglent oscilloscope's CSV", _marked(r"^Model Number,SDS|^Second,Value")),
    Logger("a Yokogawa waveform as text", _marked(r"^\"?HEADER SIZE|^\"?TraceName")),
    Logger("a HIOKI recorder's CSV", _marked(r"^\"?HIOKI")),
    Logger("an HBM catman export", _marked(r"HBM[_ ]CATMAN|^catman|DAQ[ -]?job|T0 ?=")),
    Logger("a Dewesoft export", _marked(r"^DEWESoft|Data (?:file|header).*\.d[7x]d|^Events? Type")),
    Logger("an imc FAMOS export", _marked(r"^imc |FAMOS")),
    Logger("a Siemens trace", _marked(r"SINAMICS|STARTER|Startdrive|^TRACE;|TIA Portal|SIMATIC")),
    Logger("a Rockwell trend export", _marked(r"^\"?Header:?\"?,|^\"?Controller Name|^\"?Trend Name")),
    Logger("a B&R Automation Studio trace", _marked(r"Automation Studio|^\"?B&R")),
    Logger("an ibaAnalyzer text export", _marked(r"^\[?iba|ibaAnalyzer|ibaPDA")),
    Logger("a dSPACE ControlDesk CSV", _marked(r"^\"?(trace_values|descriptor|dSPACE|ControlDesk)")),
    Logger("a Vector CANape or CANoe export", _marked(r"CANape|CANoe|CANalyzer")),
    Logger("a ROS topic as CSV", _marked(r"^%time,|^rosbagTimestamp,|^__time,")),
)


def recognised(lines: Sequence[str], layout: Layout) -> Logger | None:
    """The kind of file that the lines above the rows show, if any."""
    head = "\n".join(lines[: min(layout.first, 200)])[: 1 << 16]
    return next((one for one in LOGGERS if one.mark.search(head)), None)


def clock_columns(layout: Layout) -> set[int]:
    """Indices of the columns that are clocks of mapped ones."""
    clocks = clocks_before(layout)
    return {clocks[k] for k in layout.places if k in clocks}


def are_clocks(layout: Layout, indices: Sequence[int]) -> bool:
    """Columns of one name are clocks, each of what stands right of it."""
    return len(indices) > 1 and set(indices) <= set(clocks_before(layout).values())


def clocks_before(layout: Layout) -> dict[int, int]:
    """Column -> the clock left of it, where every column has one: TwinCAT Scope, or a time column mapped twice."""
    mapped = [places for places in layout.found.values() if len(places) > 1]
    times = next((places for places in mapped if bare_name(layout.names[places[0]]).lower() in _CLOCKS), None)
    if times is None and _is_scope(layout):
        times = tuple(k for k, name in enumerate(layout.names) if name == "Name")
    if times is None or times[0] != 0:
        return {}
    return {k: max(t for t in times if t <= k) for k in range(len(layout.names))}


def _is_scope(layout: Layout) -> bool:
    named = sum(name == "Name" for name in layout.names)
    return named > 1 and any(row and row[0].startswith("SampleTime[ms]") for row in layout.between)


def with_clock(column: Column, clock: Column, layout: Layout) -> Column:
    """A column with the times of another; the Scope's are in ms."""
    if clock.values.dtype.kind not in "iuf":
        return column
    scope = _is_scope(layout)
    raw = clock.values.astype(np.float64)
    return replace(column, clock=Clock(raw / 1e3 if scope else raw, in_rig_unit=not scope))
