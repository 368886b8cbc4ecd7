"""The cascaded tanks benchmark: two tanks fitted as they are built in, then a plant with an overflow.

    python studies/cascaded_tanks.py

Fits the estimation record as simulation error (no process noise), then simulates the test record from the
same start levels, which the benchmark says both records share. Test errors stand beside published ones.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.core.readers import read_recording
from optid.core.recording import Recording, held
from optid.core.simulation import simulate
from optid.estimation.multiple_shooting import FitOptions, fit
from optid.estimation.result import Fit
from optid.rigs.rigfile import Rig, read_rig

ROOT = Path(__file__).parents[1]
RECORDING = ROOT.parent / "shared" / "recordings" / "cascaded_tanks" / "dataBenchmark.csv"
RIGS = {
    "two tanks, built in": ROOT / "data" / "cascaded_tanks.toml",
    "with overflow, the user's own": ROOT / "studies" / "overflow_tanks.toml",
}
# Test RMSE in V, simulated, as collected at the workshop on nonlinear system identification benchmarks.
PUBLISHED = {
    "best linear": 0.75,
    "Volterra": 0.54,
    "Gaussian process state space": 0.45,
    "polynomial state space": 0.34,
    "grey box with overflow": 0.18,
}
MISFIT = 0.3  # V
STARTS = 3


@dataclass(frozen=True, eq=False)
class Outcome:
    """A fit and its simulation errors, V."""

    fit: Fit
    train: float
    test: float


def run(path: Path, recording: Path = RECORDING) -> Outcome:
    """Fit a rig file's plant to the estimation record and simulate both records."""
    rig = read_rig(path)
    other = {"command": "uVal", "level": "yVal"}
    # A simulation is off by what the plant leaves out, far more than by the sensor's noise: weigh it so.
    maps = {role: replace(c, sd=MISFIT if role == "level" else None) for role, c in rig.channels.items()}
    rig = replace(rig, channels=maps)
    swapped = {role: replace(c, column=other.get(role, c.column)) for role, c in rig.channels.items()}
    train, test = read_recording(recording, rig), read_recording(recording, replace(rig, channels=swapped))
    found = fit(rig, [train], FitOptions(process_noise=0.0, starts=STARTS))
    return Outcome(found, error(rig, found, train), error(rig, found, test))


def error(rig: Rig, found: Fit, recording: Recording) -> float:
    """RMSE in V of the simulation from the fitted start levels."""
    p = rig.model.vector(found.values)
    inputs = held(recording["command"].values)[:, None]
    dt = np.full(len(recording), recording.interval)
    y = simulate(rig.model, p, found.states[0], dt, inputs).outputs[0, :, 0]
    return float(np.sqrt(np.nanmean((recording["level"].values - y) ** 2)))


def main() -> int:
    """Print both fits and the table; 1 if the recording is absent."""
    if not RECORDING.is_file():
        print(f"skipped: {RECORDING} is not there; fetch the cascaded tanks benchmark (data/README.md)")
        return 1
    rows = dict(PUBLISHED)
    for name, path in RIGS.items():
        found = run(path)
        print(f"{name}: {found.fit.outcome.name.lower()} in {found.fit.seconds:.1f} s")
        print(found.fit.frame().drop(columns="unit").to_string(float_format=lambda number: f"{number:.5g}"))
        print(f"RMSE: estimation record {found.train:.3f} V, test record {found.test:.3f} V\n")
        rows[f"optid, {name}"] = found.test
    print("test RMSE, simulated, V")
    for name, value in sorted(rows.items(), key=lambda row: -row[1]):
        print(f"  {name:<42}{value:6.3f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
