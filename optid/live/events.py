"""Events of a session in words: the last few hundred, for the terminal, the page and live.json."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass

KEPT = 200


@dataclass(frozen=True)
class Event:
    """An event: s since the session began, and the words."""

    time: float
    words: str


class Events:
    """The newest events; `number` counts all so far.

    Args:
        clock: the session's time, s; real time where absent.
    """

    def __init__(self, clock: Callable[[], float] | None = None) -> None:
        self._kept: deque[Event] = deque(maxlen=KEPT)
        zero, self.number = time.monotonic(), 0
        self._clock = clock or (lambda: time.monotonic() - zero)

    def note(self, words: str) -> None:
        """Add one that happens now."""
        self._kept.append(Event(self._clock(), words))
        self.number += 1

    def since(self, seen: int) -> list[Event]:
        """The events after the first `seen`, as far as they are still stored."""
        new = min(self.number - seen, len(self._kept))
        return list(self._kept)[len(self._kept) - new :]

    def __iter__(self) -> Iterator[Event]:
        return iter(self._kept)
