"""One sample of the closed loop as an expression, and as machine code for one loop or for several side by side.

Controller (`optid.pid.pid_step`), plant and cost are one CasADi function. LLVM makes machine code of it: of its
derivatives for `optid.tuning.gradient`, and of the whole loop over the samples, with its state in registers, for
`optid.tuning.loop`. What a controller does not use, by settings of 0, 1 or infinity, does not appear in the code.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np
from llvmlite import ir
from numba.core import cgutils

from optid.core.cache import sources
from optid.core.instructions import FORMS, REAL, Value, number
from optid.core.jit import machine_code
from optid.core.llvm_simd import PLACE, SEVERAL, load, size, splat, store
from optid.core.model import Array
from optid.core.threads import one_at_a_time
from optid.pid.pid_step import GAINS, LAST_COMMAND, MEMORY, SETTINGS
from optid.pid.symbolic import symbolic

# What is added up behind the states of plant and controller: the measure, travel of the command, overshoot times the
# step's direction, and the lowest and highest output at rest.
MEASURE, TRAVEL, OVERSHOOT, LOWEST, HIGHEST = range(5)
SUMS = 5
# Rows of an episode: set-point, disturbance of the command, weight of the error, direction of the step, noise of the
# sensor, and 0 where the output should be at rest, infinity before.
REFERENCE, LOAD, WEIGHT, RISE, NOISE, RESTLESS = range(6)
ROWS = 6
CONSTANT = (0.0, 1.0, np.inf, -np.inf)  # settings of these values are written into the code


@one_at_a_time
def closed_loop_sample(order: int, squared_error: bool, settings: Sequence[float]) -> ca.Function:
    """One sample: (x, g, plant, s, e) -> x afterwards.

    Args:
        order: of the plant.
        squared_error: whether the measure squares the error.
        settings: of the controller behind its gains; those in CONSTANT are constants of the function.

    Returns:
        x: [memory of the plant in transposed direct form, memory of the controller, sums]; g the gains; plant
        [a, b, dead zone's lower and upper edge]; s the settings; e one column of an episode.
    """
    x, g = ca.SX.sym("x", order + MEMORY + SUMS), ca.SX.sym("g", GAINS)
    plant, s = ca.SX.sym("plant", 2 * order + 2), ca.SX.sym("s", SETTINGS - GAINS)
    e = ca.SX.sym("e", ROWS)
    z, m = ca.vertsplit(x[:order]), ca.vertsplit(x[order : order + MEMORY])
    sums = ca.vertsplit(x[order + MEMORY :])
    fixed = [ca.SX(value) if value in CONSTANT else s[i] for i, value in enumerate(map(float, settings))]
    y, before = z[0], m[LAST_COMMAND]
    u = symbolic()([*ca.vertsplit(g), *fixed], m, e[REFERENCE], y + e[NOISE])
    error = ca.fabs(e[REFERENCE] - y)
    sums[MEASURE] += e[WEIGHT] * (error**2 if squared_error else error)
    sums[TRAVEL] += ca.fabs(u - before)
    sums[OVERSHOOT] = ca.fmax(sums[OVERSHOOT], (y - e[REFERENCE]) * e[RISE])
    sums[LOWEST] = ca.fmin(sums[LOWEST], y + e[RESTLESS])
    sums[HIGHEST] = ca.fmax(sums[HIGHEST], y - e[RESTLESS])
    drive = u + e[LOAD]
    drive = drive - ca.fmin(ca.fmax(drive, plant[2 * order]), plant[2 * order + 1])
    shifted = [*z[1:], ca.SX(0)]
    z = [shifted[i] + plant[order + i] * drive - plant[i] * y for i in range(order)]
    return ca.Function("sample", [x, g, plant, s, e], [ca.cse(ca.densify(ca.vertcat(*z, *m, *sums)))])


def initial_state(order: int, command: float, lanes: int) -> Array:
    """x before the first sample, (order + MEMORY + SUMS, lanes): at rest with this command."""
    x = np.zeros((order + MEMORY + SUMS, lanes))
    x[order + LAST_COMMAND] = command
    x[order + MEMORY + LOWEST], x[order + MEMORY + HIGHEST] = np.inf, -np.inf
    return x


@dataclass(frozen=True, eq=False)
class MachineCode:
    """Machine code at `place`; `engine` owns it."""

    place: int
    engine: Any


@lru_cache(maxsize=32)
def closed_loop_code(order: int, squared_error: bool, settings: tuple[float, ...]) -> MachineCode:
    """``loops(x, g, plant, s, episode, samples)``: `LANES` loops over an episode; rows of x and g are lanes."""
    function = closed_loop_sample(order, squared_error, settings)
    engine = _compiled("loops", function, _write_loop)
    return MachineCode(engine.get_function_address("loops"), engine)


def single_loop_code(function: ca.Function) -> MachineCode:
    """``sample(x, g, plant, s, e)`` for a function like `closed_loop_sample`, in place on x."""
    engine = _compiled("sample", function, _write_sample)
    return MachineCode(engine.get_function_address("sample"), engine)


def _compiled(kind: str, function: ca.Function, text: Callable[[ca.Function], str]) -> Any:
    """The code is kept on disk under all that it depends on: how this file writes it, too."""
    return machine_code(f"{kind} {sources(__file__)} {function.serialize()}", lambda: text(function))


def _write_sample(function: ca.Function) -> str:
    b, places, _ = _new_function(function.name(), 5, 0)
    inputs = [[load(b, place, i) for i in range(function.nnz_in(k))] for k, place in enumerate(places)]
    for i, value in enumerate(_values(b, function, inputs)):
        store(b, places[0], i, value)
    b.ret(number(0.0))
    return str(b.module)


def _write_loop(function: ca.Function) -> str:
    b, (x, g, plant, s, episode), (samples,) = _new_function("loops", 5, 1)
    wide = [[load(b, place, i, SEVERAL) for i in range(function.nnz_in(k))] for k, place in ((0, x), (1, g))]
    same = [
        [splat(b, load(b, place, i), SEVERAL) for i in range(function.nnz_in(k))]
        for k, place in ((2, plant), (3, s))
    ]
    held = [cgutils.alloca_once_value(b, value) for value in wide[0]]
    count = b.fptosi(samples, ir.IntType(64))
    with cgutils.for_range(b, count) as loop:
        column = [
            splat(b, b.load(b.gep(episode, [b.add(loop.index, b.mul(count, size(row)))])), SEVERAL)
            for row in range(ROWS)
        ]
        state = [b.load(place) for place in held]
        for place, value in zip(held, _values(b, function, [state, wide[1], *same, column]), strict=True):
            b.store(value, place)
    for i, place in enumerate(held):
        store(b, x, i, b.load(place))
    b.ret(number(0.0))
    return str(b.module)


def _new_function(name: str, places: int, numbers: int) -> tuple[Value, Sequence[Value], Sequence[Value]]:
    """A function of so many places, then numbers: its builder and its arguments."""
    module = ir.Module(name)
    kind = ir.FunctionType(REAL, [PLACE] * places + [REAL] * numbers)
    code = ir.Function(module, kind, name)
    return ir.IRBuilder(code.append_basic_block()), code.args[:places], code.args[places:]


def _values(b: Value, function: ca.Function, inputs: Sequence[Sequence[Value]]) -> list[Value]:
    """The function's only output, from the values of its inputs."""
    held: dict[int, Value] = {}
    wide = inputs[0][0].type
    results: list[Value] = [splat(b, number(0.0), wide)] * function.nnz_out(0)
    for k in range(function.n_instructions()):
        kind = function.instruction_id(k)
        into, given = function.instruction_output(k), function.instruction_input(k)
        if kind == ca.OP_CONST:
            held[into[0]] = splat(b, number(float(function.instruction_constant(k))), wide)
        elif kind == ca.OP_INPUT:
            held[into[0]] = inputs[given[0]][given[1]]
        elif kind == ca.OP_OUTPUT:
            results[into[1]] = held[given[0]]
        else:
            operands, form = FORMS[kind]
            held[into[0]] = form(b, *(held[i] for i in given[:operands]))
    return results
