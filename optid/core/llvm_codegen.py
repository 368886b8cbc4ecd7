"""Write a model as LLVM's intermediate code: no C compiler is needed, and a model takes a fraction of a second.

The scalar instructions of an SX function become LLVM instructions in their order. Those that depend on parameters
alone move to `constants`, which runs once per parameter set instead of once per evaluation. Sensitivities
S = d x / d(start state, free parameters) have one row per state, and a row is one LLVM vector.

Integrator: one step of an explicit Runge-Kutta pair, all stages unrolled; `optid.core.kernel` sets its length.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import casadi as ca
from llvmlite import ir
from numba.core import cgutils
from scipy.integrate import RK45

from optid.core.instructions import FORMS, REAL, Value, add, div, intrinsic, mul, number
from optid.core.llvm_simd import (
    LANES,
    PLACE,
    SEVERAL,
    combine,
    index,
    largest,
    load,
    row_at,
    size,
    splat,
    store,
)
from optid.core.model import Model
from optid.core.rosenbrock import moved, rosenbrock, symbols

# Dormand and Prince (1980), table 2: stages, the last one with the weights of a step, and fourth minus fifth order.
A = (*(tuple(row[:i]) for i, row in enumerate(RK45.A.tolist())), tuple(RK45.B.tolist()))
E = tuple(RK45.E.tolist())

_ARGUMENTS = ("x", "u", "p", "h", "half")
_PARAMETER = 2  # position of p among the arguments
HALF = 0  # of c: which half of a hold, where inputs switch inside it


def width(directions: int) -> int:
    """Length of a row of S: the number of directions, padded."""
    return -(-directions // LANES) * LANES


def source(model: Model, free: Sequence[int]) -> str:
    """A model's equations with slopes to the states and to the `free` parameters: LLVM code.

    Every function returns a number and takes places of numbers; rows of S, T and R are padded to `width`. Those
    without slopes are there where no parameter is free:

    - ``constants(p, c)``, and ``hoisted()``, the length of c.
    - ``half(c, which)``, where inputs switch inside a hold: the equations are those of its half 0 or 1 from now on.
    - ``rates(x, S, u, c, k, T)``: k = dx/dt, with a zero behind it; S and T are not touched.
    - ``slopes(x, S, u, c, k, T)``: also T = dS/dt, and behind k the largest relaxation rate |d x_i' / d x_i|.
    - ``step(x, S, u, c, k, T, tolerance, h)`` and ``step_slopes``: from the rates at x one step of length h,
      taken if the largest error as a share of `tolerance`, which is returned, is at most 1.
    - ``sensors(x, S, u, c, y, R)`` and ``sensor_slopes``: y, one number behind it, and R = dy/d(start, free).
    - ``gather(R, H, g, a, b)``: H += a R' R and g += b R for one row R; H is (directions, width).
    - ``many_half``, ``many_slopes``, ``many_step_slopes``, ``many_sensor_slopes``: the same for `LANES` states at
      once, each with slopes of its own: rows also in S, T (states, directions), y and R (outputs, directions).
    - ``many_gather(R, H, g, a, b)``: the same, where a and b are places of rows and H is (directions, directions).
    """
    writer = _Writer(model, free)
    for plain, name in ((_rates(model), "slopes"), (_sensors(model), "sensor_slopes")):
        arguments = plain.sx_in()
        x, _, p, *_ = arguments
        values = plain(*arguments)
        jacobian = ca.jacobian(values, ca.vertcat(x, p[list(free)]) if free else x)
        if not free:
            writer.rates(plain, None)
        both = ca.Function(name, arguments, ca.cse([values, jacobian]))
        writer.rates(both, jacobian.sparsity())
        writer.many_slopes(both, jacobian.sparsity())
    if not free:
        writer.step("step", "rates", False)
    writer.step("step_slopes", "slopes", True)
    writer.many_step_slopes()
    writer.gather()
    writer.many_gather()
    return writer.finish()


def source_of_runs(model: Model) -> str:
    """A model without slopes, in a fraction of the time to compile: LLVM code.

    As of `source` ``constants``, ``rates``, ``step`` and ``sensors``.
    """
    writer = _Writer(model, ())
    writer.rates(_rates(model), None)
    writer.rates(_sensors(model), None)
    writer.step("step", "rates", False)
    return writer.finish()


def source_of_lanes(model: Model) -> str:
    """A model for the filter and its kin, which move several states at once: LLVM code.

    As of `source` ``constants`` and ``sensors``, and:

    - ``many_half`` as there, and ``many_step(x, u, c, tolerance, h)``: a step of `optid.core.rosenbrock` for `LANES`
      states at once. x, u and c are rows of `LANES` numbers; the largest error of all counts.
    """
    writer = _Writer(model, ())
    writer.rates(_sensors(model), None)
    writer.many_step(rosenbrock(model))
    return writer.finish()


def _rates(model: Model) -> ca.Function:
    arguments = symbols(model)
    return ca.Function("rates", arguments, [ca.cse(moved(model, *arguments))])


def _sensors(model: Model) -> ca.Function:
    arguments = symbols(model)[:3]
    return ca.Function("sensors", arguments, [ca.cse(ca.densify(model.sensors(*arguments)))])


class _Writer:
    """Collects functions in one module, and their parameter-only instructions in one `constants`."""

    def __init__(self, model: Model, free: Sequence[int]) -> None:
        self.module = ir.Module("equations")
        self.nx, self.nd = len(model.states), len(model.states) + len(free)
        self.row = ir.VectorType(REAL, width(self.nd))
        self.slots: dict[int, tuple[int, Value]] = {}  # id of a value of `constants` -> its place in c
        self._constants, self._of_constants = self._function("constants", ("p", "c"))
        if model.halves is not None:
            begins = number(0.0)
            self.slots[id(begins)] = HALF, begins
            self._halves("half", REAL)
            self._halves("many_half", SEVERAL)
        self._named: dict[tuple[object, ...], Value] = {}  # instruction and operands -> its value

    def _halves(self, name: str, kind: Value) -> None:
        """Which half of a hold the equations are of."""
        b, at = self._function(name, ("c",), ("which",))
        store(b, at["c"], HALF, splat(b, at["which"], kind))
        b.ret(number(0.0))

    def rates(self, function: ca.Function, pattern: ca.Sparsity | None) -> None:
        """Values and behind them the largest |J_ii|; with the `pattern` of the Jacobian their slopes along S."""
        b, at = self._function(function.name(), ("x", "S", "u", "c", "k", "T"))
        outputs = self._equations(function, b, at, REAL)
        for i, value in enumerate(outputs[0]):
            store(b, at["k"], i, value)
        fastest = number(0.0)
        if pattern is not None:
            S = [load(b, at["S"], i, self.row) for i in range(self.nx)]
            rows: list[Value] = [None] * pattern.size1()
            for i, j, value in zip(*pattern.get_triplet(), outputs[1], strict=True):
                if j < self.nx:
                    term = mul(b, splat(b, value, self.row), S[j])
                else:
                    term = b.insert_element(ir.Constant(self.row, None), value, index(j))
                rows[i] = term if rows[i] is None else add(b, rows[i], term)
                if i == j:
                    fastest = intrinsic("maxnum")(b, fastest, intrinsic("fabs")(b, value))
            for i, row in enumerate(rows):
                store(b, at["T"], i, ir.Constant(self.row, None) if row is None else row)
        store(b, at["k"], len(outputs[0]), fastest)
        b.ret(number(0.0))

    def step(self, name: str, rates: str, sensitive: bool) -> None:
        """A Runge-Kutta step from the rates k (and slopes T) at x, unrolled; too large an error leaves x unchanged."""
        b, at = self._function(name, ("x", "S", "u", "c", "k", "T", "tolerance"), ("h",))
        x = [load(b, at["x"], i) for i in range(self.nx)]
        k = [[load(b, at["k"], i) for i in range(self.nx + 1)]]
        S = [load(b, at["S"], i, self.row) for i in range(self.nx)] if sensitive else []
        T = [[load(b, at["T"], i, self.row) for i in range(len(S))]]
        moved, new = x, S
        stage, slope = (b.bitcast(b.alloca(REAL, index(self.nx + 1)), PLACE) for _ in range(2))
        stage_S, slope_S = (b.bitcast(b.alloca(self.row, index(self.nx)), PLACE) for _ in range(2))
        for weights in A[1:]:
            scaled = [mul(b, at["h"], number(w)) if w else None for w in weights]
            moved = [combine(b, x[i], scaled, [r[i] for r in k]) for i in range(self.nx)]
            new = [combine(b, S[i], scaled, [r[i] for r in T]) for i in range(len(S))]
            for place, values in ((stage, moved), (stage_S, new)):
                for i, value in enumerate(values):
                    store(b, place, i, value)
            b.call(self.module.globals[rates], (stage, stage_S, at["u"], at["c"], slope, slope_S))
            k.append([load(b, slope, i) for i in range(self.nx + 1)])
            T.append([load(b, slope_S, i, self.row) for i in range(len(S))])
        error = self._error(b, at, k, REAL)
        with b.if_then(b.fcmp_ordered("<=", error, number(1.0))):
            for place, values in (("x", moved), ("k", k[-1]), ("S", new), ("T", T[-1])):
                for i, value in enumerate(values):
                    store(b, at[place], i, value)
        b.ret(error)

    def many_step(self, function: ca.Function) -> None:
        """A step of `rosenbrock` for `LANES` states at once; too large an error leaves them unchanged."""
        b, at = self._function("many_step", ("x", "u", "c", "tolerance"), ("h",))
        moved = self._equations(function, b, at, SEVERAL)[0]
        error = ir.Constant(SEVERAL, None)
        for i, missed in enumerate(moved[self.nx :]):
            share = div(b, missed, splat(b, load(b, at["tolerance"], i), SEVERAL))
            error = intrinsic("maximum")(b, error, intrinsic("fabs")(b, share))
        error = largest(b, error)
        with b.if_then(b.fcmp_ordered("<=", error, number(1.0))):
            for i, value in enumerate(moved[: self.nx]):
                store(b, at["x"], i, value)
        b.ret(error)

    def many_slopes(self, function: ca.Function, pattern: ca.Sparsity) -> None:
        """As `rates` with slopes; a loop goes through the directions, of which there may be many."""
        b, at = self._function(f"many_{function.name()}", ("x", "S", "u", "c", "k", "T"))
        outputs = self._equations(function, b, at, SEVERAL)
        for i, value in enumerate(outputs[0]):
            store(b, at["k"], i, value)
        terms = list(zip(*pattern.get_triplet(), outputs[1], strict=True))
        fastest = ir.Constant(SEVERAL, None)
        with cgutils.for_range(b, size(self.nd)) as loop:
            for i in range(len(outputs[0])):
                total = ir.Constant(SEVERAL, None)
                for j, value in ((j, value) for row, j, value in terms if row == i and j < self.nx):
                    total = add(b, total, mul(b, value, row_at(b, at["S"], j * self.nd, loop.index)[1]))
                b.store(total, row_at(b, at["T"], i * self.nd, loop.index)[0], align=8)
        for i, j, value in terms:
            if j >= self.nx:
                place = i * self.nd + j
                store(b, at["T"], place, add(b, load(b, at["T"], place, SEVERAL), value))
            if i == j:
                fastest = intrinsic("maxnum")(b, fastest, intrinsic("fabs")(b, value))
        store(b, at["k"], len(outputs[0]), splat(b, largest(b, fastest), SEVERAL))
        b.ret(number(0.0))

    def many_step_slopes(self) -> None:
        """As `step` with slopes; they stay in memory."""
        b, at = self._function("many_step_slopes", ("x", "S", "u", "c", "k", "T", "tolerance"), ("h",))
        rows = self.nx * self.nd
        x = [load(b, at["x"], i, SEVERAL) for i in range(self.nx)]
        k = [[load(b, at["k"], i, SEVERAL) for i in range(self.nx + 1)]]
        stage, slope = (self._room(b, self.nx + 1) for _ in range(2))
        S, T = self._room(b, rows), [at["T"], *(self._room(b, rows) for _ in A[1:])]
        moved = x
        for number_of, weights in enumerate(A[1:]):
            scaled = [splat(b, mul(b, at["h"], number(w)), SEVERAL) if w else None for w in weights]
            moved = [combine(b, x[i], scaled, [r[i] for r in k]) for i in range(self.nx)]
            for i, value in enumerate(moved):
                store(b, stage, i, value)
            with cgutils.for_range(b, size(rows)) as loop:
                begin = row_at(b, at["S"], 0, loop.index)[1]
                seen = [
                    row_at(b, one, 0, loop.index)[1] if w else None
                    for one, w in zip(T, weights, strict=False)
                ]
                b.store(combine(b, begin, scaled, seen), row_at(b, S, 0, loop.index)[0], align=8)
            b.call(self.module.globals["many_slopes"], (stage, S, at["u"], at["c"], slope, T[number_of + 1]))
            k.append([load(b, slope, i, SEVERAL) for i in range(self.nx + 1)])
        error = self._error(b, at, k, SEVERAL)
        with b.if_then(b.fcmp_ordered("<=", error, number(1.0))):
            for place, values in (("x", moved), ("k", k[-1])):
                for i, value in enumerate(values):
                    store(b, at[place], i, value)
            with cgutils.for_range(b, size(rows)) as loop:
                for into, out in ((at["S"], S), (at["T"], T[-1])):
                    b.store(row_at(b, out, 0, loop.index)[1], row_at(b, into, 0, loop.index)[0], align=8)
        b.ret(error)

    def _room(self, b: Value, rows: int) -> Value:
        return b.bitcast(b.alloca(SEVERAL, index(rows)), PLACE)

    def _error(self, b: Value, at: Mapping[str, Value], k: Sequence[Sequence[Value]], kind: Value) -> Value:
        """The largest error of a step as a share of the tolerance; NaN stays."""
        error = splat(b, number(0.0), kind)
        for i in range(self.nx):
            total = combine(b, splat(b, number(0.0), kind), [number(w) for w in E], [r[i] for r in k])
            scale = div(b, at["h"], load(b, at["tolerance"], i))
            share = mul(b, splat(b, scale, kind), total)
            error = intrinsic("maximum")(b, error, intrinsic("fabs")(b, share))
        return largest(b, error)

    def many_gather(self) -> None:
        """The rank-one updates of the normal equations by one residual each."""
        b, at = self._function("many_gather", ("R", "H", "g", "a", "b"))
        for_H, for_g = (load(b, at[name], 0, SEVERAL) for name in ("a", "b"))
        with cgutils.for_range(b, size(self.nd)) as outer:
            here = row_at(b, at["R"], 0, outer.index)[1]
            place, g = row_at(b, at["g"], 0, outer.index)
            b.store(add(b, g, mul(b, for_g, here)), place, align=8)
            scaled, row = mul(b, for_H, here), b.mul(outer.index, size(self.nd))
            with cgutils.for_range(b, size(self.nd)) as inner:
                place, H = row_at(b, at["H"], 0, b.add(row, inner.index))
                b.store(add(b, H, mul(b, scaled, row_at(b, at["R"], 0, inner.index)[1])), place, align=8)
        b.ret(number(0.0))

    def gather(self) -> None:
        """The rank-one update of the normal equations by one residual."""
        b, at = self._function("gather", ("R", "H", "g"), ("a", "b"))
        R = load(b, at["R"], 0, self.row)
        scaled = mul(b, R, splat(b, at["a"], self.row))
        for i in range(self.nd):
            one = b.extract_element(scaled, index(i))
            H = load(b, at["H"], i, self.row)
            store(b, at["H"], i, add(b, H, mul(b, splat(b, one, self.row), R)))
        g = load(b, at["g"], 0, self.row)
        store(b, at["g"], 0, add(b, g, mul(b, splat(b, at["b"], self.row), R)))
        b.ret(number(0.0))

    def finish(self) -> str:
        """Close `constants` and return the module's text."""
        for slot, value in self.slots.values():
            store(self._constants, self._of_constants["c"], slot, value)
        self._constants.ret(number(0.0))
        b, _ = self._function("hoisted", ())
        b.ret(number(float(max(len(self.slots), 1))))
        return str(self.module)

    def _function(
        self, name: str, places: Sequence[str], numbers: Sequence[str] = ()
    ) -> tuple[Value, dict[str, Value]]:
        """Begin a function of arrays that do not overlap, and of numbers."""
        kind = ir.FunctionType(REAL, [PLACE] * len(places) + [REAL] * len(numbers))
        function = ir.Function(self.module, kind, name)
        arguments = dict(zip((*places, *numbers), function.args, strict=True))
        for place in places:
            arguments[place].add_attribute("noalias")
        return ir.IRBuilder(function.append_basic_block()), arguments

    def _equations(
        self, function: ca.Function, b: Value, at: dict[str, Value], kind: Value
    ) -> list[list[Value]]:
        """Continue with a CasADi function's instructions; returns every output's non-zeros."""
        held: dict[int, tuple[Value, bool]] = {}  # work register -> (value, depends on p alone)
        loaded: dict[int, Value] = {}
        outputs = [[number(0.0)] * function.nnz_out(i) for i in range(function.n_out())]

        def ready(value: Value, constant: bool) -> Value:
            if not constant or isinstance(value, ir.Constant):
                return splat(b, value, kind)
            slot, _ = self.slots.setdefault(id(value), (len(self.slots), value))
            if slot not in loaded:
                loaded[slot] = load(b, at["c"], slot, kind)
            return loaded[slot]

        for k in range(function.n_instructions()):
            code = function.instruction_id(k)
            into, given = function.instruction_output(k), function.instruction_input(k)
            if code == ca.OP_CONST:
                held[into[0]] = (number(float(function.instruction_constant(k))), True)
            elif code == ca.OP_INPUT:
                held[into[0]] = self._input(given, b, at, kind)
            elif code == ca.OP_OUTPUT:
                outputs[into[0]][into[1]] = ready(*held[given[0]])
            else:
                held[into[0]] = self._value(code, given, held, b, ready)
        return outputs

    def _input(self, given: Sequence[int], b: Value, at: dict[str, Value], kind: Value) -> tuple[Value, bool]:
        """An argument's element, and whether it depends on parameters alone."""
        if given[0] == _PARAMETER:
            return self._parameter(given[1]), True
        if _ARGUMENTS[given[0]] == "h":
            return splat(b, at["h"], kind), False
        if _ARGUMENTS[given[0]] == "half":
            return load(b, at["c"], HALF, kind), False
        return load(b, at[_ARGUMENTS[given[0]]], given[1], kind), False

    def _value(
        self,
        code: int,
        given: Sequence[int],
        held: Mapping[int, tuple[Value, bool]],
        b: Value,
        ready: Callable[[Value, bool], Value],
    ) -> tuple[Value, bool]:
        """The value of one instruction, in `constants` when it depends on parameters alone."""
        if code not in FORMS:
            raise NotImplementedError(f"CasADi instruction {code} has no compiled form")
        count, form = FORMS[code]
        given = given[:count]
        if code == ca.OP_DIV and held[given[1]][1] and not held[given[0]][1]:
            # A division takes as long as a dozen products: by parameters, the inverse is taken once.
            inverse = self._inverse(held[given[1]][0])
            return mul(b, ready(*held[given[0]]), ready(inverse, True)), False
        if not all(held[i][1] for i in given):
            return form(b, *(ready(*held[i]) for i in given)), False
        operands = [held[i][0] for i in given]
        key = (code, *(o.constant if isinstance(o, ir.Constant) else id(o) for o in operands))
        return self._once(key, lambda: form(self._constants, *operands)), True

    def _inverse(self, value: Value) -> Value:
        if isinstance(value, ir.Constant) and value.constant != 0.0:
            return number(1.0 / value.constant)
        return self._once(("inverse", id(value)), lambda: div(self._constants, number(1.0), value))

    def _parameter(self, i: int) -> Value:
        return self._once(("p", i), lambda: load(self._constants, self._of_constants["p"], i))

    def _once(self, key: tuple[object, ...], make: Callable[[], Value]) -> Value:
        if key not in self._named:
            self._named[key] = make()
        return self._named[key]
