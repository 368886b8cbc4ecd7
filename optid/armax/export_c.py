"""An identifier or a model as one C header, without allocation, with <math.h> only."""

from __future__ import annotations

import re
from pathlib import Path

from optid.armax import delay_line, recursion, stability, ud_factor, update
from optid.armax.identifier import Identifier
from optid.armax.model import Armax
from optid.core.model import Array
from optid.core.translate import C, Translation, translated
from optid.errors import InputError

KERNELS = (
    ud_factor.inner,
    ud_factor.project,
    ud_factor.weigh,
    ud_factor.sweep,
    ud_factor.shift,
    ud_factor.enter,
    ud_factor.copy,
    ud_factor.move,
    stability.roots_inside,
    stability.stabilise,
    delay_line.filtered,
    delay_line.newest,
    update.trace_of,
    update.weight_of,
    update.forget_of,
    update.learn,
    recursion.regress,
    recursion.impute_inputs,
    recursion.remember,
    recursion.reset_after_gap,
    recursion.advance,
)

_TYPES = {"Array": "double *", "float": "double ", "int": "long "}

_IDENTIFIER = """\
/* Recursive ARMAX identifier ({orders}), sampled every {sample_time!r} s.
 * Written by optid from the same functions that run in Python; compile with -ffp-contract=off for equal bits.
 *
 *     double memory[{NAME}_SIZE];
 *     {name}_start(memory);
 *     each sample:  innovation = {name}_step(memory, y, u);     NAN marks a missing y or input
 *     parameters:   memory[{NAME}_THETA + i], of y/{NAME}_SCALE and u[i]/{name}_input_scale[i];
 *                   a_1.., b.., c_1.. in this order
 */
#ifndef {NAME}_H
#define {NAME}_H

#include <math.h>

#define {NAME}_SIZE {size}
#define {NAME}_PARAMETERS {parameters}
#define {NAME}_INPUTS {inputs}
#define {NAME}_THETA {theta}
#define {NAME}_SCALE {scale!r}

static const double {name}_input_scale[] = {{{input_scales}}};

static const double {name}_memory[{NAME}_SIZE] = {{
{memory}
}};

{functions}
/* The memory as it was when this header was written. */
static inline void {name}_start(double *memory)
{{
    for (long i = 0; i < {NAME}_SIZE; i++)
        memory[i] = {name}_memory[i];
}}

/* Learn from one sample; returns the innovation, NAN for a missing output. */
static inline double {name}_step(double *memory, double y, const double *u)
{{
    for (long i = 0; i < {NAME}_INPUTS; i++)
        memory[{now} + i] = u[i];
{constant}    return {name}_advance(memory, y);
}}

#endif
"""

_MODEL = """\
/* ARMAX model, sampled every {sample_time!r} s. Written by optid.
 * {text}
 *
 *     {name}_model m = {{0}};
 *     each sample:  innovation = {name}_follow(&m, y, u, &prediction);   with y = NAN it simulates
 *     k steps on:   {name}_ahead(&m, u_future, k, out);    u_future holds k rows of {NAME}_INPUTS
 */
#ifndef {NAME}_H
#define {NAME}_H

#include <math.h>

#define {NAME}_NA {na}
#define {NAME}_NC {nc}
#define {NAME}_INPUTS {inputs}
#define {NAME}_TAPS {taps}

static const double {name}_a[] = {{{a}}};
static const double {name}_c[] = {{{c}}};
static const double {name}_b[][{NAME}_TAPS] = {{{b}}}; /* by lag, from 0 on */

typedef struct {{ /* newest first */
    double y[{NAME}_NA + 1], e[{NAME}_NC + 1], u[{NAME}_INPUTS + 1][{NAME}_TAPS];
}} {name}_model;

/* Take one sample; returns y minus its one-step prediction, 0 where y is NAN and the prediction stands in. */
static inline double {name}_follow({name}_model *m, double y, const double *u, double *prediction)
{{
    double guess = {constant!r}, e = 0.0; /* the constant beside eq. 12 */
    long i, k;
    for (i = 0; i < {NAME}_INPUTS; i++) {{
        for (k = {NAME}_TAPS - 1; k > 0; k--)
            m->u[i][k] = m->u[i][k - 1];
        m->u[i][0] = u[i];
        for (k = 0; k < {NAME}_TAPS; k++)
            guess += {name}_b[i][k] * m->u[i][k];
    }}
    for (k = 0; k < {NAME}_NA; k++)
        guess -= {name}_a[k + 1] * m->y[k];
    for (k = 0; k < {NAME}_NC; k++)
        guess += {name}_c[k + 1] * m->e[k];
    if (isnan(y))
        y = guess;
    else
        e = y - guess;
    for (k = {NAME}_NA; k > 0; k--)
        m->y[k] = m->y[k - 1];
    for (k = {NAME}_NC; k > 0; k--)
        m->e[k] = m->e[k - 1];
    m->y[0] = y;
    m->e[0] = e;
    *prediction = guess;
    return e;
}}

/* The next outputs, future noise being zero. */
static inline void {name}_ahead(const {name}_model *m, const double *u, long steps, double *out)
{{
    {name}_model copy = *m;
    for (long s = 0; s < steps; s++)
        {name}_follow(&copy, NAN, u + s * {NAME}_INPUTS, out + s);
}}

#endif
"""


def identifier_header(identifier: Identifier, name: str = "optid", constant: bool = False) -> str:
    """C of an identifier that continues from its present memory.

    Args:
        identifier: whose orders, settings and memory are written.
        name: prefix of all names in C.
        constant: its last input is 1 at every sample and not an argument.
    """
    from optid.armax import layout

    _check(name)
    state, orders = identifier.state, identifier.orders
    scales = [1.0 / state[layout.table_at() + 3 * i + 2] for i in range(orders.inputs)]
    return _IDENTIFIER.format(
        name=name,
        NAME=name.upper(),
        orders=orders,
        sample_time=identifier.sample_time,
        size=state.size,
        parameters=orders.parameters,
        inputs=orders.inputs - constant,
        constant=f"    memory[{layout.HEADER + 4 * orders.inputs - 1}] = 1.0; /* the constant beside eq. 12 */\n"
        * constant,
        theta=layout.theta_at(orders),
        now=layout.HEADER + 3 * orders.inputs,
        scale=float(state[layout.SCALE]),
        input_scales=_numbers(scales or [1.0]),
        memory=_rows(state),
        functions="\n".join(
            _function(one) for one in translated(KERNELS, C, f"{name}_", layout.shape(orders)._asdict())
        ),
    )


def model_header(model: Armax, name: str = "optid") -> str:
    """C of a model: one-step and k-step prediction and simulation.

    Args:
        model: whose coefficients are written.
        name: prefix of all names in C.
    """
    _check(name)
    rows = [[0.0] * nk + list(b) for b, nk in zip(model.b, model.nk, strict=True)] or [[0.0]]
    taps = max(len(row) for row in rows)
    return _MODEL.format(
        name=name,
        NAME=name.upper(),
        text=str(model).replace("; ", "\n * "),
        sample_time=model.sample_time,
        constant=model.constant,
        na=len(model.a) - 1,
        nc=len(model.c) - 1,
        inputs=len(model.b),
        taps=taps,
        a=_numbers(model.a),
        c=_numbers(model.c),
        b=", ".join(f"{{{_numbers(row + [0.0] * (taps - len(row)))}}}" for row in rows),
    )


def _function(one: Translation) -> str:
    """A static function."""
    parameters = ", ".join(f"{_TYPES[kind]}{name}" for name, kind in one.arguments.items())
    comment = f"/* {one.about} */\n" if one.about else ""
    declared = [f"    {_TYPES[kind]}{name};" for name, kind in one.types.items() if name not in one.arguments]
    head = f"{comment}static inline double {one.prefix}{one.name}({parameters})\n{{"
    return "\n".join([head, *declared, *one.lines, "}", ""])


def write_header(path: Path, thing: Identifier | Armax, name: str = "optid") -> None:
    """Write the header of an identifier or a model to a file."""
    text = identifier_header(thing, name) if isinstance(thing, Identifier) else model_header(thing, name)
    path.write_text(text, encoding="utf-8")


def _check(name: str) -> None:
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise InputError(
            f'"{name}"', field="name", expected="a name in C: small letters, digits, underscores"
        )


def _numbers(values: object) -> str:
    return ", ".join(repr(float(value)) for value in values)  # type: ignore[attr-defined]


def _rows(values: Array) -> str:
    return "\n".join(f"    {_numbers(values[i : i + 6])}," for i in range(0, values.size, 6))
