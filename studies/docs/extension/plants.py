"""The built-in plants: their options, inputs, outputs, sites and parameters, read off the model."""

from __future__ import annotations

import inspect
from pathlib import Path

from optid.core.model import Model
from optid.core.parameter import Parameter
from optid.core.quantity import quantity, unit_name
from optid.core.sheet import build
from optid.effects.library import admitted
from optid.rigs import BUILT_IN, find_plant

HEAD = """# Built-in plants

The plants that a rig file may name as `model`. Options go into `[options]`, parameters into `[parameters]` and
`[fit]`, inputs and outputs are the roles of `[channels]`. A parameter with a default may be left out.
"""


def pages() -> dict[str, str]:
    """File name -> text."""
    return {"index.md": "\n".join([HEAD, *map(_plant, BUILT_IN)])}


def _plant(name: str) -> str:
    function = find_plant(name, Path())
    model = build(function)
    effects = ", ".join(f"`{effect.name}`" for effect in admitted(model))
    return "\n".join(
        (
            f"## {name}\n",
            f"{(inspect.getdoc(function) or '').splitlines()[0]} (`{function.__module__.replace('.', '/')}.py`)\n",
            f"Inputs: {_ports(model.recorded)}. Outputs: {_ports(model.outputs)}.\n",
            f"Sites: {', '.join(_sites(model))}.\n",
            _options(function),
            "| parameter | unit | is | default | source |\n|---|---|---|---|---|",
            *map(_row, _required_first(model)),
            f"\nEffects that it admits: {effects}.\n",
        )
    )


def _sites(model: Model) -> list[str]:
    """Every site with the unit of its signal."""
    each = zip(model.sites, model.site_units, strict=True)
    return [f"`{site}` ({unit_name(unit)})" if unit_name(unit) else f"`{site}`" for site, unit in each]


def _options(function: object) -> str:
    options = [p for p in inspect.signature(function).parameters.values() if p.kind is p.KEYWORD_ONLY]  # type: ignore[arg-type]
    if not options:
        return "No options.\n"
    rows = "".join(f"| `{p.name}` | `{p.annotation}` | `{p.default!r}` |\n" for p in options)
    about = (inspect.getdoc(function) or "").partition("Args:")[2]
    listed = "\n".join(line.strip() for line in about.splitlines())
    return f"| option | values | default |\n|---|---|---|\n{rows}\n```text\n{listed.strip()}\n```\n"


def _required_first(model: Model) -> list[Parameter]:
    return sorted(model.parameters, key=lambda q: q.default is not None)


def _ports(ports: object) -> str:
    return ", ".join(f"`{port.role}` ({port.unit})" for port in ports)  # type: ignore[attr-defined]


def _row(q: Parameter) -> str:
    default = "required" if q.default is None else quantity(q.default, q.unit)
    return f"| `{q.name}` | {q.unit.replace('**', '^')} | {q.about} | {default} | {q.source} |"
