"""What each smoothing setting costs: the bench's command simulated at its default and at a tenth of it.

    python studies/smoothing.py

Differences of free runs over the first 2 s of data/bench.csv, at a local error far below them. The position drifts
in a free run, so a difference counts all that gathered until then.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.core.readers import read_recording
from optid.core.sheet import build
from optid.core.simulation import simulate
from optid.rigs.rigfile import read_rig
from optid.rigs.servo_pneumatic import servo_pneumatic

DATA = Path(__file__).parents[1] / "data"
SECONDS = 2.0
# Friction law, setting, and the factor towards the limit it stands for.
SETTINGS = (
    ("bristle", "flow_width", 0.1),
    ("bristle", "bristle_lag", 0.1),
    ("bristle", "bristle_damping", 0.1),
    ("bristle", "presliding_length", 0.1),
    ("bristle", "length_floor", 0.1),
    ("bristle", "stop_stiffness", 10.0),
    ("bristle", "stop_damping", 0.1),
    ("smooth", "friction_width", 0.1),
    ("smooth", "flow_width", 0.1),
)


@dataclass(frozen=True)
class Cost:
    """Largest and root mean square difference of the position (m), and the largest of a pressure (Pa)."""

    friction: str
    setting: str
    default: float
    position: float
    position_rms: float
    pressure: float


def costs(seconds: float = SECONDS) -> list[Cost]:
    """One row for each setting that the plant has."""
    rig = read_rig(DATA / "bench.toml")
    recording = read_recording(DATA / "bench.csv", rig).slice(0.0, seconds)
    inputs, dt = recording["command"].values[:, None], np.full(len(recording), recording.interval)
    found = []
    for friction, setting, factor in SETTINGS:
        model = build(servo_pneumatic, friction=friction)
        if setting not in {q.name for q in model.parameters}:
            continue
        p = model.vector(rig.parameters)
        sharp = p.copy()
        sharp[model.index(setting)] *= factor
        start = np.array(model.start(p)[0]).ravel()
        start[0] = float(np.mean(recording["position"].values[:20]))
        a, b = (simulate(model, one, start, dt, inputs, tolerance=1e-7).outputs[0] for one in (p, sharp))
        x, pressure = np.abs(a[:, 0] - b[:, 0]), np.abs(a[:, 1:] - b[:, 1:])
        rms = float(np.sqrt(np.mean(x**2)))
        found.append(
            Cost(
                friction, setting, float(p[model.index(setting)]), float(x.max()), rms, float(pressure.max())
            )
        )
    return found


def main() -> int:
    """Print the table."""
    print(f"first {SECONDS:g} s of the bench's command; each setting against ten times sharper")
    print(f"{'friction':10}{'setting':20}{'default':>9}{'x max, um':>11}{'x rms, um':>11}{'P max, mbar':>13}")
    for c in costs():
        print(
            f"{c.friction:10}{c.setting:20}{c.default:9.2g}{1e6 * c.position:11.3f}{1e6 * c.position_rms:11.3f}"
            f"{1e-2 * c.pressure:13.4f}"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
