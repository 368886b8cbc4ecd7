"""Layout of the recursion's packed array of float64.

One array instead of an object with fields: a numba call with one array takes 0.4 microseconds less than one with a
class, the state is saved by copying, and C uses the same memory. After the header below follow, without
gaps (n parameters, m inputs; S is n rounded up to a multiple of 4, what lies behind the parameters is zero)::

    table   3 m   for each input: nb, nk, 1/scale
    now       m   the inputs of the current sample, in the user's unit
    theta     S   [a, b_1 .. b_m, c] of the scaled signals
    D         S   the diagonal of P = U D U'
    phi       S   regressor          psi   S   its gradient filtered by 1/C
    F, V, G 3 S   U' psi, D U' psi, P psi
    U       S S   unit upper triangular, column after column
    work   2 nc   work of the stability test
    yh       na   outputs -y(t-1)..  yf    max(na, nc), filtered by 1/C
    eh, ef 2 nc   residuals e(t-1).. and the same filtered; these four rounded up to multiples of 4
    uh, uf        for each input: nk + nb inputs u(t).., and max(nk + nb, nc), filtered
"""

from __future__ import annotations

from typing import Final, NamedTuple

from optid.armax.structure import Orders

# Constant numbers.
FORMAT: Final = 0  # version of this layout
NA: Final = 1
NC: Final = 2
PARAMETERS: Final = 3
INPUTS: Final = 4
FILTERED: Final = 5  # 1: recursive maximum likelihood, 0: extended least squares
FORGETTING: Final = 6  # 0 constant or variable, 1 directional
FACTOR: Final = 7  # forgetting factor lambda; the lowest one where it varies
MEMORY: Final = 8  # 0, or the memory of a variable factor in samples
OUTLIER: Final = 9  # 0, or the standard deviations at which a step is bounded
LIMIT: Final = 10  # the trace of P above which nothing is forgotten
RADIUS: Final = 11  # the roots of C stay inside
WARM_RATE: Final = 12
SCALE: Final = 13  # of the output, in the user's unit
EASE_RATE: Final = 14

# Numbers that change.
WARM: Final = 15  # current reduction of the forgetting factor
HOLD: Final = 16  # samples until every regressor is measured
SAMPLES: Final = 17
UPDATES: Final = 18
TRACE: Final = 19
SQUARES: Final = 20  # weighted sum of innovation times residual
WEIGHT: Final = 21  # weighted number of samples in it
SLOW: Final = 22  # slow average of the squared innovation
PREDICTION: Final = 23  # of the last sample, scaled
MISSING: Final = 24
BOUNDED: Final = 25  # outliers
PROJECTED: Final = 26  # updates after which C had to be stabilised

EASE: Final = 27  # remaining difference of the gradient's filter from 1/C

STRIDE: Final = 28  # S
PATIENCE: Final = 29  # updates before C is estimated
OUTPUTS: Final = 30  # start of yh
OUTPUTS_FILTERED: Final = 31  # of yf
RESIDUALS: Final = 32  # of eh
RESIDUALS_FILTERED: Final = 33  # of ef
PAST_INPUTS: Final = 34  # of the first input's uh
FADE: Final = 35  # 1 / FACTOR

HEADER: Final = 36
CURRENT_FORMAT: Final = 2.0


class Shape(NamedTuple):
    """The header's whole numbers, as the kernels take them: read at run time, or constants of the compilation."""

    na: int
    nc: int
    n: int
    m: int
    size: int
    nb: int  # of every input; -1 where they differ
    nk: int
    outputs: int
    outputs_filtered: int
    residuals: int
    residuals_filtered: int
    past_inputs: int


def table_at() -> int:
    """Start of the inputs' table."""
    return HEADER


def theta_at(orders: Orders) -> int:
    """Start of the parameters."""
    return HEADER + 4 * orders.inputs


def padded(length: int) -> int:
    """The multiple of 4 that holds so many numbers."""
    return -(-length // 4) * 4


def stride(orders: Orders) -> int:
    """S, the length of the padded arrays."""
    return padded(orders.parameters)


def diagonal_at(orders: Orders) -> int:
    """Start of D."""
    return theta_at(orders) + stride(orders)


def triangle_at(orders: Orders) -> int:
    """Start of U."""
    return theta_at(orders) + 7 * stride(orders)


def places(orders: Orders) -> dict[int, int]:
    """Header field -> start of each past, for those the header holds."""
    yh = triangle_at(orders) + stride(orders) ** 2 + 2 * orders.nc
    yf = yh + padded(orders.na)
    eh = yf + padded(max(orders.na, orders.nc))
    ef = eh + padded(orders.nc)
    return {
        OUTPUTS: yh,
        OUTPUTS_FILTERED: yf,
        RESIDUALS: eh,
        RESIDUALS_FILTERED: ef,
        PAST_INPUTS: ef + padded(orders.nc),
    }


def shape(orders: Orders) -> Shape:
    """The whole numbers of these orders."""
    nb, nk = (each[0] if len(set(each)) == 1 else -1 for each in (orders.nb, orders.nk))
    return Shape(
        orders.na,
        orders.nc,
        orders.parameters,
        orders.inputs,
        stride(orders),
        nb,
        nk,
        *places(orders).values(),
    )


def size(orders: Orders) -> int:
    """Length of the whole array."""
    total = places(orders)[PAST_INPUTS]
    for nb, nk in zip(orders.nb, orders.nk, strict=True):
        total += nb + nk + max(nb + nk, orders.nc)
    return total
