"""The recursion's Python functions written in C, so that there is one source and no hand-kept twin.

Understands what `optid.armax.recursion` and the files it calls use: floats, whole numbers, parts of one array
of doubles, ranges, conditions, and calls of its own functions, `abs`, `int` and `math`. Anything else is refused.
"""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from optid.errors import JobError

_OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.FloorDiv: "/",  # of whole numbers that are never negative
    ast.Mod: "%",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "==",
    ast.NotEq: "!=",
    ast.And: "&&",
    ast.Or: "||",
}
_TYPES = {"Array": "double *", "float": "double ", "int": "long "}


def translate(functions: Sequence[Any], prefix: str, constants: Mapping[str, int]) -> str:
    """C source of the functions, each `static`, in the given order.

    Args:
        functions: compiled by numba; annotated with `Array`, `float` or `int`.
        prefix: of every name in C.
        constants: what `shape.NAME` is; an argument `shape` falls away.

    Raises:
        JobError: a function uses more than this translator knows.
    """
    sources = [getattr(function, "py_func", function) for function in functions]
    known = signatures(sources)
    return "\n".join(_Function(source, prefix, constants, known).text() for source in sources)


def signatures(sources: Sequence[Any]) -> dict[str, tuple[str, ...]]:
    """Name of each function -> what its arguments are, the shape apart."""
    return {
        source.__name__: tuple(
            str(kind) for name, kind in source.__annotations__.items() if name not in ("return", "shape")
        )
        for source in sources
    }


class _Function:
    """One function of the recursion, being written in another language."""

    def __init__(
        self, function: Any, prefix: str, constants: Mapping[str, int], known: Mapping[str, Any]
    ) -> None:
        self.prefix, self.constants, self.known = prefix, constants, known
        self.globals: Mapping[str, Any] = function.__globals__
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        if not isinstance(tree, ast.FunctionDef):
            raise JobError(f"{function} is not a function")
        self.tree = tree
        self.types = {
            arg.arg: ast.unparse(arg.annotation)
            for arg in tree.args.args
            if arg.annotation and arg.arg != "shape"
        }
        self.declared = set(self.types)

    def text(self) -> str:
        parameters = ", ".join(f"{_TYPES[kind]}{name}" for name, kind in self.types.items())
        body, docstring = self.tree.body, ast.get_docstring(self.tree)
        lines = self.block(body[1:] if docstring else body, 1)
        comment = f"/* {docstring.splitlines()[0]} */\n" if docstring else ""
        declared = [
            f"    {_TYPES[self.types[name]]}{name};" for name in self.types if name not in self.declared
        ]
        head = f"{comment}static inline double {self.prefix}{self.tree.name}({parameters})\n{{"
        return "\n".join([head, *declared, *lines, "}", ""])

    def block(self, body: Sequence[ast.stmt], depth: int) -> list[str]:
        pad = "    " * depth
        lines: list[str] = []
        for node in body:
            if isinstance(node, ast.Assign) and len(node.targets) == 1:
                lines.append(f"{pad}{self.assign(node.targets[0], node.value)}")
            elif isinstance(node, ast.AnnAssign) and node.value is not None:
                lines.append(f"{pad}{self.assign(node.target, node.value)}")
            elif isinstance(node, ast.AugAssign):
                operator = _OPERATORS[type(node.op)]
                lines.append(
                    f"{pad}{self.expression(node.target)} {operator}= {self.expression(node.value)};"
                )
            elif isinstance(node, ast.For):
                lines += [f"{pad}{self.loop(node)} {{", *self.block(node.body, depth + 1), f"{pad}}}"]
            elif isinstance(node, ast.If):
                lines += [
                    f"{pad}if ({self.expression(node.test)}) {{",
                    *self.block(node.body, depth + 1),
                    f"{pad}}}",
                ]
                if node.orelse:
                    lines[-1] += " else {"
                    lines += [*self.block(node.orelse, depth + 1), f"{pad}}}"]
            elif isinstance(node, ast.Return) and node.value is not None:
                lines.append(f"{pad}return {self.expression(node.value)};")
            elif isinstance(node, ast.Expr):
                lines.append(f"{pad}{self.expression(node.value)};")
            else:
                raise JobError(f"cannot write in C: {ast.unparse(node)}")
        return lines

    def loop(self, node: ast.For) -> str:
        if not (isinstance(node.target, ast.Name) and isinstance(node.iter, ast.Call)):
            raise JobError(f"cannot write in C: {ast.unparse(node)}")
        bounds = [self.expression(argument) for argument in node.iter.args]
        low, high = ("0", bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        name = node.target.id
        self.types.setdefault(name, "int")
        return f"for ({name} = {low}; {name} < {high}; {name}++)"

    def assign(self, target: ast.expr, value: ast.expr) -> str:
        if isinstance(target, ast.Name):
            self.types.setdefault(target.id, self.kind(value))
        return f"{self.expression(target)} = {self.expression(value)};"

    def kind(self, node: ast.expr) -> str:
        """Array, int or float: what a name assigned from this expression is."""
        if isinstance(node, ast.Subscript):
            return "Array" if isinstance(node.slice, ast.Slice) else "float"
        if isinstance(node, ast.Constant):
            return "int" if isinstance(node.value, int) else "float"
        if isinstance(node, ast.Name):
            if node.id in self.types:
                return self.types[node.id]
            return "int" if isinstance(self.globals[node.id], int) else "float"
        if isinstance(node, ast.Compare | ast.BoolOp | ast.Attribute):
            return "int"
        if isinstance(node, ast.Call):
            return {"int": "int", "part": "Array"}.get(ast.unparse(node.func), "float")
        if isinstance(node, ast.BinOp):
            sides = {self.kind(node.left), self.kind(node.right)}
            return "float" if "float" in sides or isinstance(node.op, ast.Div) else "int"
        if isinstance(node, ast.UnaryOp):
            return self.kind(node.operand)
        raise JobError(f"cannot write in C: {ast.unparse(node)}")

    def expression(self, node: ast.expr) -> str:
        if isinstance(node, ast.Constant):
            return repr(node.value)
        if isinstance(node, ast.Name):
            return self.name(node.id)
        if isinstance(node, ast.BinOp):
            operator = _OPERATORS[type(node.op)]
            return f"({self.expression(node.left)} {operator} {self.expression(node.right)})"
        if isinstance(node, ast.UnaryOp):
            sign = "!" if isinstance(node.op, ast.Not) else "-"
            return f"{sign}({self.expression(node.operand)})"
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            operator = _OPERATORS[type(node.ops[0])]
            return f"({self.expression(node.left)} {operator} {self.expression(node.comparators[0])})"
        if isinstance(node, ast.BoolOp):
            operator = f" {_OPERATORS[type(node.op)]} "
            return f"({operator.join(self.expression(value) for value in node.values)})"
        if isinstance(node, ast.Subscript):
            base = self.expression(node.value)
            if isinstance(node.slice, ast.Slice) and node.slice.lower is not None:
                return f"({base} + {self.expression(node.slice.lower)})"
            return f"{base}[{self.expression(node.slice)}]"
        if isinstance(node, ast.Call):
            return self.call(node)
        if isinstance(node, ast.Attribute) and ast.unparse(node) == "math.nan":
            return "NAN"
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "shape":
            return f"({self.constants[node.attr]})"
        raise JobError(f"cannot write in C: {ast.unparse(node)}")

    def call(self, node: ast.Call) -> str:
        function = ast.unparse(node.func)
        if function == "int":
            return f"((long)({self.expression(node.args[0])}))"
        if function == "part":
            return "({} + {})".format(*(self.expression(argument) for argument in node.args))
        arguments = ", ".join(
            self.expression(argument) for argument in node.args if ast.unparse(argument) != "shape"
        )
        if function in self.known:
            return f"{self.prefix}{function}({arguments})"
        if function in {"abs", "math.sqrt"}:
            return f"{'fabs' if function == 'abs' else 'sqrt'}({arguments})"
        raise JobError(f"cannot write in C: {ast.unparse(node)}")

    def name(self, name: str) -> str:
        if name in self.types:
            return name
        value = self.globals.get(name)
        if isinstance(value, int | float) and math.isfinite(value):
            return repr(value)
        raise JobError(f'cannot write in C: "{name}" is no number')
