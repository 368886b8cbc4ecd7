"""Detection of oscillations of a loop: counts large reversals of the command."""

from __future__ import annotations

SWING = 0.15  # of the command's range: a reversal counts after a return by this much
MEMORY = 1.0  # s over which reversals are counted, with exponential weights
TOO_MANY = 10.0  # reversals: a step response has three or four, a loop near instability continues


class OscillationDetector:
    """Reversals of the command in the last second.

    Args:
        span: sampling time, s.
        size: range of the command.
    """

    def __init__(self, span: float, size: float) -> None:
        self._fade, self._swing = 1.0 - span / MEMORY, SWING * size
        self._extreme, self._way, self.turns = 0.0, 0.0, 0.0

    def add(self, command: float) -> bool:
        """Process one command; True while the loop oscillates."""
        self.turns *= self._fade
        ahead = (command - self._extreme) * self._way
        if self._way == 0.0:
            if abs(command - self._extreme) > self._swing:
                self._way = 1.0 if command > self._extreme else -1.0
                self._extreme = command
        elif ahead >= 0.0:
            self._extreme = command
        elif ahead < -self._swing:
            self._way, self._extreme = -self._way, command
            self.turns += 1.0
        return self.turns > TOO_MANY

    def forget(self) -> None:
        """Restart."""
        self.turns = 0.0
