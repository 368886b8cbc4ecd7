"""The files of a plan: the experiment as a recording of the rig, and plan.json."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from optid.effects.effect import Effect
from optid.experiments.design import Design, Separation
from optid.experiments.loop import Loop
from optid.experiments.separation import NEEDED
from optid.live.settings import wiring_of
from optid.rigs.channels import REFERENCE

SCHEMA = "optid.plan/1"


@dataclass(frozen=True, eq=False)
class Planned:
    """A design with its loop, and the seed of its random numbers."""

    loop: Loop
    design: Design
    seed: int

    @property
    def seconds(self) -> float:
        """Length of the experiment."""
        return len(self.design.run.command) * self.loop.settings.span

    @property
    def pieces(self) -> tuple[tuple[str, float, float], ...]:
        """Each piece's name, begin and end, s."""
        d = self.design
        return tuple(zip(d.names, d.starts, (*d.starts[1:], self.seconds), strict=True))


def table(planned: Planned) -> str:
    """The content of experiment.csv: time, command, outputs and reference as the rig file maps them."""
    loop, run = planned.loop, planned.design.run
    rig, wiring = loop.rig, wiring_of(loop.rig)
    roles = [port.role for port in rig.model.outputs]
    reference = rig.channels[REFERENCE]
    columns = {
        wiring.time.column or "time": loop.settings.span * np.arange(len(run.command)) / wiring.time.factor
    }
    columns[wiring.command.column] = np.array([wiring.put(u) for u in run.command])
    for role in loop.measured:
        channel = rig.channels[role]
        columns[channel.column] = (run.outputs[:, roles.index(role)] - channel.shift) / channel.factor
    columns[reference.column] = (run.reference - reference.shift) / reference.factor
    rows = [",".join(f"{value:.10g}" for value in row) for row in np.column_stack(list(columns.values()))]
    return "\n".join([",".join(_quoted(name) for name in columns), *rows, ""])


def document(planned: Planned) -> dict[str, Any]:
    """The content of plan.json."""
    loop, d = planned.loop, planned.design
    settings = loop.settings
    limits, wiring = settings.limits, wiring_of(loop.rig)
    return {
        "schema": SCHEMA,
        "rig": loop.rig.name,
        "seconds": planned.seconds,
        "rate": settings.rate,
        "seed": planned.seed,
        "gains": dict(vars(loop.gains)),
        "limits": {
            "command": [limits.low, limits.high],
            "command_rate": limits.rate,
            "command_unit": wiring.command.recorded_unit,
            "position": list(limits.stroke),
            "position_unit": "m",
        },
        "noise": {role: loop.rig.channels[role].sd for role in loop.measured},
        "rivals": [{"effect": effect.name, "smallest": _smallest(effect)} for effect in d.rivals],
        "needed_sd": NEEDED,
        "pairs": [_pair(row) for row in d.separations],
        "pieces": [{"name": name, "from": begin, "to": end} for name, begin, end in planned.pieces],
    }


def _smallest(effect: Effect) -> dict[str, Any]:
    """The smallest size worth a name."""
    units = {q.name: q.unit for q in effect.parameters}
    return {name: {"value": least, "unit": units[name]} for name, least in effect.strength.items()}


def _pair(row: Separation) -> dict[str, Any]:
    return {
        "there": row.there,
        "instead": row.instead,
        "sd": row.planned,
        "sd_plain_steps": row.plain,
        "seconds_needed": row.seconds if np.isfinite(row.seconds) else None,
    }


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"' if any(c in name for c in ',"\n') else name
