"""Eqs. 1 to 11 as printed, put to the diagnosis: does it find the force that the print's eq. 11 leaves out?

    python studies/print_diagnosed.py [--out DIR] [--time-limit S] [--seconds S]

The rig is studies/independent_rig with the numbers of Table 1, which knows the ambient pressure on the rod's area:
A_rod P_atm = 20.1 N. The rig file states the print's equations (`[options] rod_force = false, reversed_flow = false`)
with the friction and the discharge coefficient to be fitted. Position and both pressures are recorded. Printed: the
verdict, and whether the finding at the force's site holds 20.1 N in its interval.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from studies.independent_rig import Rig, recording, simulate
from studies.references import mixed

PRINT = """\
name = "the print"
model = "servo-pneumatic"

[options]
rod_force = false
reversed_flow = false

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
residual_length = "10 mm"
payload_mass = "1.9 kg"
discharge_coefficient = 0.8
viscous_friction = "78 N s/m"
coulomb_friction = "83 N"

[fit]
discharge_coefficient = { bounds = [0.4, 1.0] }
viscous_friction = { bounds = ["0 N s/m", "400 N s/m"] }
coulomb_friction = { bounds = ["0 N", "300 N"] }

[channels]
time = { column = "t", unit = "s" }
command = { column = "u", unit = "V", full_scale = "5 V" }
position = { column = "x", unit = "mm" }
pressure_a = { column = "pa", unit = "bar" }
pressure_b = { column = "pb", unit = "bar" }
"""
SEED = 20210901


def missing_force(rig: Rig) -> float:
    """N: the ambient pressure on the rod's area, by hand pi/4 (16 mm)^2 1 bar = 20.106 N."""
    return math.pi / 4 * rig.rod**2 * rig.atmospheric_pressure


def write_inputs(folder: Path, seconds: float) -> None:
    """The print's rig file, and a training and a held-out recording of the rig."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "print.toml").write_text(PRINT, encoding="utf-8")
    rig = Rig()
    for number, name in enumerate(("train.csv", "holdout.csv")):
        rng = np.random.default_rng([SEED, number])
        table = recording(simulate(rig, mixed(seconds, 1e-3, rng, 0.1), rng), rng)
        table.to_csv(folder / name, index=False)


def judge(document: dict[str, object], force: float) -> str:
    """What the diagnosis says of the missing force, in a sentence."""
    findings = document["findings"]
    assert isinstance(findings, list)
    for finding in findings:
        for name, estimate in finding["parameters"].items():
            if finding["site"] == "force" and estimate["unit"] == "N" and estimate["ci95"]:
                low, high = sorted(abs(end) for end in estimate["ci95"] if end is not None)
                held = "holds" if low <= force <= high else "does not hold"
                return (
                    f"{finding['effect']} at {finding['site']} (eq. {finding['equation']}): {name} = "
                    f"{estimate['value']:.4g} N, 95 % interval {low:.4g} to {high:.4g} N, which {held} {force:.4g} N"
                )
    return f"no finding is a force; the missing {force:.4g} N were not named"


def main() -> None:
    """Record, diagnose, judge."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/print"))
    parser.add_argument("--time-limit", type=float, default=600.0)
    parser.add_argument("--seconds", type=float, default=6.0)
    arguments = parser.parse_args()
    write_inputs(arguments.out, arguments.seconds)
    places = [str(arguments.out / name) for name in ("print.toml", "train.csv", "holdout.csv", "diagnosis")]
    call = ["diagnose", *places[:2], "--holdout", places[2], "--out", places[3]]
    subprocess.run(
        [sys.executable, "-m", "optid.cli", *call, "--time-limit", f"{arguments.time_limit:g}"], check=True
    )
    document = json.loads((arguments.out / "diagnosis" / "diagnosis.json").read_text(encoding="utf-8"))
    print(f"verdict: {document['verdict']}")
    print(judge(document, missing_force(Rig())))


if __name__ == "__main__":
    main()
