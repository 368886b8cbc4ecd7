"""Recording a case: three runs for fitting, one held out, and the rig file that a user would write."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from studies.independent_rig import Run, recording, simulate
from studies.independent_rig.rig import Array
from studies.trial.case import Case
from studies.trial.excitation import STYLES

TRAIN, HELD_OUT = ("steps", "multisine", "ramps"), "mixed"
SECONDS, DT, STEP = 8.0, 1e-3, 2e-5
USUAL, OFTEN = 0.11, 1.6  # m beyond which a reference goes far: stretched so much, and cut at its reach
# Share of samples with the command at its limit beyond which someone would turn the gains down.
TOO_HARD = 0.1
RIG = """name = "{name}"
model = "servo-pneumatic"

[parameters]
supply_pressure = "7 bar"
exhaust_pressure = "1 bar"
atmospheric_pressure = "1 bar"
supply_temperature = "293 K"
chamber_temperature = "293 K"
specific_heat_ratio = 1.4
gas_constant = "287 J/(kg K)"
port_width = "6.2 mm"
spool_travel = "4 mm"
bore_diameter = "42 mm"
rod_diameter = "16 mm"
stroke = "260 mm"
payload_mass = "1.9 kg"
discharge_coefficient = 0.8
residual_length = "12 mm"
viscous_friction = "78 N s/m"
coulomb_friction = "83 N"

[fit]
discharge_coefficient = {{ bounds = [0.4, 1.0] }}
residual_length = {{ bounds = ["2 mm", "40 mm"] }}
viscous_friction = {{ bounds = ["0 N s/m", "400 N s/m"] }}
coulomb_friction = {{ bounds = ["0 N", "300 N"] }}

[channels]
time = {{ column = "t", unit = "s" }}
command = {{ column = "u", unit = "V", full_scale = "5 V" }}
position = {{ column = "x", unit = "mm" }}
reference = {{ column = "r", unit = "mm" }}
"""
PRESSURES = """pressure_a = { column = "pa", unit = "bar" }
pressure_b = { column = "pb", unit = "bar" }
"""


@dataclass(frozen=True)
class Recorded:
    """A case with its recordings: true signals and tables, by recording."""

    case: Case
    runs: dict[str, Run]
    tables: dict[str, pd.DataFrame]


def record(case: Case, seconds: float = SECONDS) -> Recorded:
    """Run the rig along its four references; a loop that keeps hitting its limits is tuned down first."""
    for _ in range(6):
        runs, tables = {}, {}
        for number, name in enumerate((*TRAIN, HELD_OUT)):
            rng = np.random.default_rng([case.seed, number])
            reference = wanted(name, case, seconds, rng)
            sensors = case.recorded_with
            run = simulate(case.rig, reference, rng, controller=case.controller, sensors=sensors, step=STEP)
            runs[name], tables[name] = run, recording(run, rng, sensors)
        if max(np.mean(np.abs(run.command) >= case.controller.limit) for run in runs.values()) <= TOO_HARD:
            break
        c = case.controller
        case = replace(case, controller=replace(c, kp=0.6 * c.kp, ki=0.4 * c.ki, kd=0.6 * c.kd))
    return Recorded(case, runs, tables)


def wanted(name: str, case: Case, seconds: float, rng: np.random.Generator) -> Array:
    """The reference of a recording; one that goes far stays long at both ends of its reach."""
    path = STYLES[case.style][name](seconds, DT, rng, case.reach)
    return np.clip(OFTEN * path, -case.reach, case.reach) if case.reach > USUAL else path


def write(recorded: Recorded, folder: Path) -> None:
    """Write what a user would have: rig.toml and one CSV per recording."""
    folder.mkdir(parents=True, exist_ok=True)
    case = recorded.case
    text = RIG.format(name=case.name) + (PRESSURES if case.with_pressures else "")
    (folder / "rig.toml").write_text(text)
    columns = ["t", "u", "x", "r"] + (["pa", "pb"] if case.with_pressures else [])
    for name, table in recorded.tables.items():
        table[columns].to_csv(folder / f"{name}.csv", index=False)
