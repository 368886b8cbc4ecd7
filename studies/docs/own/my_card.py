"""A driver of one's own: here a bench that is simulated by hand, in place of a card's two calls."""

from collections.abc import Sequence

from optid.live.driver import Order


class Card:
    """Reads columns and writes the command, in the units of the rig file's columns."""

    def __init__(self, order: Order) -> None:
        self._names = [channel.column for channel in order.wiring.measured]
        self._volts, self._position, self._time = 0.0, 0.0, 0.0

    def read(self, time: float) -> Sequence[float]:
        """One value for each measured column: here an axis that moves 40 mm/s for each volt."""
        self._position += 40.0 * self._volts * (time - self._time)
        self._time = time
        return [self._position for _ in self._names]

    def write(self, command: float, time: float) -> float:
        """Put the command; return what truly stands at the output."""
        self.read(time)
        self._volts = command
        return command

    def close(self) -> None:
        """Let go of the card."""


def card(order: Order) -> Card:
    """What `--driver my_card.py:card` calls."""
    return Card(order)
