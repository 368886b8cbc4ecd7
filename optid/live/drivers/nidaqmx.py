"""National Instruments cards, as on the paper's rig, through NI's own package: `pip install "optid[nidaqmx]"`.

    [live.nidaqmx]
    command = { channel = "Dev1/ao0" }
    position = { channel = "Dev1/ai0", per_volt = "52 mm", zero = "2.5 V", range = ["0 V", "5 V"] }
    average = 8                  # samples of the card in one of the session's; 1 where absent
    sample_rate = "50 kHz"       # of the card then; "average" times the session's rate where absent

Samples are read and written on demand, at the guard's clock, so any card can be used. With an average the card samples
continuously by its own clock, and each reading is the mean of its newest samples: the delay is half their span.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.recording import ChannelMap
from optid.core.units import shown, to_si
from optid.errors import RigError
from optid.live.driver import Order, needed
from optid.rigs.fields import Table, known_keys, subtable, text

TIMEOUT = 0.05  # s that a card may take for one sample
MOST = 10_000  # samples in an average
BUFFERED = 10  # number of averages in the card's buffer
TERMINALS = ("DEFAULT", "RSE", "NRSE", "DIFF", "PSEUDO_DIFF")


@dataclass(frozen=True)
class Line:
    """One line of a card: column value = (volts - zero) * per_volt, and its range in volts."""

    channel: str
    per_volt: float
    zero: float
    low: float
    high: float
    terminal: str


@dataclass(frozen=True)
class Average:
    """Number of the card's samples in a reading, and their rate in Hz."""

    samples: int
    rate: float


class Cards:
    """One task reads all inputs, another writes the command; both run from start to end.

    Args:
        module: NI's package.
        command, inputs: lines.
        average: of a reading; ``None`` for one sample on demand.
    """

    def __init__(
        self, module: Any, command: Line, inputs: Sequence[Line], average: Average | None = None
    ) -> None:
        self._command, self._inputs = command, tuple(inputs)
        self._many = np.empty((len(inputs), average.samples)) if average else None
        self._tasks: list[Any] = []
        try:
            reading, writing = self._task(module), self._task(module)
            for line in inputs:
                reading.ai_channels.add_ai_voltage_chan(
                    line.channel,
                    min_val=line.low,
                    max_val=line.high,
                    terminal_config=module.constants.TerminalConfiguration[line.terminal],
                )
            if average is not None:
                _newest(module, reading, average)
            writing.ao_channels.add_ao_voltage_chan(
                command.channel, min_val=command.low, max_val=command.high
            )
            self._reader = module.stream_readers.AnalogMultiChannelReader(reading.in_stream)
            self._writer = module.stream_writers.AnalogSingleChannelWriter(
                writing.out_stream, auto_start=False
            )
            self._reader.verify_array_shape = False
            reading.start()
            writing.start()
            if average is not None:  # the card cannot read samples from before its start
                clock.sleep((average.samples + 1) / average.rate)
        except Exception:
            self.close()
            raise
        self._volts = np.empty(len(inputs))
        self._per_volt = np.array([line.per_volt for line in inputs])
        self._zero = np.array([line.zero for line in inputs])

    def _task(self, module: Any) -> Any:
        self._tasks.append(module.Task())
        return self._tasks[-1]

    def read(self, time: float) -> Sequence[float]:
        """One reading of every input."""
        if self._many is None:
            self._reader.read_one_sample(self._volts, timeout=TIMEOUT)
        else:
            self._reader.read_many_sample(self._many, self._many.shape[1], timeout=TIMEOUT)
            self._many.mean(axis=1, out=self._volts)
        values: list[float] = ((self._volts - self._zero) * self._per_volt).tolist()
        return values

    def write(self, command: float, time: float) -> float:
        """Write one sample of the command, within the card's range."""
        line = self._command
        volts = min(max(command / line.per_volt + line.zero, line.low), line.high)
        self._writer.write_one_sample(volts, timeout=TIMEOUT)
        return (volts - line.zero) * line.per_volt

    def close(self) -> None:
        """Close every task, even if closing another one fails."""
        tasks, self._tasks = self._tasks, []
        failed = None
        for task in tasks:
            try:
                task.close()
            except Exception as error:
                failed = error
        if failed is not None:
            raise failed


def _newest(module: Any, task: Any, average: Average) -> None:
    """Sample continuously, and read the newest samples, skipping unread ones."""
    kinds = module.constants
    task.timing.cfg_samp_clk_timing(
        average.rate,
        sample_mode=kinds.AcquisitionType.CONTINUOUS,
        samps_per_chan=max(BUFFERED * average.samples, 1000),
    )
    task.in_stream.relative_to = kinds.ReadRelativeTo.MOST_RECENT_SAMPLE
    task.in_stream.offset = -average.samples
    task.in_stream.overwrite = kinds.OverwriteMode.OVERWRITE_UNREAD_SAMPLES


def _average(order: Order, field: str) -> Average | None:
    """The average from the table.

    Raises:
        RigError: not a whole number, or too slow for new samples at each reading.
    """
    where, options = order.rig.path, order.options
    samples, rate = options.get("average", 1), order.settings.rate
    if not isinstance(samples, int) or isinstance(samples, bool) or not 1 <= samples <= MOST:
        raise RigError(
            f"{shown(samples)}",
            where=where,
            field=f"{field}.average",
            expected=f"a whole number, 1 to {MOST}",
        )
    if samples == 1 and "sample_rate" in options:
        raise RigError(
            "without an average", where=where, field=f"{field}.sample_rate", expected="average = 8"
        )
    if samples == 1:
        return None
    least = samples * rate
    fast = least
    if "sample_rate" in options:
        fast = to_si(options["sample_rate"], "Hz", where=where, field=f"{field}.sample_rate")
    if not least * (1 - 1e-9) <= fast < math.inf:
        raise RigError(
            f"{fast:g} Hz",
            where=where,
            field=f"{field}.sample_rate",
            expected=f"at least {least:g} Hz: {samples} samples in each of the session's periods",
        )
    return Average(samples, fast)


def cards(order: Order) -> Cards:
    """The lines of `[live.nidaqmx]`, one for every channel that the rig file maps.

    Raises:
        InputError: the package is not installed.
        RigError: a line is missing or wrong.
    """
    roles = [order.wiring.command.role, *(c.role for c in order.wiring.measured)]
    where, field = order.rig.path, "live.nidaqmx"
    known_keys(order.options, [*roles, "average", "sample_rate"], where, f"{field}.", "role")
    average = _average(order, field)
    limits = order.settings.limits
    command = _line(order.wiring.command, order.options, (limits.low, limits.high), where)
    inputs = [_line(channel, order.options, (-10.0, 10.0), where) for channel in order.wiring.measured]
    module = needed("nidaqmx", "nidaqmx")
    for part in ("constants", "stream_readers", "stream_writers"):
        needed(f"nidaqmx.{part}", "nidaqmx")
    try:
        return Cards(module, command, inputs, average)
    except Exception as error:
        if type(error).__module__.startswith("nidaqmx"):
            raise RigError(f"the card says: {error}", where=where, field=field) from error
        raise


def _line(channel: ChannelMap, options: Table, span: tuple[float, float], where: Path) -> Line:
    """`span`: the range of the line if its entry does not state it."""
    field = f"live.nidaqmx.{channel.role}"
    entry = subtable(options, channel.role, where, field, '{ channel = "Dev1/ai0" }')
    known_keys(entry, ("channel", "per_volt", "zero", "range", "terminal"), where, f"{field}.")
    name = text(entry, "channel", where, field, '{ channel = "Dev1/ai0" }')
    unit, per_column = channel.recorded_unit, channel.factor * channel.per_unit
    if "per_volt" not in entry and unit != "V":
        raise RigError("missing", where=where, field=f"{field}.per_volt", expected=f'per_volt = "1 {unit}"')
    value = entry.get("per_volt", "1 V")
    per_volt = to_si(value, unit, difference=True, where=where, field=f"{field}.per_volt") / per_column
    if per_volt == 0.0:
        raise RigError(f"{shown(value)}", where=where, field=f"{field}.per_volt", expected="not zero")
    zero = to_si(entry["zero"], "V", where=where, field=f"{field}.zero") if "zero" in entry else 0.0
    pair = entry.get("range", [f"{span[0]} V", f"{span[1]} V"])
    if not isinstance(pair, list) or len(pair) != 2:
        raise RigError(
            f"found {shown(pair)}", where=where, field=f"{field}.range", expected='["0 V", "10 V"]'
        )
    low, high = (to_si(value, "V", where=where, field=f"{field}.range") for value in pair)
    terminal = str(entry.get("terminal", "DEFAULT"))
    if terminal not in TERMINALS:
        expected = ", ".join(TERMINALS)
        raise RigError(f'"{terminal}"', where=where, field=f"{field}.terminal", expected=expected)
    return Line(name, per_volt, zero, low, high, terminal)
