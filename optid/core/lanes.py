"""Exponential, logarithm, powers, sines and hyperbolic tangent of several numbers at once, in vector instructions.

The C library's functions take one number at a time. These are accurate to two units in the last place (tests); of
powers the relative error grows with the logarithm of the result, of sines the absolute one with the angle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from llvmlite import ir

Value = Any  # llvmlite's values and builders are not typed

WHOLE = ir.IntType(64)
FLAGS = ("contract", "nsz")
LN2_HIGH, LN2_LOW = 6.93147180369123816490e-01, 1.90821492927058770002e-10  # fdlibm: n * LN2_HIGH is exact
SHIFT = 6755399441055744.0  # 1.5 * 2^52: added to a small whole number, it leaves that in the lowest bits
EXP_LOW, EXP_HIGH = -708.0, 709.7
# fdlibm, e_log.c: log(1+f) - f + f^2/2 - s f^2/2 = s R(s^2) with s = f / (2 + f)
LOG = (
    1.479819860511658591e-01,
    1.531383769920937332e-01,
    1.818357216161805012e-01,
    2.222219843214978396e-01,
    2.857142874366239149e-01,
    3.999999999940941908e-01,
    6.666666666666735130e-01,
)
# pi/2 in three parts, of which multiples by whole numbers below 2^20 are exact (fdlibm, e_rem_pio2.c)
QUARTER = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
# fdlibm, k_sin.c and k_cos.c, for angles up to pi/4
SIN = (
    1.58969099521155010221e-10,
    -2.50507602534068634195e-08,
    2.75573137070700676789e-06,
    -1.98412698298579493134e-04,
    8.33333333332248946124e-03,
    -1.66666666666666324348e-01,
)
COS = (
    -1.13596475577881948265e-11,
    2.08757232129817482790e-09,
    -2.75573143513906633035e-07,
    2.48015872894767294178e-05,
    -1.38888888888741095749e-03,
    4.16666666666666019037e-02,
)
# Cephes, tanh.c: tanh(x) = x + x z P(z) / Q(z) with z = x^2, for |x| < 0.625
TANH_P = (-9.64399179425052238628e-1, -9.92877231001918586564e1, -1.61468768441708447952e3)
TANH_Q = (1.0, 1.12811678491632931402e2, 2.23548839060100448583e3, 4.84406305325125486048e3)


def like(x: Value, value: float) -> Value:
    """A constant of the type of x: a number, or the same one in every lane."""
    several = isinstance(x.type, ir.VectorType)
    return ir.Constant(x.type, [value] * x.type.count if several else value)


def intrinsic(b: Value, name: str, *operands: Value) -> Value:
    """One of LLVM's own functions, of numbers or lane by lane."""
    kind = operands[0].type
    suffix = f"v{kind.count}f64" if isinstance(kind, ir.VectorType) else "f64"
    full = f"llvm.{name}.{suffix}"
    known = b.module.globals.get(full)
    function = known or ir.Function(b.module, ir.FunctionType(kind, [kind] * len(operands)), full)
    return b.call(function, operands, fastmath=FLAGS)


def exp(b: Value, x: Value) -> Value:
    """e^x: x = n ln 2 + r, Taylor's series of r to the 13th power, and n added to the exponent's bits."""
    bounded = b.select(b.fcmp_ordered("<", x, like(x, EXP_LOW)), like(x, EXP_LOW), x)
    bounded = b.select(b.fcmp_ordered(">", bounded, like(x, EXP_HIGH)), like(x, EXP_HIGH), bounded)
    n = intrinsic(b, "rint", b.fmul(bounded, like(x, 1 / math.log(2.0)), flags=FLAGS))
    r = intrinsic(b, "fma", n, like(x, -LN2_HIGH), bounded)
    r = intrinsic(b, "fma", n, like(x, -LN2_LOW), r)
    power = _polynomial(b, r, [1 / math.factorial(k) for k in range(13, -1, -1)])
    shifted = b.shl(_bits(b, b.fadd(n, like(x, SHIFT))), _whole(x, 52))
    found = b.bitcast(b.add(_bits(b, power), shifted), x.type)
    found = b.select(b.fcmp_ordered(">", x, like(x, EXP_HIGH)), like(x, math.inf), found)
    return b.select(b.fcmp_unordered("uno", x, x), x, found)


def log(b: Value, x: Value) -> Value:
    """Natural logarithm: the exponent's bits, and fdlibm's polynomial of a mantissa near 1. No denormal numbers."""
    bits = _bits(b, x)
    mantissa = b.or_(b.and_(bits, _whole(x, (1 << 52) - 1)), _whole(x, 1023 << 52))
    m, e = b.bitcast(mantissa, x.type), b.or_(b.lshr(bits, _whole(x, 52)), _whole(x, 0x433 << 52))
    high = b.fcmp_ordered(">", m, like(x, math.sqrt(2.0)))
    m = b.select(high, b.fmul(m, like(x, 0.5)), m)
    exponent = b.fsub(b.bitcast(e, x.type), like(x, 2.0**52 + 1023))
    exponent = b.select(high, b.fadd(exponent, like(x, 1.0)), exponent)
    f = b.fsub(m, like(x, 1.0))
    s = b.fdiv(f, b.fadd(f, like(x, 2.0)))
    z = b.fmul(s, s)
    R = b.fmul(z, _polynomial(b, z, LOG))
    half = b.fmul(like(x, 0.5), b.fmul(f, f))
    small = intrinsic(b, "fma", s, b.fadd(half, R), b.fmul(exponent, like(x, LN2_LOW)))
    found = b.fsub(b.fmul(exponent, like(x, LN2_HIGH)), b.fsub(b.fsub(half, small), f))
    found = b.select(b.fcmp_ordered("<", x, like(x, 2.2250738585072014e-308)), like(x, -math.inf), found)
    found = b.select(b.fcmp_ordered("<", x, like(x, 0.0)), like(x, math.nan), found)
    found = b.select(b.fcmp_ordered("==", x, like(x, math.inf)), x, found)
    return b.select(b.fcmp_unordered("uno", x, x), x, found)


def log1p(b: Value, x: Value) -> Value:
    """log(1 + x), corrected for the rounding of 1 + x (Kahan)."""
    whole = b.fadd(like(x, 1.0), x)
    lost = b.fsub(x, b.fsub(whole, like(x, 1.0)))
    found = b.fadd(log(b, whole), b.fdiv(lost, whole))
    ends = b.or_(b.fcmp_ordered("==", x, like(x, math.inf)), b.fcmp_ordered("==", whole, like(x, 0.0)))
    return b.select(ends, log(b, whole), found)


def power(b: Value, x: Value, y: Value) -> Value:
    """x^y = exp(y log |x|); of negative numbers whole powers, with their sign."""
    size = exp(b, b.fmul(y, log(b, intrinsic(b, "fabs", x))))
    half = b.fmul(y, like(x, 0.5))
    whole = b.fcmp_ordered("==", intrinsic(b, "floor", y), y)
    even = b.fcmp_ordered("==", intrinsic(b, "floor", half), half)
    negative = b.select(whole, b.select(even, size, b.fneg(size)), like(x, math.nan))
    found = b.select(b.fcmp_ordered("<", x, like(x, 0.0)), negative, size)
    one = b.or_(b.fcmp_ordered("==", y, like(x, 0.0)), b.fcmp_ordered("==", x, like(x, 1.0)))
    return b.select(one, like(x, 1.0), found)


def sin(b: Value, x: Value) -> Value:
    """Sine."""
    return _wave(b, x, 0)


def cos(b: Value, x: Value) -> Value:
    """Cosine: a quarter of a turn ahead of the sine."""
    return _wave(b, x, 1)


def _wave(b: Value, x: Value, ahead: int) -> Value:
    """The sine, advanced by some quarter turns."""
    n = intrinsic(b, "rint", b.fmul(x, like(x, 2 / math.pi), flags=FLAGS))
    r = x
    for part in QUARTER:
        r = intrinsic(b, "fma", n, like(x, -part), r)
    z = b.fmul(r, r)
    sine = intrinsic(b, "fma", b.fmul(r, z), _polynomial(b, z, SIN), r)
    cosine = _polynomial(b, z, (*COS, -0.5, 1.0))
    quarter = b.add(_bits(b, b.fadd(n, like(x, SHIFT))), _whole(x, ahead))
    odd = b.icmp_unsigned("!=", b.and_(quarter, _whole(x, 1)), _whole(x, 0))
    turned = b.icmp_unsigned("!=", b.and_(quarter, _whole(x, 2)), _whole(x, 0))
    found = b.select(odd, cosine, sine)
    return b.select(turned, b.fneg(found), found)


def tanh(b: Value, x: Value) -> Value:
    """Hyperbolic tangent: Cephes' rational function near 0, the exponential beyond."""
    z = b.fmul(x, x)
    share = b.fdiv(_polynomial(b, z, TANH_P), _polynomial(b, z, TANH_Q))
    near = intrinsic(b, "fma", b.fmul(x, z), share, x)
    size = intrinsic(b, "fabs", x)
    grown = exp(b, b.fadd(size, size))
    far = b.fsub(like(x, 1.0), b.fdiv(like(x, 2.0), b.fadd(grown, like(x, 1.0))))
    far = intrinsic(b, "copysign", far, x)
    return b.select(b.fcmp_ordered("<", size, like(x, 0.625)), near, far)


def _polynomial(b: Value, x: Value, coefficients: Sequence[float]) -> Value:
    """Horner's rule, highest power first."""
    total = like(x, coefficients[0])
    for coefficient in coefficients[1:]:
        total = intrinsic(b, "fma", total, x, like(x, coefficient))
    return total


def _bits(b: Value, x: Value) -> Value:
    several = isinstance(x.type, ir.VectorType)
    return b.bitcast(x, ir.VectorType(WHOLE, x.type.count) if several else WHOLE)


def _whole(x: Value, value: int) -> Value:
    several = isinstance(x.type, ir.VectorType)
    return (
        ir.Constant(ir.VectorType(WHOLE, x.type.count), [value] * x.type.count)
        if several
        else ir.Constant(WHOLE, value)
    )
