"""Communication of session, guard and loop: JSON messages for commands and events, packed numbers for samples."""

from __future__ import annotations

import contextlib
import json
import os
import select
import time
from multiprocessing.connection import Connection, wait
from typing import Any

from optid.errors import InputError
from optid.live.messages import LoopLost, Reply, Sample, pack_sample, unpack_reply

HANG = 10.0  # s without a response after which a session without a clock gives up


def send(pipe: Connection, **message: Any) -> None:
    """Send a message; a closed pipe is not an error."""
    with contextlib.suppress(OSError):
        pipe.send_bytes(json.dumps(message).encode())


def receive(pipe: Connection) -> dict[str, Any]:
    """Wait for the next message.

    Raises:
        EOFError, OSError: the other process has ended.
    """
    message: dict[str, Any] = json.loads(pipe.recv_bytes())
    return message


def ready(pipes: list[Connection], timeout: float | None) -> list[Any]:
    """Connections with something to read; `select`, where available, is ten times faster than the general way."""
    if os.name == "posix":
        return select.select(pipes, [], [], timeout)[0]
    return wait(pipes, timeout)


def refuse(pipe: Connection, error: Exception, safe: bool = True) -> None:
    """Report that the session cannot begin, and whether the user's files are the cause."""
    wrong = isinstance(error, InputError)
    why = str(error) if wrong else f"{type(error).__name__}: {error}"
    send(pipe, say="refused", why=why, input=wrong, safe=safe)


class PipeLink:
    """The guard's end of the pipe to the loop."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def send(self, sample: Sample) -> None:
        """Send a sample."""
        try:
            self._pipe.send_bytes(pack_sample(sample))
        except OSError as error:
            raise LoopLost("it closed the link") from error

    def receive(self, number: int, timeout: float | None) -> Reply | None:
        """The reply to this sample; late replies to earlier ones are dropped."""
        end = time.perf_counter() + (HANG if timeout is None else timeout)
        try:
            while ready([self._pipe], max(end - time.perf_counter(), 0.0)):
                reply = unpack_reply(self._pipe.recv_bytes())
                if reply.number == number:
                    return reply
        except (EOFError, OSError) as error:
            raise LoopLost("it closed the link") from error
        return None
