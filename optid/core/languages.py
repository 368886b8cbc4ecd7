"""How C and IEC 61131-3 structured text write what `optid.core.translate` reads from Python functions."""

from __future__ import annotations

import ast
import math
from dataclasses import dataclass

LARGEST = 1e308  # stands for an infinite number, which neither language can be relied on to have
ARRAY, FLOAT, INT, BOOL = "Array", "float", "int", "bool"
MEMORY = "memory"  # the one array of structured text, which has no pointers

Operators = dict[type[ast.AST], str]
_SHARED: Operators = {
    ast.Add: "+",
    ast.Sub: "-",
    ast.Mult: "*",
    ast.Div: "/",
    ast.Lt: "<",
    ast.LtE: "<=",
    ast.Gt: ">",
    ast.GtE: ">=",
}


def literal(value: float) -> str:
    """A float that reads back to its bits in both languages; an infinite one becomes the largest."""
    text = repr(math.copysign(LARGEST, value) if math.isinf(value) else float(value))
    mantissa, _, exponent = text.partition("e")
    if "." not in mantissa:
        mantissa += ".0"
    return f"{mantissa}E{int(exponent)}" if exponent else mantissa


@dataclass(frozen=True)
class Language:
    """How a language writes things; texts with places in braces are filled by `str.format`.

    Attributes:
        name: in messages.
        operators: of arithmetic, comparisons and conditions.
        divide: whole number over whole number, both not negative.
        calls: function -> text with a place for each argument.
        assign, give, ignore: statements: target and value, result and function, a call whose value is not used.
        condition, otherwise, end: lines of a condition.
        loop, end_loop: lines of a loop over whole numbers.
        field: member of a structure.
        nan: not a number, of a prefix.
        signs: of `not` and minus.
        strict: whole numbers, conditions and floats do not mix, and there are no pointers: a part of an array is the
            number of its first entry in MEMORY, and names carry their kind, as D is d.
    """

    name: str
    operators: Operators
    divide: str
    calls: dict[str, str]
    assign: str
    give: str
    ignore: str
    condition: str
    otherwise: str
    end: str
    loop: str
    end_loop: str
    field: str
    nan: str
    signs: tuple[str, str]
    strict: bool


C = Language(
    name="C",
    operators={**_SHARED, ast.Eq: "==", ast.NotEq: "!=", ast.Mod: "%", ast.And: "&&", ast.Or: "||"},
    divide="({} / {})",
    calls={
        "chosen": "(({0}) ? ({1}) : ({2}))",
        "bounded": "fmin(fmax({0}, {1}), {2})",
        "smaller": "fmin({0}, {1})",
        "larger": "fmax({0}, {1})",
        "known": "(isnan({0}) ? ({1}) : ({0}))",
        "whole": "floor({0})",
        "abs": "fabs({0})",
        "math.sqrt": "sqrt({0})",
        "int": "((long)({0}))",
    },
    assign="{} = {};",
    give="return {0};",
    ignore="{};",
    condition="if ({}) {{",
    otherwise="}} else {{",
    end="}",
    loop="for ({0} = {1}; {0} < {2}; {0}++) {{",
    end_loop="}",
    field="{}->{}",
    nan="NAN",
    signs=("!", "-"),
    strict=False,
)

STRUCTURED_TEXT = Language(
    name="structured text",
    operators={**_SHARED, ast.Eq: "=", ast.NotEq: "<>", ast.Mod: "MOD", ast.And: "AND", ast.Or: "OR"},
    divide="DIV({}, {})",
    calls={
        "chosen": "SEL({0}, {2}, {1})",
        "bounded": "MIN(MAX({0}, {1}), {2})",
        "smaller": "MIN({0}, {1})",
        "larger": "MAX({0}, {1})",
        "known": "SEL(({0} = {0}), {1}, {0})",
        "whole": "{prefix}whole({0})",
        "abs": "ABS({0})",
        "math.sqrt": "SQRT({0})",
        "int": "LREAL_TO_DINT({0})",  # rounds, and is only used on whole numbers
    },
    assign="{} := {};",
    give="{1} := {0};",
    ignore="ignored := {};",
    condition="IF {} THEN",
    otherwise="ELSE",
    end="END_IF;",
    loop="FOR {0} := {1} TO ({2} - 1) DO",
    end_loop="END_FOR;",
    field="{}.{}",
    nan="{}nan()",
    signs=("NOT ", "-"),
    strict=True,
)
