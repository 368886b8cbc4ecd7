"""`optid.pid.pid_step` over CasADi expressions: the same text, its helpers replaced by CasADi's own."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

import casadi as ca

from optid.pid import pid_step as definition

Symbolic = Callable[[list[Any], list[Any], Any, Any], Any]

# The replacement of each helper. All values are known in an expression: a missing sample has no derivative.
HELPERS: dict[str, Any] = {
    "chosen": lambda condition, this, other: ca.if_else(condition, this, other),
    "bounded": lambda value, low, high: ca.fmin(ca.fmax(value, low), high),
    "smaller": ca.fmin,
    "larger": ca.fmax,
    "known": lambda value, otherwise: value,
    "whole": ca.floor,
    "abs": ca.fabs,
}


def symbolic() -> Symbolic:
    """``law(s, m, setpoint, measured)`` for lists of expressions; `m` is brought up to date as by the original."""
    original: Any = definition.law
    function = original.py_func
    return FunctionType(function.__code__, {**function.__globals__, **HELPERS}, "law")


def controller() -> ca.Function:
    """(settings, memory, setpoint, measured) -> (command, memory afterwards), all SX columns."""
    s, m = ca.SX.sym("s", definition.SETTINGS), ca.SX.sym("m", definition.MEMORY)
    setpoint, measured = ca.SX.sym("setpoint"), ca.SX.sym("measured")
    memory = ca.vertsplit(m)
    command = symbolic()(ca.vertsplit(s), memory, setpoint, measured)
    return ca.Function("law", [s, m, setpoint, measured], [command, ca.vertcat(*memory)])
