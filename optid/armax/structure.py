"""The orders of an ARMAX model, eq. 12."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

from optid.errors import InputError

MOST_PARAMETERS = 512  # more neither fit a processor's cache nor usual amounts of data


@dataclass(frozen=True)
class Orders:
    """Orders and delays of eq. 12.

    Attributes:
        na: poles; 0 makes a moving-average model.
        nb: coefficients of B for each input; empty makes an ARMA model of the output alone.
        nc: coefficients of C; 0 makes an ARX model.
        nk: samples before each input acts, one for each entry of `nb`.
    """

    na: int
    nb: tuple[int, ...] = ()
    nc: int = 0
    nk: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if len(self.nb) != len(self.nk):
            raise InputError(
                f"{len(self.nb)} orders and {len(self.nk)} delays",
                field="nb, nk",
                expected="one pair per input",
            )
        for name, numbers, least in (
            ("na", (self.na,), 0),
            ("nb", self.nb, 1),
            ("nc", (self.nc,), 0),
            ("nk", self.nk, 0),
        ):
            for number in numbers:
                if int(number) != number or number < least:
                    raise InputError(f"{number}", field=name, expected=f"a whole number of at least {least}")
        if not 0 < self.parameters <= MOST_PARAMETERS:
            raise InputError(
                f"{self.parameters} parameters", field="orders", expected=f"between 1 and {MOST_PARAMETERS}"
            )

    @classmethod
    def of(cls, na: int, nb: int | tuple[int, ...], nc: int, nk: int | tuple[int, ...] = 1) -> Self:
        """Orders from plain numbers; one number of `nb` or `nk` serves every input."""
        inputs = max(len(n) if isinstance(n, tuple) else 1 for n in (nb, nk))
        full = [n if isinstance(n, tuple) else (n,) * inputs for n in (nb, nk)]
        return cls(na, full[0], nc, full[1])

    @property
    def inputs(self) -> int:
        """Number of inputs."""
        return len(self.nb)

    @property
    def parameters(self) -> int:
        """Number of coefficients."""
        return self.na + sum(self.nb) + self.nc

    @property
    def reach(self) -> int:
        """Number of earlier samples of output and inputs that a prediction needs."""
        return max([self.na, *(nb + nk - 1 for nb, nk in zip(self.nb, self.nk, strict=True))])

    def blocks(self) -> Iterator[slice]:
        """Slices of each input's coefficients in the parameter vector [a, b_1, ..., b_m, c]."""
        start = self.na
        for nb in self.nb:
            yield slice(start, start + nb)
            start += nb

    @property
    def c_block(self) -> slice:
        """Slice of the coefficients of C in the parameter vector."""
        return slice(self.parameters - self.nc, self.parameters)

    def __str__(self) -> str:
        def text(numbers: tuple[int, ...]) -> str:
            return ",".join(str(number) for number in numbers) or "-"

        return f"na {self.na}, nb {text(self.nb)}, nc {self.nc}, nk {text(self.nk)}"
