"""Numbers, and rows of several numbers, in the memory of an LLVM function under construction."""

from __future__ import annotations

import functools
from collections.abc import Sequence

from llvmlite import binding, ir

from optid.core.instructions import REAL, Value, add, intrinsic, mul

# Numbers of a vector, as many as a register of this processor holds: so many states move at once, and rows of S are
# padded to a multiple of it. With registers of four numbers, eight at once take longer.
LANES = 8 if binding.get_host_cpu_features().get("avx512f") else 4
PLACE, SEVERAL = REAL.as_pointer(), ir.VectorType(REAL, LANES)


def index(i: int) -> Value:
    """A place within a vector or an array, known when the code is written."""
    return ir.Constant(ir.IntType(32), i)


def where(b: Value, place: Value, i: int, kind: Value) -> Value:
    """Where the i-th number or row of numbers is."""
    wide = kind.count if isinstance(kind, ir.VectorType) else 1
    return b.bitcast(b.gep(place, [index(i * wide)]), kind.as_pointer())


def load(b: Value, place: Value, i: int, kind: Value = REAL) -> Value:
    """The i-th number or row of numbers."""
    return b.load(where(b, place, i, kind), align=8)


def store(b: Value, place: Value, i: int, value: Value) -> None:
    """Put a number or a row of numbers at the i-th place of its kind."""
    b.store(value, where(b, place, i, value.type), align=8)


def size(count: int) -> Value:
    """A whole number to count loops and rows with."""
    return ir.Constant(ir.IntType(64), count)


def row_at(b: Value, place: Value, first: int, counter: Value) -> tuple[Value, Value]:
    """Where row first + counter of a loop is, and what stands there."""
    numbers = b.mul(b.add(counter, size(first)), size(LANES))
    row = b.bitcast(b.gep(place, [numbers]), SEVERAL.as_pointer())
    return row, b.load(row, align=8)


def splat(b: Value, value: Value, kind: Value) -> Value:
    """One number in every lane of a row; a row is returned as it is."""
    if value.type == kind:
        return value
    if isinstance(value, ir.Constant):
        return ir.Constant(kind, [value.constant] * kind.count)
    first = b.insert_element(ir.Constant(kind, ir.Undefined), value, index(0))
    lanes = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), None)
    return b.shuffle_vector(first, ir.Constant(kind, ir.Undefined), lanes)


def largest(b: Value, row: Value) -> Value:
    """The largest number of a row; NaN if there is one."""
    if not isinstance(row.type, ir.VectorType):
        return row
    lanes = [b.extract_element(row, index(i)) for i in range(row.type.count)]
    return functools.reduce(lambda x, y: intrinsic("maximum")(b, x, y), lanes)


def combine(b: Value, start: Value, weights: Sequence[Value | None], terms: Sequence[Value]) -> Value:
    """start + sum of weights times terms; None is a weight of zero."""
    for weight, term in zip(weights, terms, strict=True):
        if weight is not None:
            start = add(b, start, mul(b, splat(b, weight, term.type), term))
    return start
