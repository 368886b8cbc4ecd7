"""The recursion's Python functions written in IEC 61131-3 structured text: the same source as Python and C.

Structured text has no pointers: a part of the packed array is the number of its first entry, and every function
takes the whole array in and out. It does not tell D from d: arrays become p_NAME, numbers v_NAME.
"""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from typing import Any

from optid.armax.translate import _Function as _InC
from optid.armax.translate import signatures
from optid.errors import JobError

_OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Mod: "MOD",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
    ast.Eq: "=",
    ast.NotEq: "<>",
    ast.And: "AND",
    ast.Or: "OR",
}
_TYPES = {"Array": "DINT", "int": "DINT", "float": "LREAL", "bool": "BOOL"}
MEMORY = "memory"


def literal(value: float) -> str:
    """A finite number that reads back to its bits in structured text."""
    mantissa, _, exponent = repr(float(value)).partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    return f"{mantissa}E{int(exponent)}" if exponent else mantissa


def translate_st(functions: Sequence[Any], prefix: str, constants: Mapping[str, int], size: int) -> str:
    """Structured text of the functions, in the given order.

    Args:
        functions: compiled by numba; annotated with `Array`, `float` or `int`.
        prefix: of every function's name.
        constants: what `shape.NAME` is; an argument `shape` falls away.
        size: of the packed array.

    Raises:
        JobError: a function uses more than this translator knows.
    """
    sources = [getattr(function, "py_func", function) for function in functions]
    known = signatures(sources)
    return "\n".join(_Function(source, prefix, constants, known).block_of(size) for source in sources)


class _Function(_InC):
    """One function as structured text."""

    def block_of(self, size: int) -> str:
        inputs = list(self.types)
        assigned = {
            node.id
            for node in ast.walk(self.tree)
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)
        }
        body, docstring = self.tree.body, ast.get_docstring(self.tree)
        lines = self.block(body[1:] if docstring else body, 1)
        own = f"{self.prefix}{self.tree.name}"
        taken = [f"    {self.name(n)}{'_in' * (n in assigned)} : {_TYPES[self.types[n]]};" for n in inputs]
        held = [n for n in self.types if n not in inputs or n in assigned]
        local = [f"    {self.name(n)} : {_TYPES[self.types[n]]};" for n in held] + ["    ignored : LREAL;"]
        copied = [f"    {self.name(n)} := {self.name(n)}_in;" for n in inputs if n in assigned]
        comment = f" (* {docstring.splitlines()[0]} *)" if docstring else ""
        return "\n".join(
            [
                f"FUNCTION {own} : LREAL{comment}",
                "VAR_IN_OUT",
                f"    {MEMORY} : ARRAY[0..{size - 1}] OF LREAL;",
                "END_VAR",
                "VAR_INPUT",
                *taken,
                "END_VAR",
                "VAR",
                *local,
                "END_VAR",
                *copied,
                *lines,
                "END_FUNCTION",
                "",
            ]
        )

    def block(self, body: Sequence[ast.stmt], depth: int) -> list[str]:
        pad = "    " * depth
        lines: list[str] = []
        for node in body:
            if isinstance(node, ast.For):
                lines += [f"{pad}{self.loop(node)}", *self.block(node.body, depth + 1), f"{pad}END_FOR;"]
            elif isinstance(node, ast.If):
                lines += [f"{pad}IF {self.condition(node.test)} THEN", *self.block(node.body, depth + 1)]
                if node.orelse:
                    lines += [f"{pad}ELSE", *self.block(node.orelse, depth + 1)]
                lines.append(f"{pad}END_IF;")
            elif isinstance(node, ast.Return) and node.value is not None:
                value = self.number(node.value)
                lines += [f"{pad}{self.prefix}{self.tree.name} := {value};", f"{pad}RETURN;"]
            else:
                lines.append(f"{pad}{self.simple(node)}")
        return lines

    def simple(self, node: ast.stmt) -> str:
        """An assignment or a call."""
        if isinstance(node, ast.Assign) and len(node.targets) == 1:
            return self.assign(node.targets[0], node.value)
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            return self.assign(node.target, node.value)
        if isinstance(node, ast.AugAssign):
            return self.assign(node.target, ast.BinOp(node.target, node.op, node.value))
        if isinstance(node, ast.Expr):
            return f"ignored := {self.expression(node.value)};"
        raise JobError(f"cannot write in structured text: {ast.unparse(node)}")

    def loop(self, node: ast.For) -> str:
        if not (isinstance(node.target, ast.Name) and isinstance(node.iter, ast.Call)):
            raise JobError(f"cannot write in structured text: {ast.unparse(node)}")
        bounds = [self.expression(argument) for argument in node.iter.args]
        low, high = ("0", bounds[0]) if len(bounds) == 1 else (bounds[0], bounds[1])
        self.types.setdefault(node.target.id, "int")
        return f"FOR {self.name(node.target.id)} := {low} TO ({high} - 1) DO"

    def assign(self, target: ast.expr, value: ast.expr) -> str:
        if isinstance(target, ast.Name):
            self.types.setdefault(target.id, self.kind(value))
        wanted = self.kind(target)
        text = self.number(value) if wanted == "float" else self.expression(value)
        return f"{self.expression(target)} := {text};"

    def kind(self, node: ast.expr) -> str:
        if isinstance(node, ast.Compare | ast.BoolOp) or (
            isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not)
        ):
            return "bool"
        if isinstance(node, ast.Attribute) and ast.unparse(node) == "math.nan":
            return "float"
        return super().kind(node)

    def number(self, node: ast.expr) -> str:
        """An expression as LREAL."""
        if self.kind(node) != "int":
            return self.expression(node)
        if isinstance(node, ast.Constant):
            return literal(float(ast.unparse(node)))
        return f"DINT_TO_LREAL({self.expression(node)})"

    def condition(self, node: ast.expr) -> str:
        """An expression as BOOL."""
        text = self.expression(node)
        return text if self.kind(node) == "bool" else f"({text} <> 0)"

    def expression(self, node: ast.expr) -> str:
        if isinstance(node, ast.Constant):
            return ast.unparse(node) if isinstance(node.value, int) else literal(float(ast.unparse(node)))
        if isinstance(node, ast.BinOp):
            return self.binary(node.left, node.op, node.right)
        if isinstance(node, ast.Compare) and len(node.ops) == 1:
            return self.binary(node.left, node.ops[0], node.comparators[0])
        if isinstance(node, ast.UnaryOp):
            sign = "NOT " if isinstance(node.op, ast.Not) else "-"
            return f"({sign}{self.expression(node.operand)})"
        if isinstance(node, ast.BoolOp):
            return (
                f"({f' {_OPERATORS[type(node.op)]} '.join(self.condition(value) for value in node.values)})"
            )
        if isinstance(node, ast.Subscript):
            base = self.expression(node.value)
            if isinstance(node.slice, ast.Slice) and node.slice.lower is not None:
                return f"({base} + {self.expression(node.slice.lower)})"
            return f"{MEMORY}[({base} + {self.expression(node.slice)})]"
        if isinstance(node, ast.Attribute) and ast.unparse(node) == "math.nan":
            return f"{self.prefix}nan()"
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "shape":
            return f"{self.constants[node.attr]}"
        return super().expression(node)

    def binary(self, left: ast.expr, operator: ast.AST, right: ast.expr) -> str:
        """Both sides as LREAL where one of them is."""
        if isinstance(operator, ast.FloorDiv):
            return f"DIV({self.expression(left)}, {self.expression(right)})"
        mixed = {self.kind(left), self.kind(right)} == {"int", "float"} or isinstance(operator, ast.Div)
        say = self.number if mixed else self.expression
        return f"({say(left)} {_OPERATORS[type(operator)]} {say(right)})"

    def call(self, node: ast.Call) -> str:
        function = ast.unparse(node.func)
        if function == "int":
            return f"LREAL_TO_DINT({self.number(node.args[0])})"
        if function == "part":
            return "({} + {})".format(*(self.expression(argument) for argument in node.args))
        arguments = [argument for argument in node.args if ast.unparse(argument) != "shape"]
        if function in self.known:
            kinds = self.known[function]
            listed = [
                self.number(a) if kind == "float" else self.expression(a)
                for a, kind in zip(arguments, kinds, strict=True)
            ]
            return f"{self.prefix}{function}({', '.join([MEMORY, *listed])})"
        if function in {"abs", "math.sqrt"}:
            return f"{'ABS' if function == 'abs' else 'SQRT'}({self.number(arguments[0])})"
        raise JobError(f"cannot write in structured text: {ast.unparse(node)}")

    def name(self, name: str) -> str:
        if name in self.types:
            return f"{'p' if self.types[name] == 'Array' else 'v'}_{name}"
        value = self.globals.get(name)
        if isinstance(value, int):
            return str(value)
        if isinstance(value, float):
            return literal(value)
        raise JobError(f'cannot write in structured text: "{name}" is no number')
