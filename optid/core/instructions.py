"""CasADi's scalar instructions as LLVM's: what each computes on the values of a function under construction.

Values are numbers, or vectors of several numbers that go through the same instructions (see `optid.core.lanes`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
from llvmlite import ir

from optid.core import lanes
from optid.core.lanes import like

Value = Any  # llvmlite's values and builders are not typed
Form = Callable[..., Value]

REAL = ir.DoubleType()
# Fused multiply-add and reciprocals allowed, signed zeros ignored; NaN and infinity stay what they are.
FLAGS = ("contract", "nsz", "arcp")
_SEVERAL: dict[str, Form] = {
    "exp": lanes.exp,
    "log": lanes.log,
    "log1p": lanes.log1p,
    "pow": lanes.power,
    "sin": lanes.sin,
    "cos": lanes.cos,
    "tanh": lanes.tanh,
}


def number(value: float) -> Value:
    """A constant."""
    return ir.Constant(REAL, value)


def intrinsic(name: str) -> Form:
    """One of LLVM's own functions."""
    return lambda b, *operands: lanes.intrinsic(b, name, *operands)


def _plain(name: str) -> Form:
    return lambda b, *operands: getattr(b, name)(*operands, flags=FLAGS)


def _library(name: str) -> Form:
    """A function of the C library's mathematics, which every Python process has loaded."""

    def call(b: Value, *operands: Value) -> Value:
        kind = operands[0].type
        several = isinstance(kind, ir.VectorType)
        if several and name not in _SEVERAL:
            return apart(b, *operands)
        title = f"many_{name}" if several else name
        function = b.module.globals.get(title)
        if function is None:
            function = ir.Function(b.module, ir.FunctionType(kind, [kind] * len(operands)), title)
            if several:
                _define(function, _SEVERAL[name])
        return b.call(function, operands)

    def apart(b: Value, *operands: Value) -> Value:
        found = ir.Constant(operands[0].type, ir.Undefined)
        for lane in range(operands[0].type.count):
            place = ir.Constant(ir.IntType(32), lane)
            one = call(b, *(b.extract_element(operand, place) for operand in operands))
            found = b.insert_element(found, one, place)
        return found

    return call


def _define(function: Value, form: Form) -> None:
    """Write a separate function, once per module; its calls are inlined."""
    function.linkage = "private"
    function.attributes.add("alwaysinline")
    b = ir.IRBuilder(function.append_basic_block())
    b.ret(form(b, *function.args))


def _truth(b: Value, condition: Value, x: Value) -> Value:
    return b.select(condition, like(x, 1.0), like(x, 0.0))


def _comparison(sign: str) -> Form:
    return lambda b, x, y: _truth(b, b.fcmp_ordered(sign, x, y), x)


def _true(b: Value, x: Value) -> Value:
    return b.fcmp_unordered("!=", x, like(x, 0.0))


def _sign(b: Value, x: Value) -> Value:
    below = b.select(b.fcmp_ordered("<", x, like(x, 0.0)), like(x, -1.0), like(x, 0.0))
    return b.select(b.fcmp_ordered(">", x, like(x, 0.0)), like(x, 1.0), below)


add, sub, mul, div = (_plain(name) for name in ("fadd", "fsub", "fmul", "fdiv"))
_UNARY: dict[int, Form] = {
    ca.OP_ASSIGN: lambda b, x: x,
    ca.OP_NEG: _plain("fneg"),
    ca.OP_SQRT: intrinsic("sqrt"),
    ca.OP_SQ: lambda b, x: mul(b, x, x),
    ca.OP_TWICE: lambda b, x: add(b, x, x),
    ca.OP_INV: lambda b, x: div(b, like(x, 1.0), x),
    ca.OP_FABS: intrinsic("fabs"),
    ca.OP_SIGN: _sign,
    ca.OP_FLOOR: intrinsic("floor"),
    ca.OP_CEIL: intrinsic("ceil"),
    ca.OP_NOT: lambda b, x: _truth(b, b.fcmp_ordered("==", x, like(x, 0.0)), x),
} | {
    getattr(ca, f"OP_{name.upper()}"): _library(name)
    for name in (
        "exp",
        "log",
        "log1p",
        "expm1",
        "sin",
        "cos",
        "tan",
        "asin",
        "acos",
        "atan",
        "sinh",
        "cosh",
        "tanh",
        "erf",
    )
}
_BINARY: dict[int, Form] = {
    ca.OP_ADD: add,
    ca.OP_SUB: sub,
    ca.OP_MUL: mul,
    ca.OP_DIV: div,
    ca.OP_POW: _library("pow"),
    ca.OP_CONSTPOW: _library("pow"),
    ca.OP_ATAN2: _library("atan2"),
    ca.OP_FMOD: _library("fmod"),
    ca.OP_FMIN: lambda b, x, y: b.select(b.fcmp_ordered("<", x, y), x, y),
    ca.OP_FMAX: lambda b, x, y: b.select(b.fcmp_ordered(">", x, y), x, y),
    ca.OP_LT: _comparison("<"),
    ca.OP_LE: _comparison("<="),
    ca.OP_EQ: _comparison("=="),
    ca.OP_NE: lambda b, x, y: _truth(b, b.fcmp_unordered("!=", x, y), x),
    ca.OP_AND: lambda b, x, y: _truth(b, b.and_(_true(b, x), _true(b, y)), x),
    ca.OP_OR: lambda b, x, y: _truth(b, b.or_(_true(b, x), _true(b, y)), x),
    # Zero where the condition fails, whatever the other operand is: an unused branch may be NaN.
    ca.OP_IF_ELSE_ZERO: lambda b, x, y: b.select(_true(b, x), y, like(y, 0.0)),
}

# CasADi's instruction code -> number of operands, and what to write for it.
FORMS = {code: (1, form) for code, form in _UNARY.items()} | {
    code: (2, form) for code, form in _BINARY.items()
}
