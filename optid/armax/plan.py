"""What `optid identify` shall do: orders, horizons, estimator, trend."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from optid.armax.forgetting import Constant, Forgetting
from optid.armax.loop import Gains
from optid.armax.structure import Orders
from optid.armax.trend import Trend
from optid.errors import InputError

DELAYS = (1, 2, 3, 5, 8, 12)  # samples, tried where none is given


class Estimator(enum.Enum):
    """Who makes the models of a table; the value says how."""

    PEM = "offline prediction error method over the whole recording"
    RML = "recursive maximum likelihood, one pass"
    RLS = "recursive (extended) least squares, one pass, as the paper does"


@dataclass(frozen=True)
class Plan:
    """What `survey` shall do.

    Attributes:
        orders: na of the models to identify.
        steps: horizons of the Table 2 rows of `table_order`.
        delay: samples, one for all inputs or one for each; None lets the recording choose among `DELAYS`.
        nb: numbers of B, one for all inputs or one for each; None is na.
        nc: numbers of C; None is na.
        exact: these structures alone, nothing beside them is compared.
        table_order: the order predicted over all horizons; None is 4 if asked for, else the last.
        gains: PID gains to check the models with.
        estimator: who makes the models.
        forgetting: of the recursion.
        trend: what stands beside eq. 12; None is a constant, and a slope where the recording shows one.
        horizons: fit models to each horizon, too.
        unit: of the output.
        input, output: roles of the signals; several inputs are separated by commas.
        input_unit: of the input; of several, separated by commas.
    """

    orders: tuple[int, ...] = (3, 4, 5)
    steps: tuple[int, ...] = (1, 5, 10)
    delay: int | tuple[int, ...] | None = None
    nb: int | tuple[int, ...] | None = None
    nc: int | None = None
    exact: bool = False
    table_order: int | None = None
    gains: Gains | None = None
    estimator: Estimator = Estimator.PEM
    forgetting: Forgetting = field(default_factory=Constant)
    trend: Trend | None = None
    horizons: bool = True
    unit: str = "m"
    input: str = "command"
    output: str = "position"
    input_unit: str = ""

    def __post_init__(self) -> None:
        for name, values in (("orders", self.orders), ("steps", self.steps)):
            if not values or any(int(v) != v or v < 1 for v in values):
                raise InputError(f"{values}", field=name, expected="whole numbers of at least 1")
        if self.table_order is not None and self.table_order not in self.orders:
            raise InputError(f"{self.table_order}", field="table_order", expected=f"one of {self.orders}")

    def structure(self, na: int, nk: int | tuple[int, ...], inputs: int) -> Orders:
        """Eq. 12's numbers for an order."""

        def each(value: int | tuple[int, ...], field: str) -> tuple[int, ...]:
            if isinstance(value, int):
                return (value,) * inputs
            if len(value) != inputs:
                raise InputError(
                    f"{len(value)} numbers", field=field, expected=f"one number, or {inputs}: one per input"
                )
            return value

        nb = each(na if self.nb is None else self.nb, "nb")
        return Orders(na, nb, na if self.nc is None else self.nc, each(nk, "delay"))
