"""The plan of `optid identify`: orders, horizons, estimator, trend."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

from optid.armax.forgetting import Constant, Forgetting
from optid.armax.loop import Gains
from optid.armax.structure import Orders
from optid.armax.trend import Trend
from optid.errors import InputError

DELAYS = (1, 2, 3, 5, 8, 12)  # delays in samples that are compared if none is given


class Estimator(enum.Enum):
    """The estimator of the models; the value describes it."""

    PEM = "offline prediction error method over the whole recording"
    RML = "recursive maximum likelihood, one pass"
    RLS = "recursive (extended) least squares, one pass, as the paper does"


@dataclass(frozen=True)
class Plan:
    """The settings of `survey`.

    Attributes:
        orders: na of the models to identify.
        steps: horizons of the Table 2 rows of `table_order`.
        delay: samples, one for all inputs or one for each; None selects among `DELAYS` from the data.
        nb: number of coefficients of B, one for all inputs or one for each; None is na.
        nc: number of coefficients of C; None is na.
        exact: only these structures; no others are compared.
        table_order: the order predicted over all horizons; None is 4 if it is among `orders`, else the last.
        gains: PID gains to check the models with.
        estimator: of the models.
        forgetting: of the recursion.
        trend: terms added to eq. 12; None is a constant, and a slope where the recording shows one.
        horizons: whether models are also fitted to each horizon.
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
        """The structure of eq. 12 for an order."""

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
