"""Write the recordings in data/ and what is true of them, from the independent rig.

    python studies/make_recording.py

The rig file data/bench.toml is written by hand: it states what a user would know, wrong on purpose.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # the studies are no package: find their neighbours from any folder

from studies.independent_rig import Rig, recording, simulate  # noqa: E402
from studies.references import mixed  # noqa: E402

BENCH = Rig(viscous=61.3, coulomb=71.4, discharge=0.733, residual_length=9.2e-3)
WORN = BENCH._replace(leak_a=2e-7, leak_laminar=1.0)  # the same rig with a scored rod seal: chamber A leaks
RUNS = {
    "bench.csv": (BENCH, 8.0),
    "bench_holdout.csv": (BENCH, 6.0),
    "worn.csv": (WORN, 8.0),
    "worn_holdout.csv": (WORN, 6.0),
}
SEED = 20210901


def main(folder: Path = ROOT / "data") -> None:
    """Write the files into `folder`."""
    for number, (name, (rig, seconds)) in enumerate(RUNS.items()):
        rng = np.random.default_rng([SEED, number])
        table = recording(simulate(rig, mixed(seconds, 1e-3, rng, 0.1), rng), rng)
        table[["t", "u", "x", "r"]].round({"t": 3, "u": 4, "x": 3, "r": 3}).to_csv(folder / name, index=False)
    truth = {
        "viscous_friction": {"value": BENCH.viscous, "unit": "N s/m"},
        "coulomb_friction": {"value": BENCH.coulomb, "unit": "N"},
        "discharge_coefficient": {"value": BENCH.discharge, "unit": "1"},
        "residual_length": {"value": BENCH.residual_length, "unit": "m"},
        "position_noise": {"value": 0.03e-3, "unit": "m"},
    }
    (folder / "bench_truth.json").write_text(json.dumps(truth, indent=1) + "\n")


if __name__ == "__main__":
    main()
