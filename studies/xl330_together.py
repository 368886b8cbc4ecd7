"""Eight recordings of a Dynamixel XL330 with an arm, fitted one by one and all together, free runs side by side.

    python studies/xl330_together.py DIR [--limit 240]

The recordings are public (Rhoban/bam, logs of January 2026) and not included: an arm follows two sines, or is lifted
and dropped, at four gains of the firmware's loop. `xl330_plain.toml` has Coulomb and viscous friction and is fitted to
each recording by itself. `xl330.toml` adds friction that grows with what the teeth transmit, and Stribeck friction; it
is fitted to all with one set of parameters but payload and arm length: once as `[recordings]` states them for each,
once freed for each. Freed, they take up what the common laws miss, and say little of the arm: the winding's resistance
is then held, since a factor on all inertias, torques and 1/R moves nothing. Last it is fitted without the recordings at
one gain, which are held out. A fit is one of simulation errors (process noise 0), as free runs are what is compared.
What was fitted is kept in DIR, so a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.core.readers import read_recording
from optid.estimation.multiple_shooting import FitOptions, fit
from optid.estimation.prediction import predict
from optid.rigs.per_recording import for_recordings, told
from optid.rigs.rigfile import Freed, read_rig

HERE = Path(__file__).parent
RECORDINGS = HERE.parents[1] / "shared" / "recordings" / "xl330"
GAINS = (100, 200, 400, 800)
NAMES = tuple(f"{kind}_{gain}" for kind in ("sin_sin", "lift_and_drop") for gain in GAINS)
HELD_OUT = tuple(name for name in NAMES if name.endswith("_400"))
PLAIN, RICH = HERE / "xl330_plain.toml", HERE / "xl330.toml"
OWN = (
    Freed("payload_mass", 0.2, 1.0, per="recording"),  # kg
    Freed("arm_length", 0.05, 0.2, per="recording"),  # m
)


def fitted(
    rig_file: Path, names: Sequence[str], held: Sequence[str], limit: float, own: Sequence[Freed] = ()
) -> dict[str, Any]:
    """Outcome, parameters with intervals (SI), and the free runs' errors of each recording, rad."""
    plain = read_rig(rig_file)
    if own:
        common = (one for one in plain.freed if one.name != "resistance")
        plain = replace(plain, freed=(*common, *own))
    read = {name: read_recording(RECORDINGS / f"{name}.csv", plain) for name in (*names, *held)}
    rig = for_recordings(plain, [read[name] for name in names])
    train = [told(rig, read[name]) for name in names]
    found = fit(rig, train, FitOptions(process_noise=0.0, time_limit=limit))
    errors = {}
    for name, recording in read.items():
        shown = predict(rig, told(rig, recording), found.values, found.process_noise)
        errors[name] = shown.scores["free_run"]["position"].rmse
    return {
        "outcome": found.outcome.name,
        "seconds": found.seconds,
        "parameters": {one.name: [one.value, one.low, one.high] for one in found.parameters},
        "free_run": errors,
    }


def kept(folder: Path, key: str, *job: Any) -> dict[str, Any]:
    """What `fitted` gives, from DIR where it was done before."""
    path = folder / f"{key}.json"
    if not path.exists():
        path.write_text(json.dumps(fitted(*job), indent=1))
        print(f"{key}: {json.loads(path.read_text())['outcome']}", flush=True)
    found: dict[str, Any] = json.loads(path.read_text())
    return found


def show(alone: dict[str, Any], together: dict[str, Any], own: dict[str, Any], held: dict[str, Any]) -> None:
    """The free runs side by side, and the one set of parameters."""
    columns = {
        "one by one": [1e3 * alone[name]["free_run"][name] for name in NAMES],
        "together": [1e3 * together["free_run"][name] for name in NAMES],
        "own arm": [1e3 * own["free_run"][name] for name in NAMES],
    }
    print(f"\n{'free run, rms error, mrad':28}{''.join(f'{head:>12}' for head in columns)}{'held out':>12}")
    for name, row in zip(NAMES, zip(*columns.values(), strict=True), strict=True):
        out = f"{1e3 * held['free_run'][name]:12.1f}" if name in HELD_OUT else ""
        print(f"{name:28}{''.join(f'{one:12.1f}' for one in row)}{out}")
    print(f"{'all':28}{''.join(f'{np.sqrt(np.mean(np.square(one))):12.1f}' for one in columns.values())}")
    for head in ("together", "own arm"):
        worse = sum(all_ > one for all_, one in zip(columns[head], columns["one by one"], strict=True))
        print(f"worse {head} than one by one: {worse} of {len(NAMES)}")
    spent = sum(one["seconds"] for one in alone.values())
    print(f"seconds: {spent:.0f}, {together['seconds']:.0f}, {own['seconds']:.0f}")
    print("\none set of parameters, SI, with 95 % intervals; beside it the spread of those fitted one by one")
    for name, (value, low, high) in together["parameters"].items():
        own = [one["parameters"][name][0] for one in alone.values() if name in one["parameters"]]
        spread = f"   {min(own):.4g} to {max(own):.4g}" if own else ""
        print(f"  {name:42}{value:10.4g}  [{low:.4g}, {high:.4g}]{spread}")


def main() -> int:
    """Fit what is not kept yet, and print the tables."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("folder", type=Path)
    options.add_argument("--limit", type=float, default=240.0, help="s of each fit")
    asked = options.parse_args()
    if not RECORDINGS.is_dir():
        print(f"skipped: {RECORDINGS} is not there; the recordings are Rhoban/bam's, published on GitHub")
        return 1
    asked.folder.mkdir(parents=True, exist_ok=True)
    together = kept(asked.folder, "together", RICH, NAMES, (), asked.limit)
    rest = tuple(name for name in NAMES if name not in HELD_OUT)
    held = kept(asked.folder, "held_out", RICH, rest, HELD_OUT, asked.limit)
    alone = {name: kept(asked.folder, name, PLAIN, (name,), (), asked.limit) for name in NAMES}
    own = kept(asked.folder, "own_arm", RICH, NAMES, (), asked.limit, OWN)
    show(alone, together, own, held)
    return 0


if __name__ == "__main__":
    sys.exit(main())
