"""Write a model's CasADi functions as Python source that numba compiles: no C compiler is needed.

The scalar instructions of an SX function become assignments in their order. Those that depend on parameters
alone move to `constants`, which runs once per parameter set instead of once per evaluation.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from optid.core.model import Model

# CasADi's instruction code -> Python expression; {0} and {1} are the operands.
_FORMS = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "{0} + {1}",
    ca.OP_SUB: "{0} - {1}",
    ca.OP_MUL: "{0} * {1}",
    ca.OP_DIV: "{0} / {1}",
    ca.OP_NEG: "-{0}",
    ca.OP_EXP: "math.exp({0})",
    ca.OP_LOG: "math.log({0})",
    ca.OP_LOG1P: "math.log1p({0})",
    ca.OP_EXPM1: "math.expm1({0})",
    ca.OP_POW: "{0} ** {1}",
    ca.OP_CONSTPOW: "{0} ** {1}",
    ca.OP_SQRT: "math.sqrt({0})",
    ca.OP_SQ: "{0} * {0}",
    ca.OP_TWICE: "2.0 * {0}",
    ca.OP_INV: "1.0 / {0}",
    ca.OP_SIN: "math.sin({0})",
    ca.OP_COS: "math.cos({0})",
    ca.OP_TAN: "math.tan({0})",
    ca.OP_ASIN: "math.asin({0})",
    ca.OP_ACOS: "math.acos({0})",
    ca.OP_ATAN: "math.atan({0})",
    ca.OP_ATAN2: "math.atan2({0}, {1})",
    ca.OP_SINH: "math.sinh({0})",
    ca.OP_COSH: "math.cosh({0})",
    ca.OP_TANH: "math.tanh({0})",
    ca.OP_ERF: "math.erf({0})",
    ca.OP_FABS: "abs({0})",
    ca.OP_SIGN: "sign({0})",
    ca.OP_FLOOR: "math.floor({0})",
    ca.OP_CEIL: "math.ceil({0})",
    ca.OP_FMOD: "math.fmod({0}, {1})",
    ca.OP_FMIN: "({0} if {0} < {1} else {1})",
    ca.OP_FMAX: "({0} if {0} > {1} else {1})",
    ca.OP_LT: "(1.0 if {0} < {1} else 0.0)",
    ca.OP_LE: "(1.0 if {0} <= {1} else 0.0)",
    ca.OP_EQ: "(1.0 if {0} == {1} else 0.0)",
    ca.OP_NE: "(1.0 if {0} != {1} else 0.0)",
    ca.OP_NOT: "(1.0 if {0} == 0.0 else 0.0)",
    ca.OP_AND: "(1.0 if {0} != 0.0 and {1} != 0.0 else 0.0)",
    ca.OP_OR: "(1.0 if {0} != 0.0 or {1} != 0.0 else 0.0)",
    # Zero where the condition fails, whatever the other operand is: an unused branch may be NaN.
    ca.OP_IF_ELSE_ZERO: "({1} if {0} != 0.0 else 0.0)",
}
_UNARY = {code for code, form in _FORMS.items() if "{1}" not in form}
_ARGUMENTS = ("x", "u", "p")
_PARAMETER = 2  # position of p among the arguments

_HEAD = '''"""Equations of "{name}", written by optid.core.emit; free parameters: {free}."""

import math

from numba import njit

# IEEE division instead of Python's check for zero, fused multiply-add allowed; NaN and infinity stay what they are.
compiled = njit(nogil=True, cache=True, error_model="numpy", fastmath={{"contract", "nsz", "arcp"}})
NX, NU, NY, NP, NC, NF, ND = {sizes}


@compiled
def sign(a):
    return 1.0 if a > 0.0 else (-1.0 if a < 0.0 else 0.0)

'''


class _Writer:
    """Collects the parameter-only instructions of several functions in one `constants`."""

    def __init__(self) -> None:
        self.constants: list[str] = []
        self.slots: dict[str, int] = {}  # variable of `constants` -> its place in c
        self._named: dict[str, str] = {}  # expression -> the variable that already holds it

    def body(self, function: ca.Function, prefix: str) -> tuple[list[str], list[list[str]]]:
        """Assignments of one function and, per output, the operand of every non-zero."""
        lines: list[str] = []
        held: dict[int, tuple[str, bool]] = {}  # work register -> (operand, depends on p alone)
        outputs = [["0.0"] * function.nnz_out(i) for i in range(function.n_out())]
        for k in range(function.n_instructions()):
            code = function.instruction_id(k)
            into, source = function.instruction_output(k), function.instruction_input(k)
            if code == ca.OP_CONST:
                held[into[0]] = (repr(float(function.instruction_constant(k))), True)
            elif code == ca.OP_INPUT:
                held[into[0]] = (f"{_ARGUMENTS[source[0]]}[{source[1]}]", source[0] == _PARAMETER)
            elif code == ca.OP_OUTPUT:
                outputs[into[0]][into[1]] = self._operand(held[source[0]])
            else:
                operands = [held[i] for i in (source[:1] if code in _UNARY else source)]
                held[into[0]] = self._assign(code, operands, f"{prefix}{k}", lines)
        return lines, outputs

    def _assign(
        self, code: int, operands: Sequence[tuple[str, bool]], name: str, lines: list[str]
    ) -> tuple[str, bool]:
        if code not in _FORMS:
            raise NotImplementedError(f"CasADi instruction {code} has no compiled form")
        constant = all(flag for _, flag in operands)
        if constant:
            expression = _FORMS[code].format(*(text for text, _ in operands))
            if expression in self._named:
                return self._named[expression], True
            self._named[expression] = name
            self.constants.append(f"{name} = {expression}")
        else:
            lines.append(f"{name} = {_FORMS[code].format(*map(self._operand, operands))}")
        return name, constant

    def _operand(self, value: tuple[str, bool]) -> str:
        """How a function's body reads a value: results of `constants` come from its array."""
        text, constant = value
        if not constant or not text.isidentifier() or text in ("inf", "nan"):
            return text.replace("inf", "math.inf").replace("nan", "math.nan") if constant else text
        return f"c[{self.slots.setdefault(text, len(self.slots))}]"


def source(model: Model, free: Sequence[int]) -> str:
    """Python source of a model's equations with slopes to the states and to the `free` parameters.

    The functions: ``constants(p, c)``; ``rates(x, u, p, c, dx)``; ``slopes(x, u, p, c, dx, J)`` with the
    non-zeros of d(rates)/d(x, p_free); ``fastest(x, u, p, c)``, the largest relaxation rate |d x_i' / d x_i|;
    ``push(J, S, T)``: T = J_x S + [0, J_p]; ``sensors``, ``sensor_slopes``
    and ``push_sensors`` alike.
    """
    x = ca.SX.sym("x", len(model.states))
    u = ca.SX.sym("u", len(model.inputs))
    p = ca.SX.sym("p", len(model.parameters))
    writer = _Writer()
    parts: list[str] = []
    for function, name, slopes, push in (
        (model.rates, "rates", "slopes", "push"),
        (model.sensors, "sensors", "sensor_slopes", "push_sensors"),
    ):
        values = function(x, u, p)
        jacobian = ca.jacobian(values, ca.vertcat(x, p[list(free)]) if free else x)
        plain = ca.Function(name, [x, u, p], [ca.cse(ca.densify(values))])
        both = ca.Function(slopes, [x, u, p], ca.cse([ca.densify(values), jacobian]))
        parts.append(_function(writer, plain, name, ("out",)))
        parts.append(_function(writer, both, slopes, ("out", "J")))
        parts.append(_push(push, jacobian, len(model.states)))
    relaxation = ca.mmax(ca.fabs(ca.diag(ca.jacobian(model.rates(x, u, p), x))))
    fastest = ca.Function("fastest", [x, u, p], [ca.cse(ca.densify(relaxation))])
    lines, outputs = writer.body(fastest, "f")
    body = "\n".join(f"    {line}" for line in [*lines, f"return {outputs[0][0]}"])
    parts.append(f"@compiled\ndef fastest(x, u, p, c):\n{body}")
    constants = ["@compiled", "def constants(p, c):", *(f"    {line}" for line in writer.constants)]
    constants += [f"    c[{slot}] = {name}" for name, slot in writer.slots.items()] or ["    pass"]
    nx, nf = len(model.states), len(free)
    sizes = (nx, len(model.inputs), len(model.outputs), len(model.parameters), len(writer.slots), nf, nx + nf)
    names = ", ".join(model.parameters[i].name for i in free) or "none"
    head = _HEAD.format(name=model.name, free=names, sizes=", ".join(map(str, sizes)))
    return head + "\n\n".join(["\n".join(constants), *parts]) + "\n"


def _function(writer: _Writer, function: ca.Function, name: str, targets: Sequence[str]) -> str:
    lines, outputs = writer.body(function, name[0] + ("s" if "slopes" in name else ""))
    for target, operands in zip(targets, outputs, strict=True):
        lines += [f"{target}[{i}] = {operand}" for i, operand in enumerate(operands)]
    head = ["@compiled", f"def {name}(x, u, p, c, {', '.join(targets)}):"]
    return "\n".join([*head, *(f"    {line}" for line in lines)])


def _push(name: str, jacobian: ca.SX, nx: int) -> str:
    """The sparse product unrolled over the non-zeros, one loop over the directions."""
    rows, columns = jacobian.sparsity().get_triplet()
    body = ["for d in range(ND):"]
    for i in range(jacobian.size1()):
        terms = [
            f"J[{k}] * S[{j}, d]"
            for k, (r, j) in enumerate(zip(rows, columns, strict=True))
            if r == i and j < nx
        ]
        body.append(f"    T[{i}, d] = {' + '.join(terms) or '0.0'}")
    body += [f"T[{r}, {j}] += J[{k}]" for k, (r, j) in enumerate(zip(rows, columns, strict=True)) if j >= nx]
    return "\n".join(["@compiled", f"def {name}(J, S, T):", *(f"    {line}" for line in body)])
