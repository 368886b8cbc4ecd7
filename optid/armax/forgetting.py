"""Forgetting of old samples: three laws, each a frozen record that writes its numbers into the packed state."""

from __future__ import annotations

from dataclasses import dataclass

from optid.armax.layout import FACTOR, FORGETTING, MEMORY
from optid.core.model import Array
from optid.errors import InputError


def _check(factor: float, field: str) -> None:
    if not 0.5 <= factor <= 1.0:
        raise InputError(f"{factor}", field=field, expected="a factor from 0.5 to 1")


@dataclass(frozen=True)
class Constant:
    """Every sample has `factor` times the weight of the next; 1 means no forgetting."""

    factor: float = 1.0

    def write(self, state: Array) -> None:
        """Put the law's numbers into a packed state."""
        _check(self.factor, "forgetting factor")
        state[FORGETTING], state[FACTOR], state[MEMORY] = 0.0, self.factor, 0.0


@dataclass(frozen=True)
class Variable:
    """Forget faster while innovations are larger than usual, down to `lowest`.

    Fortescue, Kershenbaum and Ydstie, Automatica 17 (1981) 831: the factor keeps the information in a memory
    of `samples` constant. The usual size of an innovation is its own average over ten memories.
    """

    samples: float = 1000.0
    lowest: float = 0.95

    def write(self, state: Array) -> None:
        """Put the law's numbers into a packed state."""
        _check(self.lowest, "lowest forgetting factor")
        if not self.samples >= 1.0:
            raise InputError(f"{self.samples}", field="memory", expected="at least one sample")
        state[FORGETTING], state[FACTOR], state[MEMORY] = 0.0, self.lowest, self.samples


@dataclass(frozen=True)
class Directional:
    """Forget only in the direction in which a sample gives information; other directions are kept.

    Kulhavý and Kárný, Tracking of slowly varying parameters by directional forgetting, IFAC Congress 1984.
    """

    factor: float = 0.99

    def write(self, state: Array) -> None:
        """Put the law's numbers into a packed state."""
        _check(self.factor, "forgetting factor")
        state[FORGETTING], state[FACTOR], state[MEMORY] = 1.0, self.factor, 0.0


Forgetting = Constant | Variable | Directional
