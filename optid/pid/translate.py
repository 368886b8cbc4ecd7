"""`optid.pid.law` rewritten as C and as IEC 61131-3 structured text, so that there is one source.

Knows what the law is made of: straight-line assignments to names and to places of settings and memory, arithmetic,
comparisons, `abs` and the law's helpers. Anything else is refused. Every operation keeps its brackets, so that it is
done in the same order and gives the same bits.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from optid.errors import JobError

LARGEST = 1e308  # stands for an infinite limit, which neither language can be relied on to have
_ARITHMETIC: dict[type[ast.AST], str] = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/"}


@dataclass(frozen=True)
class Dialect:
    """How a language writes things.

    Attributes:
        number: a finite float.
        calls: helper of the law (and `abs`) -> text with a place for each argument.
        comparisons: operator -> sign.
        assign: target and value -> statement.
        field: structure and member -> text.
        result: value -> statement that gives it back.
    """

    number: Callable[[float], str]
    calls: dict[str, str]
    comparisons: dict[type[ast.AST], str]
    assign: Callable[[str, str], str]
    field: Callable[[str, str], str]
    result: Callable[[str], str]


def literal(value: float) -> str:
    """A float that reads back to its bits in both languages; an infinite one becomes the largest."""
    text = repr(math.copysign(LARGEST, value) if math.isinf(value) else float(value))
    mantissa, _, exponent = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    return f"{mantissa}E{int(exponent)}" if exponent else mantissa


_SIGNS: dict[type[ast.AST], str] = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}
C = Dialect(
    literal,
    {
        "chosen": "(({0}) ? ({1}) : ({2}))",
        "bounded": "fmin(fmax({0}, {1}), {2})",
        "smaller": "fmin({0}, {1})",
        "larger": "fmax({0}, {1})",
        "known": "(isnan({0}) ? ({1}) : ({0}))",
        "whole": "floor({0})",
        "abs": "fabs({0})",
    },
    {**_SIGNS, ast.Eq: "==", ast.NotEq: "!="},
    lambda target, value: f"    {target} = {value};",
    lambda structure, member: f"{structure}->{member}",
    lambda value: f"    return {value};",
)
STRUCTURED_TEXT = Dialect(
    literal,
    {
        "chosen": "SEL({0}, {2}, {1})",
        "bounded": "MIN(MAX({0}, {1}), {2})",
        "smaller": "MIN({0}, {1})",
        "larger": "MAX({0}, {1})",
        "known": "SEL(({0} = {0}), {1}, {0})",
        "whole": "{prefix}whole({0})",
        "abs": "ABS({0})",
    },
    {**_SIGNS, ast.Eq: "=", ast.NotEq: "<>"},
    lambda target, value: f"    {target} := {value};",
    lambda structure, member: f"{structure}.{member}",
    lambda value: f"    command := {value};",
)


@dataclass(frozen=True)
class Body:
    """A translated function: its statements, and the names of its local numbers."""

    statements: tuple[str, ...]
    names: tuple[str, ...]


def translate(function: Any, dialect: Dialect, prefix: str = "") -> Body:
    """The body of `law`, `start` or `change` in another language.

    Args:
        function: compiled by numba.
        dialect: of that language.
        prefix: of the names of helper functions there.

    Raises:
        JobError: the function uses more than this translator knows.
    """
    source = function.py_func
    tree = ast.parse(textwrap.dedent(inspect.getsource(source))).body[0]
    assert isinstance(tree, ast.FunctionDef)
    writer = _Writer(dialect, prefix, source.__globals__)
    lines = [writer.statement(node) for node in tree.body[1:]]  # behind the docstring
    return Body(tuple(lines), tuple(writer.names))


class _Writer:
    def __init__(self, dialect: Dialect, prefix: str, names: dict[str, Any]) -> None:
        self.dialect, self.prefix, self.globals = dialect, prefix, names
        self.names: list[str] = []

    def statement(self, node: ast.stmt) -> str:
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            target = node.targets[0]
            value = self.expression(node.value)
            if isinstance(target, ast.Name) and target.id not in self.names:
                self.names.append(target.id)
            return self.dialect.assign(self.expression(target), value)
        if isinstance(node, ast.Return) and node.value is not None:
            return self.dialect.result(self.expression(node.value))
        raise JobError(f"cannot translate: {ast.unparse(node)}")

    def expression(self, node: ast.expr) -> str:
        if isinstance(node, ast.Name):
            constant = self.globals.get(node.id)
            return self.dialect.number(constant) if isinstance(constant, float) else node.id
        if isinstance(node, ast.Constant) and isinstance(node.value, float):
            return self.dialect.number(node.value)
        if isinstance(node, ast.BinOp) and type(node.op) in _ARITHMETIC:
            sign = _ARITHMETIC[type(node.op)]
            return f"({self.expression(node.left)} {sign} {self.expression(node.right)})"
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            return f"(-{self.expression(node.operand)})"
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            sign = self.dialect.comparisons[type(node.ops[0])]
            return f"({self.expression(node.left)} {sign} {self.expression(node.comparators[0])})"
        if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Name):
            return self.dialect.field(ast.unparse(node.value), node.slice.id.lower())
        if isinstance(node, ast.Call) and ast.unparse(node.func) in self.dialect.calls:
            form = self.dialect.calls[ast.unparse(node.func)]
            return form.format(*map(self.expression, node.args), prefix=self.prefix)
        raise JobError(f"cannot translate: {ast.unparse(node)}")
