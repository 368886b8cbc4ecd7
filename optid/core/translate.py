"""Python functions rewritten as C and as IEC 61131-3 structured text, so that there is a single source.

Reads the subset of Python used by the control law and the recursive identifier: assignments, ranges, conditions,
floats, whole numbers, parts of one array of doubles, members of structures, and calls of known functions. Anything else
is refused. Every operation keeps its brackets, so that it is done in the same order and gives the same bits.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from optid.core.languages import ARRAY, BOOL, FLOAT, INT, MEMORY, STRUCTURED_TEXT, C, Language, literal
from optid.errors import JobError

__all__ = ["STRUCTURED_TEXT", "C", "Translation", "literal", "signatures", "translated"]


def signatures(sources: Sequence[Any]) -> dict[str, tuple[str, ...]]:
    """Name of each function -> what its arguments are, the shape apart."""
    return {
        source.__name__: tuple(
            str(kind) for name, kind in source.__annotations__.items() if name not in ("return", "shape")
        )
        for source in sources
    }


def translated(
    functions: Sequence[Any], language: Language, prefix: str, constants: Mapping[str, int]
) -> list[Translation]:
    """Functions that call each other, in the given order.

    Args:
        functions: compiled by numba; annotated with `Array`, `float` or `int`.
        language: to write.
        prefix: of every function's name.
        constants: values of `shape.NAME`; the argument `shape` is dropped.

    Raises:
        JobError: a function uses more than is read here.
    """
    sources = [getattr(function, "py_func", function) for function in functions]
    known = signatures(sources)
    return [Translation(source, language, prefix, constants, known) for source in sources]


class Translation:
    """One function in another language.

    Args:
        function: Python's or numba's.
        language: to write.
        prefix: of functions' names there.
        constants: what `shape.NAME` is.
        known: functions it may call, and what their arguments are.
        structures: its arrays are structures, whose members are the constants' names in small letters.

    Attributes:
        name, about: of the function, and the first line of its docstring.
        arguments: name -> kind.
        types: the same of all names, arguments first.
        assigned: names that something is assigned to.
        lines: the body.
    """

    def __init__(
        self,
        function: Any,
        language: Language,
        prefix: str,
        constants: Mapping[str, int] | None = None,
        known: Mapping[str, tuple[str, ...]] | None = None,
        *,
        structures: bool = False,
    ) -> None:
        source = getattr(function, "py_func", function)
        self.language, self.prefix, self.structures = language, prefix, structures
        self.constants, self.known = constants or {}, known or {}
        self.globals: Mapping[str, Any] = source.__globals__
        tree = ast.parse(textwrap.dedent(inspect.getsource(source))).body[0]
        if not isinstance(tree, ast.FunctionDef):
            raise JobError(f"{function} is not a function")
        self.name, docstring = tree.name, ast.get_docstring(tree)
        self.about = docstring.splitlines()[0] if docstring else ""
        self.arguments = {
            arg.arg: ast.unparse(arg.annotation)
            for arg in tree.args.args
            if arg.annotation and arg.arg != "shape"
        }
        self.types = dict(self.arguments)
        names = [node for node in ast.walk(tree) if isinstance(node, ast.Name)]
        self.assigned = {node.id for node in names if isinstance(node.ctx, ast.Store)}
        self.lines = self._block(tree.body[1:] if docstring else tree.body, 1)

    def _refused(self, node: ast.AST) -> JobError:
        return JobError(f"cannot write in {self.language.name}: {ast.unparse(node)}")

    def _block(self, body: Sequence[ast.stmt], depth: int) -> list[str]:
        pad, say = "    " * depth, self.language
        lines: list[str] = []
        for node in body:
            if isinstance(node, ast.For):
                lines += [pad + self._loop(node), *self._block(node.body, depth + 1), pad + say.end_loop]
            elif isinstance(node, ast.If):
                lines += [
                    pad + say.condition.format(self._condition(node.test)),
                    *self._block(node.body, depth + 1),
                ]
                if node.orelse:
                    lines += [pad + say.otherwise.format(), *self._block(node.orelse, depth + 1)]
                lines.append(pad + say.end)
            else:
                lines += [pad + line for line in self._simple(node)]
        return lines

    def _simple(self, node: ast.stmt) -> list[str]:
        """An assignment, a call, or a result."""
        if isinstance(node, ast.Return) and node.value is not None:
            given = self.language.give.format(self._number(node.value), f"{self.prefix}{self.name}")
            return [given, "RETURN;"] if self.language.strict and not self.structures else [given]
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            return [self._assignment(node.targets[0], node.value)]
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            return [self._assignment(node.target, node.value)]
        if isinstance(node, ast.AugAssign):
            return [self._assignment(node.target, ast.BinOp(node.target, node.op, node.value))]
        if isinstance(node, ast.Expr):
            return [self.language.ignore.format(self.expression(node.value))]
        raise self._refused(node)

    def _loop(self, node: ast.For) -> str:
        if not (isinstance(node.target, ast.Name) and isinstance(node.iter, ast.Call)):
            raise self._refused(node)
        bounds = [self.expression(argument) for argument in node.iter.args]
        low, high = ("0", bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        self.types.setdefault(node.target.id, INT)
        return self.language.loop.format(self.expression(node.target), low, high)

    def _assignment(self, target: ast.expr, value: ast.expr) -> str:
        if isinstance(target, ast.Name):
            self.types.setdefault(target.id, self.kind(value))
        text = self._number(value) if self.kind(target) == FLOAT else self.expression(value)
        return self.language.assign.format(self.expression(target), text)

    def kind(self, node: ast.expr) -> str:
        """Array, int, bool or float: what a name assigned from this expression is."""
        if isinstance(node, ast.Subscript):
            return ARRAY if isinstance(node.slice, ast.Slice) else FLOAT
        if isinstance(node, ast.Constant):
            return INT if isinstance(node.value, int) else FLOAT
        if isinstance(node, ast.Name):
            return self.types.get(node.id) or (INT if isinstance(self.globals.get(node.id), int) else FLOAT)
        if isinstance(node, ast.Compare | ast.BoolOp):
            return BOOL if self.language.strict else INT
        if isinstance(node, ast.Attribute):
            return FLOAT if ast.unparse(node) == "math.nan" else INT
        if isinstance(node, ast.Call):
            return {"int": INT, "part": ARRAY}.get(ast.unparse(node.func), FLOAT)
        if isinstance(node, ast.BinOp):
            sides = {self.kind(node.left), self.kind(node.right)}
            return FLOAT if FLOAT in sides or isinstance(node.op, ast.Div) else INT
        if isinstance(node, ast.UnaryOp):
            negated = isinstance(node.op, ast.Not) and self.language.strict
            return BOOL if negated else self.kind(node.operand)
        raise self._refused(node)

    def _number(self, node: ast.expr) -> str:
        """An expression as a float."""
        if not self.language.strict or self.kind(node) != INT:
            return self.expression(node)
        if isinstance(node, ast.Constant):
            return literal(float(ast.unparse(node)))
        return f"DINT_TO_LREAL({self.expression(node)})"

    def _condition(self, node: ast.expr) -> str:
        text = self.expression(node)
        return f"({text} <> 0)" if self.language.strict and self.kind(node) != BOOL else text

    def expression(self, node: ast.expr) -> str:
        """As text."""
        if isinstance(node, ast.Constant):
            return repr(node.value) if isinstance(node.value, int) else literal(float(ast.unparse(node)))
        if isinstance(node, ast.BinOp):
            return self._binary(node.left, node.op, node.right)
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            return self._binary(node.left, node.ops[0], node.comparators[0])
        if isinstance(node, ast.UnaryOp):
            no, minus = self.language.signs
            return f"({no if isinstance(node.op, ast.Not) else minus}{self.expression(node.operand)})"
        if isinstance(node, ast.BoolOp):
            sign = f" {self.language.operators[type(node.op)]} "
            return f"({sign.join(self._condition(value) for value in node.values)})"
        return self._place(node)

    def _place(self, node: ast.expr) -> str:
        """An operand: a name, an entry, a member, a call."""
        if isinstance(node, ast.Name):
            return self._named(node.id)
        if isinstance(node, ast.Subscript):
            return self._entry(node)
        if isinstance(node, ast.Call):
            return self._call(node)
        if isinstance(node, ast.Attribute) and ast.unparse(node) == "math.nan":
            return self.language.nan.format(self.prefix)
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "shape":
            return f"{self.constants[node.attr]}"
        raise self._refused(node)

    def _binary(self, left: ast.expr, operator: ast.AST, right: ast.expr) -> str:
        """Both sides as floats where one of them is."""
        if isinstance(operator, ast.FloorDiv):
            return self.language.divide.format(self.expression(left), self.expression(right))
        if type(operator) not in self.language.operators:
            raise self._refused(ast.BinOp(left, operator, right))  # type: ignore[arg-type]
        mixed = {self.kind(left), self.kind(right)} == {INT, FLOAT} or isinstance(operator, ast.Div)
        say = self._number if mixed else self.expression
        return f"({say(left)} {self.language.operators[type(operator)]} {say(right)})"

    def _entry(self, node: ast.Subscript) -> str:
        if self.structures:
            if not isinstance(node.slice, ast.Name):
                raise self._refused(node)
            return self.language.field.format(ast.unparse(node.value), node.slice.id.lower())
        base = self.expression(node.value)
        if isinstance(node.slice, ast.Slice) and node.slice.lower is not None:
            return f"({base} + {self.expression(node.slice.lower)})"
        place = self.expression(node.slice)
        return f"{MEMORY}[({base} + {place})]" if self.language.strict else f"{base}[{place}]"

    def _call(self, node: ast.Call) -> str:
        function = ast.unparse(node.func)
        arguments = [argument for argument in node.args if ast.unparse(argument) != "shape"]
        if function == "part":
            return "({} + {})".format(*(self.expression(argument) for argument in arguments))
        if function in self.known:
            kinds = self.known[function]
            listed = [
                self._number(argument) if kind == FLOAT else self.expression(argument)
                for argument, kind in zip(arguments, kinds, strict=True)
            ]
            memory = [MEMORY] if self.language.strict else []
            return f"{self.prefix}{function}({', '.join([*memory, *listed])})"
        if function in self.language.calls:
            form = self.language.calls[function]
            return form.format(*map(self.expression, arguments), prefix=self.prefix)
        raise self._refused(node)

    def _named(self, name: str) -> str:
        if name in self.types:
            kind = "p" if self.types[name] == ARRAY else "v"
            return f"{kind}_{name}" if self.language.strict and not self.structures else name
        value = self.globals.get(name)
        if isinstance(value, int):
            return repr(value)
        if isinstance(value, float) and not math.isnan(value):
            return literal(value)
        raise JobError(f'cannot write in {self.language.name}: "{name}" is not a number')
