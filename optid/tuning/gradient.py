"""The exact gradient of a tuning's cost: one sample of the loop, differentiated by CasADi and run as machine code.

One sample of controller, plant and cost is an expression of state and gains; CasADi carries the state's derivatives
along the same sample (forward mode, exact through limits and anti-windup as far as they can be differentiated), and
LLVM makes machine code of both. A thousand samples take a fraction of a millisecond, where CasADi's own virtual
machine takes tens.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from llvmlite import ir

from optid.core.instructions import FORMS, REAL, number
from optid.core.jit import machine_code
from optid.core.kernel import at, call
from optid.core.model import Array
from optid.pid.pid_step import GAINS, LAST_COMMAND, MEMORY, PER_STEP, RESOLUTION
from optid.pid.symbolic import symbolic
from optid.tuning.machine import compiled
from optid.tuning.search import PLACES
from optid.tuning.task import Aggregation, Task

PARTS = 3  # parts of a cost with a gradient: measure, travel, overshoot


def sample(task: Task, free: tuple[str, ...], plant: int = 0) -> ca.Function:
    """One sample of one plant's loop with derivatives.

    (w, g, e) -> w afterwards: w holds the state [plant, controller, parts of the cost] and behind it its derivative
    to each free gain; g the free gains; e = (reference, load, weight, rise, noise) of the
    sample. Settings are constants; the resolution of the command is left out, as its steps would hide every slope.
    """
    A, B, dead = (values[plant] for values in task.closed_loop.arrays[:3])
    order, count = A.size, A.size + MEMORY + PARTS
    w, g, e = ca.SX.sym("w", count * (1 + len(free))), ca.SX.sym("g", len(free)), ca.SX.sym("e", 5)
    fixed = [ca.SX.sym(f"fixed{i}") for i in range(GAINS)]
    s = [*fixed, *(ca.SX(float(value)) for value in task.settings.vector)]
    s[RESOLUTION] = s[PER_STEP] = ca.SX(0)
    for j, name in enumerate(free):
        s[PLACES[name]] = g[j]
    x = w[:count]
    z, m = ca.vertsplit(x[:order]), ca.vertsplit(x[order : order + MEMORY])
    y, before = z[0], m[LAST_COMMAND]
    u = symbolic()(s, m, e[0], y + e[4])
    error = ca.fabs(e[0] - y)
    parts = x[order + MEMORY :] + ca.vertcat(
        e[2] * (error**2 if task.criterion.measure.power == 2 else error),
        ca.fabs(u - before) / task.command_size,
        0.0,
    )
    parts[2] = ca.fmax(x[-1], (y - e[0]) * e[3])
    drive = u + e[1]
    drive = drive - ca.fmin(ca.fmax(drive, float(dead[0])), float(dead[1]))
    shifted = [*z[1:], ca.SX(0)]
    z = [shifted[i] + B[i] * drive - A[i] * y for i in range(order)]
    after = ca.vertcat(*z, *m, parts)
    tangents = [w[count * (1 + j) : count * (2 + j)] for j in range(len(free))]
    slopes = [
        ca.jtimes(after, ca.vertcat(x, g), ca.vertcat(tangent, ca.DM.eye(len(free))[:, j]))
        for j, tangent in enumerate(tangents)
    ]
    return ca.Function(
        "sample", [w, g, e, ca.vertcat(*fixed)], [ca.cse(ca.densify(ca.vertcat(after, *slopes)))]
    )


class Gradient:
    """Cost and its derivative to the free gains.

    Args:
        task: without a bench, whose physics has no gradient here, and without a user's own cost.
        free: names of the gains.
    """

    def __init__(self, task: Task, free: tuple[str, ...]) -> None:
        assert task.criterion.own is None
        self._task, self._free = task, free
        self._codes = [_Code.of(sample(task, free, k)) for k in range(len(task.plants))]

    def __call__(self, gains: Array) -> tuple[float, Array]:
        """Of one set of gains (GAINS,): cost, and derivatives (free,); not finite where the loop diverges."""
        with np.errstate(over="ignore", invalid="ignore"):
            each = [self._plant(gains, k) for k in range(len(self._codes))]
            costs, slopes = np.array([one[0] for one in each]), np.array([one[1] for one in each])
            if len(each) == 1 or self._task.over is Aggregation.WORST:
                top = int(np.argmax(costs))
                return float(costs[top]), slopes[top]
            away, spread = costs - costs.mean(), max(float(costs.std()), 1e-300)
            tilt = away @ (slopes - slopes.mean(0)) / (len(each) * spread)
            return float(costs.mean() + costs.std()), slopes.mean(0) + tilt

    def _plant(self, gains: Array, plant: int) -> tuple[float, Array]:
        task, criterion = self._task, self._task.criterion
        order, n = task.closed_loop.arrays[0].shape[1], len(self._free)
        count = order + MEMORY + PARTS
        value, slope = 0.0, np.zeros(n)
        free = np.array([gains[PLACES[name]] for name in self._free])
        _, _, _, R, D, W, rise, noise, _ = task.closed_loop.arrays
        for e, episode in enumerate(task.episodes):
            w = np.zeros(count * (1 + n))
            w[order + LAST_COMMAND] = min(max(0.0, task.settings.low), task.settings.high)
            _run(
                self._codes[plant].place,
                w,
                free,
                np.ascontiguousarray(gains),
                R[e],
                D[e],
                W[e],
                rise[e],
                noise[e],
                np.empty(5),
            )
            rows = w.reshape(1 + n, count)[:, order + MEMORY :]
            measure, travel, overshoot = rows[0]
            factor = 1.0 + criterion.effort * travel + criterion.overshoot * overshoot
            value += episode.weight * measure * factor
            slope += episode.weight * (
                rows[1:, 0] * factor
                + measure * (criterion.effort * rows[1:, 1] + criterion.overshoot * rows[1:, 2])
            )
        return float(value), slope


@dataclass(frozen=True, eq=False)
class _Code:
    """Machine code of one sample; `engine` owns it."""

    place: int
    engine: Any

    @classmethod
    def of(cls, function: ca.Function) -> _Code:
        engine = machine_code(function.serialize(), lambda: _text(function))
        return cls(engine.get_function_address("sample"), engine)


def _text(function: ca.Function) -> str:
    """LLVM code of ``sample(w, g, e, fixed)``, which works in place on w and returns 0."""
    module = ir.Module("sample")
    place = REAL.as_pointer()
    code = ir.Function(module, ir.FunctionType(REAL, [place] * 4), "sample")
    b, held, results = ir.IRBuilder(code.append_basic_block()), {}, {}

    def where(argument: int, i: int) -> Any:
        return b.gep(code.args[argument], [ir.Constant(ir.IntType(32), i)])

    for k in range(function.n_instructions()):
        kind = function.instruction_id(k)
        into, given = function.instruction_output(k), function.instruction_input(k)
        if kind == ca.OP_CONST:
            held[into[0]] = number(float(function.instruction_constant(k)))
        elif kind == ca.OP_INPUT:
            held[into[0]] = b.load(where(given[0], given[1]))
        elif kind == ca.OP_OUTPUT:
            results[into[1]] = held[given[0]]
        else:
            count, form = FORMS[kind]
            held[into[0]] = form(b, *(held[i] for i in given[:count]))
    for i in range(function.nnz_out(0)):
        b.store(results.get(i, number(0.0)), where(0, i))
    b.ret(number(0.0))
    return str(module)


@compiled
def _run(place: Any, w: Any, g: Any, fixed: Any, R: Any, D: Any, W: Any, rise: Any, N: Any, e: Any) -> None:
    for n in range(R.size):
        e[0], e[1], e[2], e[3], e[4] = R[n], D[n], W[n], rise[n], N[n]
        call(place, (at(w, 0), at(g, 0), at(e, 0), at(fixed, 0)))
