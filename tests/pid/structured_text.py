"""A small interpreter of IEC 61131-3 structured text: types, functions and one function block, numbers of 64 bits.

It knows nothing of optid; what it reads it tokenises and parses by the standard's grammar, so that an export it
accepts is structured text, and what the export computes is what a controller would compute.
"""

import math
import re
from types import SimpleNamespace

TOKEN = re.compile(
    r"\(\*.*?\*\)|[A-Za-z_]\w*|\d+\.\d+(?:E[-+]?\d+)?|\d+|:=|<>|<=|>=|[-+*/()<>=;:.,]|\s+", re.DOTALL
)
BUILT_IN = {
    "SEL": lambda g, a, b: b if g else a,
    "MIN": min,
    "MAX": max,
    "ABS": abs,
    "LREAL_TRUNC_LINT": math.trunc,
    "LINT_TO_LREAL": float,
}
LEVELS = (("OR",), ("AND",), ("=", "<>"), ("<", ">", "<=", ">="), ("+", "-"), ("*", "/"))


class Text:
    """Tokens with a place in them."""

    def __init__(self, source):
        self.tokens, at = [], 0
        while at < len(source):
            found = TOKEN.match(source, at)
            assert found, f"not structured text: {source[at : at + 30]!r}"
            at = found.end()
            if found.group().strip() and not found.group().startswith("(*"):
                self.tokens.append(found.group())
        self.at = 0

    def peek(self):
        return self.tokens[self.at] if self.at < len(self.tokens) else None

    def take(self, *expected):
        token = self.peek()
        assert not expected or token in expected, f"{token!r} where {expected} was expected"
        self.at += 1
        return token

    def expression(self, level=0):
        if level == len(LEVELS):
            return self.unary()
        left = self.expression(level + 1)
        while self.peek() in LEVELS[level]:
            left = ("binary", self.take(), left, self.expression(level + 1))
        return left

    def unary(self):
        if self.peek() in ("-", "NOT"):
            return ("unary", self.take(), self.unary())
        if self.peek() == "(":
            self.take("(")
            inner = self.expression()
            self.take(")")
            return inner
        token = self.take()
        if token in ("TRUE", "FALSE"):
            return ("constant", token == "TRUE")
        if token[0].isdigit():
            return ("constant", float(token))
        if self.peek() == "(":
            self.take("(")
            arguments = [self.expression()]
            while self.peek() == ",":
                self.take(",")
                arguments.append(self.expression())
            self.take(")")
            return ("call", token, arguments)
        return self.place(token)

    def place(self, token):
        path = [token]
        while self.peek() == ".":
            self.take(".")
            path.append(self.take())
        return ("place", path)

    def statements(self, *ends):
        found = []
        while self.peek() not in ends:
            if self.peek() == "IF":
                self.take("IF")
                condition = self.expression()
                self.take("THEN")
                found.append(("if", condition, self.statements("END_IF")))
                self.take("END_IF")
            elif self.peek() == "RETURN":
                found.append((self.take(),))
            else:
                target = self.place(self.take())
                self.take(":=")
                found.append(("assign", target, self.expression()))
            self.take(";")
        return found

    def variables(self, *ends):
        """Name -> (type, start value or None)."""
        found = {}
        while self.peek() not in ends:
            name = self.take()
            assert name not in found, f"{name} is declared twice"
            self.take(":")
            kind, value = self.take(), None
            if self.peek() == ":=":
                self.take(":=")
                value = self.expression()
            self.take(";")
            found[name] = (kind, value)
        return found


class Program:
    """Types, functions and function blocks of a source."""

    def __init__(self, source):
        text = Text(source)
        self.types, self.functions, self.blocks = {}, {}, {}
        while text.peek() is not None:
            kind, name = text.take("TYPE", "FUNCTION", "FUNCTION_BLOCK"), text.take()
            if kind == "TYPE":
                text.take(":"), text.take("STRUCT")
                self.types[name] = text.variables("END_STRUCT")
                text.take("END_STRUCT"), text.take("END_TYPE")
                continue
            if kind == "FUNCTION":
                text.take(":"), text.take("LREAL")
            declared, inputs = {}, []
            while text.peek() in ("VAR", "VAR_INPUT", "VAR_OUTPUT"):
                group = text.take()
                new = text.variables("END_VAR")
                assert not declared.keys() & new.keys(), f"declared twice: {declared.keys() & new.keys()}"
                declared |= new
                inputs += list(new) if group == "VAR_INPUT" else []
                text.take("END_VAR")
            body = text.statements(f"END_{kind}")
            text.take(f"END_{kind}")
            (self.functions if kind == "FUNCTION" else self.blocks)[name] = (declared, inputs, body)

    def value_of(self, kind, start=None):
        if kind in self.types:
            return SimpleNamespace(
                **{name: self.value_of(*entry) for name, entry in self.types[kind].items()}
            )
        if start is not None:
            return self.evaluate(start, {})
        return {"LREAL": 0.0, "BOOL": False}[kind]

    def call(self, name, arguments):
        declared, inputs, body = self.functions[name]
        scope = {variable: self.value_of(*entry) for variable, entry in declared.items()} | {name: 0.0}
        scope.update(zip(inputs, arguments, strict=True))
        self.run(body, scope)
        return scope[name]

    def run(self, body, scope):
        """True if a RETURN was met."""
        for statement in body:
            if statement[0] == "RETURN":
                return True
            if statement[0] == "if":
                if self.evaluate(statement[1], scope) is True and self.run(statement[2], scope):
                    return True
                continue
            _, (_, path), value = statement
            result = self.evaluate(value, scope)
            if isinstance(result, SimpleNamespace):  # structures are copied
                result = SimpleNamespace(**vars(result))
            if len(path) == 1:
                assert path[0] in scope, f"{path[0]} is not declared"
                scope[path[0]] = result
            else:
                assert hasattr(scope[path[0]], path[1]), f"no member {path[1]}"
                setattr(scope[path[0]], path[1], result)
        return False

    def evaluate(self, node, scope):
        match node:
            case ("constant", value):
                return value
            case ("place", [name]):
                return scope[name]
            case ("place", [name, member]):
                return getattr(scope[name], member)
            case ("unary", "-", operand):
                return -self.evaluate(operand, scope)
            case ("unary", "NOT", operand):
                return not self.evaluate(operand, scope)
            case ("call", name, arguments):
                values = [self.evaluate(argument, scope) for argument in arguments]
                return BUILT_IN[name](*values) if name in BUILT_IN else self.call(name, values)
        _, sign, left, right = node
        a, b = self.evaluate(left, scope), self.evaluate(right, scope)
        return {
            "+": lambda: a + b,
            "-": lambda: a - b,
            "*": lambda: a * b,
            "/": lambda: a / b,
            "<": lambda: a < b,
            ">": lambda: a > b,
            "<=": lambda: a <= b,
            ">=": lambda: a >= b,
            "=": lambda: a == b,
            "<>": lambda: a != b,
            "AND": lambda: a and b,
            "OR": lambda: a or b,
        }[sign]()


class Instance:
    """A function block that remembers."""

    def __init__(self, program, name):
        self.program, (declared, self.inputs, self.body) = program, program.blocks[name]
        self.scope = {variable: program.value_of(*entry) for variable, entry in declared.items()}

    def __call__(self, **inputs):
        assert set(inputs) <= set(self.inputs)
        self.scope.update(inputs)
        self.program.run(self.body, self.scope)
        return self.scope["command"]
