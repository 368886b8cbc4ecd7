# mypy: ignore-errors
"""The functions of `optid.armax.ud_factor` for numba, four numbers at a time.

Numba's loops over parts of one array stay scalar, because it cannot know that the parts do not overlap; so
the vectors are spelt out here, as LLVM instructions. Sums run in the same order as there, and no product is
fused with a sum: the results are equal to the last bit, which a test holds.
"""

from __future__ import annotations

from contextlib import contextmanager

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from optid.armax.ud_factor import SMALLEST_VARIANCE

_ARRAY = types.Array(types.float64, 1, "C")
_WHOLE, _NUMBER = ir.IntType(64), ir.DoubleType()
_FOUR = ir.VectorType(_NUMBER, 4)
_ZEROS = ir.Constant(_FOUR, [0.0] * 4)


class _Lanes:
    """A builder of code that thinks in fours."""

    def __init__(self, context, builder, values):
        self.context, self.ir, self.values = context, builder, values

    def data(self, i):
        """Where the numbers of argument i are."""
        return make_array(_ARRAY)(self.context, self.ir, self.values[i]).data

    @contextmanager
    def every(self, step, stop, start=None):
        """Loop over start, start + step, .. below stop; start is 0 or, as stop, a multiple of step."""
        width = _WHOLE(step)
        begin = None if start is None else self.ir.udiv(start, width)
        with cgutils.for_range(self.ir, self.ir.udiv(stop, width), start=begin) as loop:
            yield self.ir.mul(loop.index, width)

    def load(self, pointer, at):
        value = self.ir.load(self._four(pointer, at))
        value.align = 8
        return value

    def store(self, value, pointer, at):
        self.ir.store(value, self._four(pointer, at)).align = 8

    def _four(self, pointer, at):
        return self.ir.bitcast(self.ir.gep(pointer, [at]), _FOUR.as_pointer())

    def same(self, value):
        """One number in all four lanes."""
        first = self.ir.insert_element(ir.Constant(_FOUR, ir.Undefined), value, ir.IntType(32)(0))
        return self.pick(first, first, (0, 0, 0, 0))

    def pick(self, x, y, lanes):
        return self.ir.shuffle_vector(x, y, ir.Constant(ir.VectorType(ir.IntType(32), 4), list(lanes)))

    def times(self, x, y):
        return self.ir.fmul(x, y)

    def plus(self, x, y):
        return self.ir.fadd(x, y)

    def totals(self, sums):
        """Four vectors x: the vector of their (x0 + x1) + (x2 + x3)."""
        halves = [
            self.plus(self.pick(x, y, (0, 4, 2, 6)), self.pick(x, y, (1, 5, 3, 7)))
            for x, y in (sums[:2], sums[2:])
        ]
        return self.plus(self.pick(*halves, (0, 1, 4, 5)), self.pick(*halves, (2, 3, 6, 7)))

    def total(self, x):
        return self.ir.extract_element(self.totals([x] * 4), ir.IntType(32)(0))


def _emitted(write):
    """Code generation for an intrinsic from a function of `_Lanes` that returns a number or None."""

    def generate(context, builder, signature, values):
        value = write(_Lanes(context, builder, values))
        return _NUMBER(0.0) if value is None else value

    return generate


@intrinsic
def part(typing, s, at):
    """The numbers of s from index `at` on, without the checks of a slice."""

    def generate(context, builder, signature, values):
        size = context.get_constant(types.intp, 8)
        whole, view = make_array(_ARRAY)(context, builder, values[0]), make_array(_ARRAY)(context, builder)
        length = builder.sub(builder.extract_value(whole.shape, 0), values[1])
        populate_array(
            view,
            data=builder.gep(whole.data, [values[1]]),
            shape=cgutils.pack_array(builder, [length]),
            strides=cgutils.pack_array(builder, [size]),
            itemsize=size,
            meminfo=None,
        )
        return view._getvalue()

    return _ARRAY(_ARRAY, types.int64), generate


@intrinsic
def inner(typing, x, y, size):
    """See `optid.armax.ud_factor`."""

    def write(lanes):
        return _inner(lanes, lanes.data(0), lanes.data(1), lanes.values[2])

    return types.float64(_ARRAY, _ARRAY, types.int64), _emitted(write)


def _inner(lanes, x, y, size):
    total = cgutils.alloca_once_value(lanes.ir, _ZEROS)
    lanes.ir.store(_ZEROS, total)
    with lanes.every(4, size) as i:
        product = lanes.times(lanes.load(x, i), lanes.load(y, i))
        lanes.ir.store(lanes.plus(lanes.ir.load(total), product), total)
    b, rest = lanes.ir, cgutils.alloca_once(lanes.ir, _NUMBER)
    b.store(lanes.total(b.load(total)), rest)
    with cgutils.for_range(b, size, start=b.and_(size, _WHOLE(-4))) as loop:
        x_k, y_k = (b.load(b.gep(pointer, [loop.index])) for pointer in (x, y))
        b.store(b.fadd(b.load(rest), b.fmul(x_k, y_k)), rest)
    return b.load(rest)


@intrinsic
def project(typing, U, D, psi, F, V, size):
    """See `optid.armax.ud_factor`."""

    def write(lanes):
        U, D, psi, F, V = (lanes.data(i) for i in range(5))
        b, size = lanes.ir, lanes.values[5]
        sums = [cgutils.alloca_once(b, _FOUR) for _ in range(4)]
        with lanes.every(4, size) as j:
            columns = [b.gep(U, [b.mul(j, size)])]
            for total in sums:
                b.store(_ZEROS, total)
                columns.append(b.gep(columns[-1], [size]))
            with lanes.every(4, b.add(j, _WHOLE(4))) as i:
                x = lanes.load(psi, i)
                for total, column in zip(sums, columns, strict=False):
                    b.store(lanes.plus(b.load(total), lanes.times(lanes.load(column, i), x)), total)
            f = lanes.totals([b.load(total) for total in sums])
            lanes.store(f, F, j)
            lanes.store(lanes.times(lanes.load(D, j), f), V, j)
        return _inner(lanes, F, V, size)

    return types.float64(*[_ARRAY] * 5, types.int64), _emitted(write)


@intrinsic
def weigh(typing, D, F, V, size, w, fade):
    """See `optid.armax.ud_factor`."""

    def write(lanes):
        D, F, V = (lanes.data(i) for i in range(3))
        b, size = lanes.ir, lanes.values[3]
        w, fade = lanes.same(lanes.values[4]), lanes.same(lanes.values[5])
        ones = ir.Constant(_FOUR, [1.0] * 4)
        least = ir.Constant(_FOUR, [SMALLEST_VARIANCE] * 4)
        last, last_inverse = cgutils.alloca_once(b, _FOUR), cgutils.alloca_once(b, _FOUR)
        b.store(ones, last)  # the last lane is beta so far
        b.store(ones, last_inverse)
        with lanes.every(4, size) as j:
            f, old = lanes.load(F, j), b.load(last)
            steps = lanes.times(w, lanes.times(f, lanes.load(V, j)))
            pairs = lanes.plus(steps, lanes.pick(_ZEROS, steps, (0, 4, 5, 6)))
            sums = lanes.plus(pairs, lanes.pick(_ZEROS, pairs, (0, 1, 4, 5)))
            after = lanes.plus(lanes.pick(old, old, (3, 3, 3, 3)), sums)
            inverse = b.fdiv(ones, after)
            before = lanes.pick(old, after, (3, 4, 5, 6))
            inverse_before = lanes.pick(b.load(last_inverse), inverse, (3, 4, 5, 6))
            d = lanes.times(lanes.times(lanes.load(D, j), fade), lanes.times(before, inverse))
            lanes.store(b.select(b.fcmp_ordered(">", d, least), d, least), D, j)
            lanes.store(lanes.times(lanes.times(w, f), inverse_before), F, j)
            b.store(after, last)
            b.store(inverse, last_inverse)
        return b.extract_element(b.load(last), ir.IntType(32)(3))

    return types.float64(*[_ARRAY] * 3, types.int64, types.float64, types.float64), _emitted(write)


@intrinsic
def sweep(typing, U, V, F, G, size):
    """See `optid.armax.ud_factor`."""

    def write(lanes):
        U, V, F, G = (lanes.data(i) for i in range(4))
        b, size = lanes.ir, lanes.values[4]
        # Each row's sum waits for its last term: three fours of rows side by side hide that.
        wide = b.mul(b.udiv(size, _WHOLE(12)), _WHOLE(12))
        with lanes.every(12, wide) as i:
            _sweep_rows(lanes, (U, V, F, G), size, [b.add(i, _WHOLE(k)) for k in (0, 4, 8)])
        with lanes.every(4, size, wide) as i:
            _sweep_rows(lanes, (U, V, F, G), size, [i])

    return types.float64(*[_ARRAY] * 4, types.int64), _emitted(write)


def _sweep_rows(lanes, arrays, size, rows):
    U, V, F, G = arrays
    b = lanes.ir
    sums = [cgutils.alloca_once(b, _FOUR) for _ in rows]
    for total in sums:
        b.store(_ZEROS, total)
    with cgutils.for_range(b, size, start=rows[0]) as loop:
        column = b.gep(U, [b.mul(loop.index, size)])
        share, v = (lanes.same(b.load(b.gep(x, [loop.index]))) for x in (F, V))
        for total, row in zip(sums, rows, strict=True):
            g, u = b.load(total), lanes.load(column, row)
            lanes.store(b.fsub(u, lanes.times(share, g)), column, row)
            b.store(lanes.plus(g, lanes.times(v, u)), total)
    for total, row in zip(sums, rows, strict=True):
        lanes.store(b.load(total), G, row)


@intrinsic
def shift(typing, past, length):
    """See `optid.armax.ud_factor`."""

    def write(lanes):
        b, past, length = lanes.ir, lanes.data(0), lanes.values[1]
        moves = b.select(b.icmp_signed(">", length, _WHOLE(0)), b.sub(length, _WHOLE(1)), _WHOLE(0))
        with lanes.every(4, moves) as done:  # from the end
            at = b.sub(b.sub(length, done), _WHOLE(4))
            lanes.store(lanes.load(past, b.sub(at, _WHOLE(1))), past, at)
        fours = b.and_(moves, _WHOLE(-4))
        with cgutils.for_range(b, moves, start=fours) as loop:
            at = b.sub(b.sub(length, loop.index), _WHOLE(1))
            b.store(b.load(b.gep(past, [b.sub(at, _WHOLE(1))])), b.gep(past, [at]))

    return types.float64(_ARRAY, types.int64), _emitted(write)


@intrinsic
def enter(typing, past, length, x):
    """See `optid.armax.ud_factor`; loads and stores only whole fours, so that the next reader need not wait."""

    def write(lanes):
        b, past = lanes.ir, lanes.data(0)
        first = cgutils.alloca_once(b, _NUMBER)
        b.store(lanes.values[2], first)
        with lanes.every(4, lanes.values[1]) as k:
            four = lanes.load(past, k)
            lanes.store(lanes.pick(lanes.same(b.load(first)), four, (0, 4, 5, 6)), past, k)
            b.store(b.extract_element(four, ir.IntType(32)(3)), first)

    return types.float64(_ARRAY, types.int64, types.float64), _emitted(write)


@intrinsic
def copy(typing, there, here, length):
    """See `optid.armax.ud_factor`."""

    def write(lanes):
        b, there, here, length = lanes.ir, lanes.data(0), lanes.data(1), lanes.values[2]
        with lanes.every(4, length) as k:
            lanes.store(lanes.load(here, k), there, k)
        with cgutils.for_range(b, length, start=b.and_(length, _WHOLE(-4))) as loop:
            b.store(b.load(b.gep(here, [loop.index])), b.gep(there, [loop.index]))

    return types.float64(_ARRAY, _ARRAY, types.int64), _emitted(write)


@intrinsic
def move(typing, x, y, step, size):
    """See `optid.armax.ud_factor`."""

    def write(lanes):
        x, y, step = lanes.data(0), lanes.data(1), lanes.same(lanes.values[2])
        with lanes.every(4, lanes.values[3]) as k:
            lanes.store(lanes.plus(lanes.load(x, k), lanes.times(step, lanes.load(y, k))), x, k)

    return types.float64(_ARRAY, _ARRAY, types.float64, types.int64), _emitted(write)
