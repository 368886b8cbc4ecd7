"""The EMPS axis fitted by simulation of its training record, beside inverse dynamics and published numbers.

    python studies/emps.py [--friction bristle|smooth]

Free runs from the first sample: the command alone moves the model. The first 20 samples of each record are left
out, as the benchmark asks. Friction is symmetric first and then separate for each direction of motion.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.core.readers import read_recording
from optid.core.recording import Recording
from optid.core.simulation import simulate
from optid.estimation.multiple_shooting import FitOptions, fit
from optid.estimation.result import Fit, Score
from optid.rigs.rigfile import Rig, read_rig
from studies.emps_inverse_dynamics import PUBLISHED, PUBLISHED_SEPARATE, RECORDINGS, inverse_dynamics, read

Array = NDArray[np.float64]
RIG = Path(__file__).parents[1] / "data" / "emps.toml"
FIT_PUBLISHED = 96.33  # %, grey-box refit on the training record, symmetric friction
SKIP = 20  # samples
# Size of the errors: a free run is off by what the plant leaves out, not by the encoder's micrometres. Weighted by
# the latter, jumps at the nodes would be cheaper than errors even at the least process noise.
MISFIT = "3 mm"
NAMES = {
    "M": "mass",
    "Fv": "viscous_friction",
    "Fc": "coulomb_friction",
    "offset": "force_offset",
    "Fv+": "viscous_friction",
    "Fc+": "coulomb_friction",
    "Fv-": "viscous_friction_negative",
    "Fc-": "coulomb_friction_negative",
}
SEPARATE_START = 'viscous_friction_negative = "150 N s/m"\ncoulomb_friction_negative = "30 N"\n'
SEPARATE_FREE = (
    'viscous_friction_negative = { bounds = ["0 N s/m", "1000 N s/m"] }\n'
    'coulomb_friction_negative = { bounds = ["0 N", "100 N"] }\n'
)


@dataclass(frozen=True, eq=False)
class Outcome:
    """A fit, and how well free runs follow the position of the training and the test record."""

    fit: Fit
    train: Score
    test: Score


def rig(friction: str, direction: str, folder: Path) -> Rig:
    """The rig of data/emps.toml with these options; separate friction takes the place of the free offset."""
    text = RIG.read_text()
    if direction == "separate":
        text = text.replace('force_offset = { bounds = ["-50 N", "50 N"] }\n', SEPARATE_FREE)
        text = text.replace("\n[fit]", SEPARATE_START + "\n[fit]")
    text = text.replace('"qm", unit = "m"', f'"qm", unit = "m", sd = "{MISFIT}"')
    options = f'\n[options]\nfriction = "{friction}"\ndirection = "{direction}"\n'
    path = folder / f"emps_{friction}_{direction}.toml"
    path.write_text(text + options)
    return read_rig(path)


def run(friction: str, direction: str, starts: int = 1) -> Outcome:
    """Fit the training record as simulation error and score free runs on both records."""
    with tempfile.TemporaryDirectory() as folder:
        model = rig(friction, direction, Path(folder))
    train, test = (recording(model, name) for name in ("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"))
    found = fit(model, [train], FitOptions(process_noise=0.0, starts=starts))
    return Outcome(found, score(model, found, train, found.states[0]), score(model, found, test))


def recording(model: Rig, name: str) -> Recording:
    """A record of the benchmark from its 21st sample on."""
    whole = read_recording(RECORDINGS / name, model)
    return whole.slice(float(whole.time[SKIP]) - 0.5 * whole.interval)


def score(model: Rig, found: Fit, record: Recording, start: Array | None = None) -> Score:
    """Free run of a whole record, from the measured position at rest unless the start is known."""
    if start is None:
        start = np.zeros(len(model.model.states))
        start[0] = float(np.mean(record["position"].values[:5]))
    dt = np.full(len(record), record.interval)
    p = model.model.vector(found.values)
    y = simulate(model.model, p, start, dt, record["command"].values[:, None]).outputs[0, :, 0]
    return Score.of(record["position"].values, y, "m")


def main(arguments: list[str]) -> int:
    """Print both fits; 1 if the recording is absent."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--friction", choices=("bristle", "smooth"), default="bristle")
    options = parser.parse_args(arguments)
    if not (RECORDINGS / "DATA_EMPS.mat").is_file():
        print(f"skipped: no recordings in {RECORDINGS}; fetch the EMPS benchmark (data/README.md)")
        return 1
    t, q, u = read(RECORDINGS / "DATA_EMPS.mat")
    for direction, published in (("symmetric", PUBLISHED), ("separate", PUBLISHED_SEPARATE)):
        found = run(options.friction, direction)
        inverse = inverse_dynamics(t, q, u, separate=direction == "separate").table["value"]
        values = found.fit.values
        print(
            f"{direction} friction, {options.friction}: {found.fit.outcome.name.lower()} in {found.fit.seconds:.1f} s"
        )
        print(f"{'':8}{'simulation':>12}{'inverse dyn.':>14}{'published':>12}")
        for short, value in published.items():
            print(f"{short:8}{values[NAMES[short]]:12.4f}{inverse[short]:14.4f}{value:12.4f}")
        for name in {e.name for e in found.fit.parameters} - set(NAMES.values()):
            print(f"{name} {values[name]:.3g}")
        for record, one in (("training", found.train), ("test", found.test)):
            print(f"free run, {record} record: fit {one.fit_percent:.2f} %, RMSE {1e3 * one.rmse:.3f} mm")
        if direction == "symmetric":
            print(f"published grey-box refit, training record: {FIT_PUBLISHED} %")
        print()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
