"""Messages between guard and loop, one pair per sample: a few dozen bytes, packed by `struct`."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple, Protocol

_HEAD, _REPLY = struct.Struct("<q3d"), struct.Struct("<q6d")


class Sample(NamedTuple):
    """From the guard: sample number, its time (s), the command applied since the last one (V), and the measurements.

    `values` are in the units of the rig file's columns; the commands are SI. `accepted` is the command given to the
    driver, or the one really applied if that differs by more than a converter's rounding; the controller continues
    from it.
    """

    number: int
    time: float
    standing: float
    accepted: float
    values: Sequence[float]


class Reply(NamedTuple):
    """From the loop, SI: the command for this sample and the values for the log.

    Attributes:
        number: of the sample it answers.
        command: V.
        reference: m.
        predicted: by the ARMAX model one sample ago.
        simulated: by the physical model in its own control loop.
        windowed: by the physical model on the rig's command, from a state at most 0.5 s old.
        seconds: of computing time.
    """

    number: int
    command: float
    reference: float
    predicted: float
    simulated: float
    windowed: float
    seconds: float


class LoopLost(ConnectionError):
    """The loop process has ended."""


class Link(Protocol):
    """The guard's end."""

    def send(self, sample: Sample) -> None:
        """Send a sample to the loop.

        Raises:
            LoopLost: the loop has ended.
        """

    def receive(self, number: int, timeout: float | None) -> Reply | None:
        """The reply to this sample; ``None`` when the time (s) is over.

        Raises:
            LoopLost: the loop has ended.
        """


def pack_sample(sample: Sample) -> bytes:
    """As bytes."""
    values = sample.values
    return _HEAD.pack(*sample[:4]) + struct.pack(f"<{len(values)}d", *values)


def unpack_sample(data: bytes) -> Sample:
    """From bytes."""
    number, time, standing, accepted = _HEAD.unpack_from(data)
    values = struct.unpack_from(f"<{(len(data) - _HEAD.size) // 8}d", data, _HEAD.size)
    return Sample(number, time, standing, accepted, values)


def pack_reply(reply: Reply) -> bytes:
    """As bytes."""
    return _REPLY.pack(*reply)


def unpack_reply(data: bytes) -> Reply:
    """From bytes."""
    return Reply(*_REPLY.unpack(data))
