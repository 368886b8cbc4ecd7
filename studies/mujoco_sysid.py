"""optid beside MuJoCo's own system identification on the independent rotary rig: same recordings, errors and times.

    pip install "mujoco[sysid]"
    python studies/mujoco_sysid.py [--draws 3] [--seconds 4]

Each draw is an arm of other load and friction, simulated by `studies/independent_axes` (true stick, 20 us), in two
recordings of 1 kHz. Both fit inertia, payload, viscous and dry friction from the values in data/rotary_axis.toml.
MuJoCo steps once in each sample, as its examples do, and ten times.
Times are of the second of two runs, so that nothing is compiled in them: by the clock, and summed over the cores.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.core.readers import read_recording
from optid.core.recording import Recording
from optid.estimation.multiple_shooting import fit
from optid.rigs.rigfile import Rig, read_rig
from studies.independent_axes import Rotary, simulate
from studies.independent_axes.loop import axis_of, table
from studies.peers import fit_mujoco
from studies.references import REFERENCES

RIG = Path(__file__).parents[1] / "data" / "rotary_axis.toml"
OWN = {
    "load_inertia": "inertia",
    "payload_mass": "mass",
    "viscous_friction": "viscous",
    "coulomb_friction": "coulomb",
}
FINE = 10  # steps in a sample, where the implicit step's own damping is small
SPREAD = 0.3  # of the truth about the rig file's values


def drawn(rng: np.random.Generator) -> Rotary:
    """An arm whose load and friction differ from the rig file's by up to SPREAD."""
    usual = Rotary()
    return usual._replace(
        **{own: getattr(usual, own) * (1 + rng.uniform(-SPREAD, SPREAD)) for own in OWN.values()}
    )


def recorded(arm: Rotary, seconds: float, rng: np.random.Generator, rig: Rig) -> list[Recording]:
    """Two recordings of it, read back as a user's files are."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        for name in ("first", "second"):
            wanted = REFERENCES["mixed"](seconds, 1e-3, rng, 0.1) * axis_of(arm).reach / 0.1
            path = Path(folder, f"{name}.csv")
            table(simulate(arm, wanted, rng), arm).to_csv(path, index=False)
            found.append(read_recording(path, rig))
    return found


def by_optid(rig: Rig, recordings: list[Recording]) -> dict[str, tuple[float, float]]:
    """Values and half-widths of 95 % intervals, SI."""
    found = {one.name: one for one in fit(rig, recordings).parameters}
    return {name: (found[name].value, (found[name].high - found[name].low) / 2) for name in OWN}


def by_mujoco(rig: Rig, recordings: list[Recording], steps: int = 1) -> dict[str, tuple[float, float]]:
    """The same."""
    records = [
        fit_mujoco.Record(one.time, one.channels["command"].values, one.channels["position"].values)
        for one in recordings
    ]
    bounds = {freed.name: (freed.low, freed.high) for freed in rig.freed}
    found = fit_mujoco.fit(rig.parameters, bounds, records, steps)
    return {name: (found.values[name], found.half_widths[name]) for name in OWN}


def timed(work: Callable[[], Any]) -> tuple[tuple[float, float], Any]:
    """Seconds by the clock and of all cores of the second of two runs, and its result."""
    work()
    began, spent = time.perf_counter(), time.process_time()
    found = work()
    return (time.perf_counter() - began, time.process_time() - spent), found


def line(
    name: str, seconds: tuple[float, float], found: Mapping[str, tuple[float, float]], arm: Rotary
) -> str:
    """Seconds, and for each parameter its error in percent with a mark where its interval misses the truth."""
    shown = []
    for parameter, own in OWN.items():
        value, half = found[parameter]
        true = getattr(arm, own)
        outside = "!" if abs(value - true) > half else " "
        shown.append(f"{100 * (value / true - 1):16.2f}{outside}")
    return f"{name:16}{seconds[0]:8.2f}{seconds[1]:10.2f}{''.join(shown)}"


def main() -> int:
    """Print the table."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--draws", type=int, default=3)
    options.add_argument("--seconds", type=float, default=4.0)
    asked = options.parse_args()
    if not fit_mujoco.available():
        print('skipped: MuJoCo\'s identification is not installed: pip install "mujoco[sysid]"')
        return 1
    rig, rng = read_rig(RIG), np.random.default_rng(57)
    print(f"{'':16}{'seconds':>8}{'of cores':>10}" + "".join(f"{name:>17}" for name in OWN))
    print("error in percent; ! where the 95 % interval misses the truth")
    for _ in range(asked.draws):
        arm = drawn(rng)
        recordings = recorded(arm, asked.seconds, rng, rig)
        for name, work in (
            ("optid", by_optid),
            ("MuJoCo, 1 ms", by_mujoco),
            ("MuJoCo, 0.1 ms", partial(by_mujoco, steps=FINE)),
        ):
            seconds, found = timed(partial(work, rig, recordings))
            print(line(name, seconds, found, arm), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
