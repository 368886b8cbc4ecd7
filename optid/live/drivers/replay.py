"""A recording in place of a rig: it returns what was measured and ignores commands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optid.core.readers import read_recording
from optid.errors import InputError
from optid.live.driver import EndOfData, Order


class Replay:
    """Samples of a recording in order, one at each read.

    The session's rate is the recording's own, so it runs in recorded time unless the session is fast.
    """

    def __init__(self, order: Order) -> None:
        if order.recording is None:
            raise InputError(
                "no recording to replay is given", where="--recording", expected="a recording of the rig"
            )
        record = read_recording(order.recording, order.rig)
        columns = [(record[c.role].values - c.shift) / c.factor for c in order.wiring.measured]
        command = order.wiring.command
        self._rows = np.column_stack(columns).tolist()
        self._commands = ((record[command.role].values - command.shift) / command.factor).tolist()
        self._at = 0

    def read(self, time: float) -> Sequence[float]:
        """The next row."""
        if self._at == len(self._rows):
            raise EndOfData("the recording is over")
        row: Sequence[float] = self._rows[self._at]
        self._at += 1
        return row

    def write(self, command: float, time: float) -> float:
        """Ignore the command; returns the recorded one."""
        return float(self._commands[self._at - 1]) if self._at else command

    def close(self) -> None:
        """Nothing to close."""


def replay(order: Order) -> Replay:
    """The recording of the session's `--recording`."""
    return Replay(order)
