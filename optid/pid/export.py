"""A controller as a C header and as IEC 61131-3 structured text, translated from the law that runs in Python."""

from __future__ import annotations

import re
import textwrap

from optid.core.translate import STRUCTURED_TEXT, C, Translation, literal
from optid.errors import InputError
from optid.pid import pid_step
from optid.pid.controller import Controller

_FUNCTIONS = {"law": pid_step.law, "start": pid_step.start, "change": pid_step.change}
_SETTINGS = (
    "kp",
    "ki",
    "kd",
    "derivative_filter",
    "setpoint_weight",
    "derivative_weight",
    "sample_time",
    "low",
    "high",
    "max_move",
    "deadband_low",
    "deadband_high",
    "onset",
    "resolution",
    "per_step",
    "clamping",
    "tracking",
    "acceleration",
    "friction",
    "per_speed",
    "notch_b0",
    "notch_b1",
    "notch_b2",
    "notch_a1",
    "notch_a2",
)
_MEMORY = (
    "integral",
    "slope",
    "last_command",
    "last_setpoint",
    "last_measured",
    "speed",
    "notch_1",
    "notch_2",
)

_HEADER = """\
/* Discrete PID controller, to be called every {sample_time} s. Written by optid from the law that runs in Python;
 * compile with -ffp-contract=off for equal bits. Command and measurement in the units of the tuning.
 *
 *     {name}_memory m;
 *     {name}_settings s = {name}_tuned;
 *     {name}_start(&s, &m, setpoint, measured, standing_command);          bumpless: once, before the first sample
 *     each sample:   command = {name}_law(&s, &m, setpoint, measured);     NAN marks a missing value
 *     other gains:   {name}_settings other = s; other.kp = ...; {name}_change(&s, &m, &other); s = other;
 */
#ifndef {NAME}_H
#define {NAME}_H

#include <math.h>

typedef struct {{
{settings}
}} {name}_settings;

typedef struct {{
{memory}
}} {name}_memory;

static const {name}_settings {name}_tuned = {{
{values}
}};

/* One sample: the command. */
static inline double {name}_law(const {name}_settings *s, {name}_memory *m, double setpoint, double measured)
{{
{law}
}}

/* Bumpless start: the memory from which the standing command goes on. */
static inline void {name}_start(
    const {name}_settings *s, {name}_memory *m, double setpoint, double measured, double standing)
{{
{start}
}}

/* Bumpless change of settings. */
static inline void {name}_change(const {name}_settings *s, {name}_memory *m, const {name}_settings *wanted)
{{
{change}
}}

#endif
"""

_BLOCK = """\
(* Discrete PID controller, to be called every {sample_time} s by a cyclic task. Written by optid from the law that
   runs in Python. Command and measurement in the units of the tuning.

   enable    FALSE: nothing is computed, and the command follows standing, so that the loop starts without a bump
   standing  the command that stands while the loop is open
   wanted    settings; copy s, change what shall change, and set apply for one call: the change is bumpless *)

TYPE {name}_settings : STRUCT
{settings}
END_STRUCT END_TYPE

TYPE {name}_memory : STRUCT
{memory}
END_STRUCT END_TYPE

FUNCTION {name}_whole : LREAL (* the largest whole number not above value *)
VAR_INPUT
    value : LREAL;
END_VAR
VAR
    cut : LREAL;
END_VAR
    cut := value;
    IF (ABS(value) < 4.5E15) THEN
        cut := LINT_TO_LREAL(LREAL_TRUNC_LINT(value));
    END_IF;
    {name}_whole := SEL((cut > value), cut, (cut - 1.0));
END_FUNCTION

FUNCTION_BLOCK {name}
VAR_INPUT
    enable : BOOL;
    apply : BOOL;
    setpoint : LREAL;
    measured : LREAL;
    standing : LREAL;
    wanted : {name}_settings;
END_VAR
VAR_OUTPUT
    command : LREAL;
END_VAR
VAR
    s : {name}_settings;
    m : {name}_memory;
    running : BOOL;
{locals}
END_VAR
    IF (NOT enable) THEN
        running := FALSE;
        command := standing;
        RETURN;
    END_IF;
    IF (NOT running) THEN
{start}
        running := TRUE;
    END_IF;
    IF apply THEN
{change}
        s := wanted;
    END_IF;
{law}
END_FUNCTION_BLOCK
"""


def c_header(controller: Controller, name: str = "optid_pid") -> str:
    """A C header that needs only <math.h> and allocates nothing.

    Args:
        controller: whose gains and settings are written.
        name: prefix of all names.

    Raises:
        InputError: `name` is not a name in C.
    """
    _check(name)
    bodies = {key: _with_locals(key, name) for key in _FUNCTIONS}
    return _HEADER.format(
        name=name,
        NAME=name.upper(),
        sample_time=literal(controller.settings.sample_time),
        settings="\n".join(f"    double {field};" for field in _SETTINGS),
        memory="\n".join(f"    double {field};" for field in _MEMORY),
        values="\n".join(f"    .{field} = {literal(v)}," for field, v in _values(controller)),
        **bodies,
    )


def structured_text(controller: Controller, name: str = "optid_pid") -> str:
    """A function block of IEC 61131-3 structured text (third edition), with the types it needs.

    Args:
        controller: whose gains and settings are written.
        name: of the block, and prefix of its types.

    Raises:
        InputError: `name` is not a valid name.
    """
    _check(name)
    bodies = {
        key: Translation(function, STRUCTURED_TEXT, f"{name}_", structures=True)
        for key, function in _FUNCTIONS.items()
    }
    taken = dict.fromkeys(local for body in bodies.values() for local in _locals(body) if local != "command")
    indent = "        "
    return _BLOCK.format(
        name=name,
        sample_time=literal(controller.settings.sample_time),
        settings="\n".join(f"    {field} : LREAL := {literal(v)};" for field, v in _values(controller)),
        memory="\n".join(f"    {field} : LREAL;" for field in _MEMORY),
        locals="\n".join(f"    {local} : LREAL;" for local in taken),
        law="\n".join(bodies["law"].lines[:-1]),  # the last one gives back what is the block's output
        start="\n".join(indent + line.strip() for line in bodies["start"].lines),
        change="\n".join(indent + line.strip() for line in bodies["change"].lines),
    )


def _with_locals(key: str, name: str) -> str:
    body = Translation(_FUNCTIONS[key], C, f"{name}_", structures=True)
    declared = textwrap.fill(
        f"double {', '.join(_locals(body))};", 110, initial_indent="    ", subsequent_indent="        "
    )
    return "\n".join(line for line in (declared, *body.lines) if line)


def _locals(body: Translation) -> list[str]:
    return [name for name in body.types if name not in body.arguments]


def _values(controller: Controller) -> list[tuple[str, float]]:
    return list(zip(_SETTINGS, controller.vector.tolist(), strict=True))


def _check(name: str) -> None:
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        raise InputError(f'"{name}"', field="name", expected="small letters, digits, underscores")
