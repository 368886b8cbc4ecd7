"""An identifier or a model as IEC 61131-3 structured text, for a cyclic task of a controller."""

from __future__ import annotations

import re

from optid.armax import layout
from optid.armax.export_c import KERNELS
from optid.armax.identifier import Identifier
from optid.armax.model import Armax
from optid.core.languages import MEMORY, STRUCTURED_TEXT, literal
from optid.core.model import Array
from optid.core.translate import Translation, translated
from optid.errors import InputError

_TYPES = {"Array": "DINT", "int": "DINT", "float": "LREAL", "bool": "BOOL"}

_IDENTIFIER = """\
(* Recursive ARMAX identifier ({orders}), to be called every {sample_time} s by a cyclic task. Written by optid from
   the same functions that run in Python; arithmetic of IEEE 754, in which a missing value is NaN.

   y, u         output and inputs of this sample, in the units of the recording
   innovation   y minus its one-step prediction, NaN for a missing output
   theta        a_1.., b.., c_1.. in these units{constant_said} *)

FUNCTION {name}_nan : LREAL (* not a number *)
VAR
    zero : LREAL := 0.0;
END_VAR
    {name}_nan := zero / zero;
END_FUNCTION

{functions}
FUNCTION_BLOCK {name}
VAR_INPUT
    y : LREAL;
    u : ARRAY[0..{last_input}] OF LREAL;
END_VAR
VAR_OUTPUT
    innovation : LREAL;
    theta : ARRAY[0..{last_parameter}] OF LREAL;
END_VAR
VAR
    i : DINT;
    {memory_name} : ARRAY[0..{last}] OF LREAL := [
{memory}
    ];
    unscale : ARRAY[0..{last_parameter}] OF LREAL := [{unscale}];
END_VAR
    FOR i := 0 TO {last_input} DO
        {memory_name}[({now} + i)] := u[i];
    END_FOR;
{constant}    innovation := {name}_advance({memory_name}, 0, y);
    FOR i := 0 TO {last_parameter} DO
        theta[i] := {memory_name}[({theta} + i)] * unscale[i];
    END_FOR;
END_FUNCTION_BLOCK
"""

_MODEL = """\
(* ARMAX model, to be called every {sample_time} s by a cyclic task. Written by optid.
   {text}

   y, u         output and inputs of this sample; y is NaN where it is missing: the block then simulates
   prediction   of y from what was known a sample before
   innovation   y minus the prediction, 0 where y is missing *)

FUNCTION_BLOCK {name}
VAR_INPUT
    y : LREAL;
    u : ARRAY[0..{last_input}] OF LREAL;
END_VAR
VAR_OUTPUT
    prediction : LREAL;
    innovation : LREAL;
END_VAR
VAR
    i : DINT;
    k : DINT;
    now : LREAL;
    a : ARRAY[0..{na}] OF LREAL := [{a}];
    c : ARRAY[0..{nc}] OF LREAL := [{c}];
    b : ARRAY[0..{last_tap}] OF LREAL := [{b}]; (* {taps} for each input, by lag, from 0 on *)
    past_y : ARRAY[0..{na}] OF LREAL;
    past_e : ARRAY[0..{nc}] OF LREAL;
    past_u : ARRAY[0..{last_tap}] OF LREAL;
END_VAR
    prediction := {constant};
    FOR i := 0 TO {last_input} DO
        FOR k := {taps_back} TO 1 BY -1 DO
            past_u[((i * {taps}) + k)] := past_u[(((i * {taps}) + k) - 1)];
        END_FOR;
        past_u[(i * {taps})] := u[i];
        FOR k := 0 TO {taps_back} DO
            prediction := prediction + (b[((i * {taps}) + k)] * past_u[((i * {taps}) + k)]);
        END_FOR;
    END_FOR;
    FOR k := 1 TO {na} DO
        prediction := prediction - (a[k] * past_y[(k - 1)]);
    END_FOR;
    FOR k := 1 TO {nc} DO
        prediction := prediction + (c[k] * past_e[(k - 1)]);
    END_FOR;
    now := y;
    IF (now <> now) THEN
        now := prediction;
    END_IF;
    innovation := now - prediction;
    FOR k := {na} TO 1 BY -1 DO
        past_y[k] := past_y[(k - 1)];
    END_FOR;
    FOR k := {nc} TO 1 BY -1 DO
        past_e[k] := past_e[(k - 1)];
    END_FOR;
    past_y[0] := now;
    past_e[0] := innovation;
END_FUNCTION_BLOCK
"""


def identifier_block(identifier: Identifier, name: str = "optid", constant: bool = False) -> str:
    """Structured text of an identifier that continues from its present memory.

    Args:
        identifier: whose orders, settings and memory are written.
        name: of the function block, and prefix of its functions.
        constant: its last input is 1 at every sample and not an argument.
    """
    _check(name)
    state, orders = identifier.state, identifier.orders
    now = layout.HEADER + 3 * orders.inputs
    unscale = _unscaled(identifier)
    functions = translated(KERNELS, STRUCTURED_TEXT, f"{name}_", layout.shape(orders)._asdict())
    return _IDENTIFIER.format(
        name=name,
        orders=orders,
        sample_time=literal(identifier.sample_time),
        functions="\n".join(_function(one, state.size) for one in functions),
        last=state.size - 1,
        last_input=max(orders.inputs - constant - 1, 0),
        last_parameter=orders.parameters - 1,
        now=now,
        theta=layout.theta_at(orders),
        memory=_rows(state),
        memory_name=MEMORY,
        unscale=_numbers(unscale),
        constant=f"    {MEMORY}[{now + orders.inputs - 1}] := 1.0;\n" * constant,
        constant_said=", the last of b being the constant beside eq. 12" * constant,
    )


def model_block(model: Armax, name: str = "optid") -> str:
    """Structured text of a model: one-step prediction and simulation. A slope added to eq. 12 is left out.

    Args:
        model: whose coefficients are written.
        name: of the function block.
    """
    _check(name)
    rows = [[0.0] * nk + list(b) for b, nk in zip(model.b, model.nk, strict=True)] or [[0.0]]
    taps = max(len(row) for row in rows)
    b = [x for row in rows for x in row + [0.0] * (taps - len(row))]
    return _MODEL.format(
        name=name,
        text=str(model).replace("; ", "\n   "),
        sample_time=literal(model.sample_time),
        na=len(model.a) - 1,
        nc=len(model.c) - 1,
        taps=taps,
        taps_back=taps - 1,
        last_tap=len(b) - 1,
        last_input=max(len(model.b) - 1, 0),
        a=_numbers(model.a),
        c=_numbers(model.c),
        b=_numbers(b),
        constant=literal(model.constant),
    )


def _function(one: Translation, size: int) -> str:
    """A function that takes the whole memory in and out; arguments that it changes are copied first."""

    def said(name: str) -> str:
        return f"{'p' if one.types[name] == 'Array' else 'v'}_{name}"

    copied = [name for name in one.arguments if name in one.assigned]
    held = [name for name in one.types if name not in one.arguments or name in copied]
    comment = f" (* {one.about} *)" if one.about else ""
    return "\n".join(
        [
            f"FUNCTION {one.prefix}{one.name} : LREAL{comment}",
            "VAR_IN_OUT",
            f"    {MEMORY} : ARRAY[0..{size - 1}] OF LREAL;",
            "END_VAR",
            "VAR_INPUT",
            *(f"    {said(n)}{'_in' * (n in copied)} : {_TYPES[kind]};" for n, kind in one.arguments.items()),
            "END_VAR",
            "VAR",
            *(f"    {said(name)} : {_TYPES[one.types[name]]};" for name in held),
            "    ignored : LREAL;",
            "END_VAR",
            *(f"    {said(name)} := {said(name)}_in;" for name in copied),
            *one.lines,
            "END_FUNCTION",
            "",
        ]
    )


def _unscaled(identifier: Identifier) -> list[float]:
    """Factor on each parameter of the scaled signals."""
    state, orders = identifier.state, identifier.orders
    factors = [1.0] * orders.parameters
    for i, block in enumerate(orders.blocks()):
        for k in range(block.start, block.stop):
            factors[k] = float(state[layout.SCALE] * state[layout.table_at() + 3 * i + 2])
    return factors


def _check(name: str) -> None:
    if not re.fullmatch(r"[A-Za-z](_?[A-Za-z0-9])*", name):
        raise InputError(
            f'"{name}"',
            field="name",
            expected="a name in structured text: letters, digits, single underscores",
        )


def _numbers(values: object) -> str:
    return ", ".join(literal(float(value)) for value in values)  # type: ignore[attr-defined]


def _rows(values: Array) -> str:
    return ",\n".join(f"        {_numbers(values[i : i + 6])}" for i in range(0, values.size, 6))
