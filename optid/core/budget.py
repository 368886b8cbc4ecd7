"""The budget of a job: its own processor time, so that load does not change answers, and a wall-clock deadline."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace
from typing import Self


@dataclass(frozen=True)
class Budget:
    """A limit on the process's own time and a wall-clock deadline, both counted from when it was made.

    Attributes:
        time_limit: s of processor time, all threads together.
        deadline: s of wall-clock time.
    """

    time_limit: float = math.inf
    deadline: float = math.inf
    _began: tuple[float, float] = field(default_factory=lambda: (time.process_time(), time.monotonic()))

    @property
    def spent(self) -> float:
        """Processor time since it was made, s."""
        return time.process_time() - self._began[0]

    @property
    def is_over(self) -> bool:
        """Whether a limit is reached; then the best result so far is used."""
        return self.spent > self.time_limit or time.monotonic() - self._began[1] > self.deadline

    def share(self, part: float) -> Self:
        """The same clock, with this share of both limits."""
        return replace(self, time_limit=part * self.time_limit, deadline=part * self.deadline)


UNLIMITED = Budget()
