"""Messages between guard and loop, one pair a sample: a few dozen bytes, packed by `struct`."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple, Protocol

_HEAD, _REPLY = struct.Struct("<q3d"), struct.Struct("<q6d")


class Sample(NamedTuple):
    """From the guard: sample number, its time (s), the command that stood since the last one (V), what was measured.

    `values` are in the units of the rig file's columns; the commands are SI. `accepted` is what the driver was given,
    unless it put something else by more than a converter's rounding: what a controller goes on from.
    """

    number: int
    time: float
    standing: float
    accepted: float
    values: Sequence[float]


class Reply(NamedTuple):
    """From the loop, SI: the command for this sample and what goes into the log with it.

    Attributes:
        number: of the sample it answers.
        command: V.
        reference: m.
        predicted: by the ARMAX model one sample ago.
        simulated: by the physical model in a loop of its own.
        windowed: by the physical model on the rig's command, from a state at most half a second old.
        seconds: that the numbers took.
    """

    number: int
    command: float
    reference: float
    predicted: float
    simulated: float
    windowed: float
    seconds: float


class LoopLost(ConnectionError):
    """The loop has gone."""


class Link(Protocol):
    """The guard's end."""

    def send(self, sample: Sample) -> None:
        """Hand a sample to the loop.

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
