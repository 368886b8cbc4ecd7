"""Sound rigs: nothing is missing, so nothing may be named, whatever the noise and the length of the recordings.

    python studies/sound_rigs.py DIR [--count 200] [--seed 7] [--jobs 2] [--limit SECONDS]

Rigs by independent simulations (`independent_rig`, `independent_axes`): the pneumatic axis by position alone and with
pressures, the rotary one, and the hydraulic one, in turn; parameters, references and 4 to 20 s at random. The noise of
the position is white, coloured, that of a converter with wide steps, or that of a sensor slower than the log, in turn.
Prints how many were silent, by plant and noise, with a 95 % interval. Goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))

from studies.independent_axes import simulate
from studies.independent_axes.loop import axis_of, table
from studies.independent_rig.recording import grid, unit_noise
from studies.independent_rig.rig import Array
from studies.references import REFERENCES
from studies.trial import compose as pneumatic
from studies.trial import other_axes
from studies.trial.board import Rate
from studies.trial.other_names import BOARDS
from studies.trial.record import HELD_OUT, TRAIN, record, write
from studies.trial.running import CaseRun, run

PLANTS = ("servo-pneumatic", "with pressures", *BOARDS)
LENGTHS = {
    "rotary-axis": 180.0 / math.pi,
    "servo-hydraulic": 1e3,
}  # of the tables' units in a radian or a metre
SHORTEST, LONGEST = 4.0, 20.0  # s
COLOUR = 0.8  # autocorrelation from sample to sample
STEP = 4.0  # sd: of the converter
SLOWER = 4  # samples of the log for which a slow sensor holds its value
ASKED = 199 / 200


def white(x: Array, sd: float, rng: np.random.Generator) -> Array:
    """Noise that differs from sample to sample."""
    return np.asarray(x + sd * rng.normal(size=len(x)))


def coloured(x: Array, sd: float, rng: np.random.Generator) -> Array:
    """Noise that lasts for several samples."""
    return np.asarray(x + sd * unit_noise(len(x), COLOUR, rng))


def quantised(x: Array, sd: float, rng: np.random.Generator) -> Array:
    """A converter's steps, much wider than the noise before it."""
    return grid(white(x, sd, rng), STEP * sd)


def held(x: Array, sd: float, rng: np.random.Generator) -> Array:
    """A sensor that is slower than the log."""
    return np.repeat(white(x, sd, rng)[::SLOWER], SLOWER)[: len(x)]


NOISES: dict[str, Callable[[Array, float, np.random.Generator], Array]] = {
    one.__name__: one for one in (white, coloured, quantised, held)
}


def draw(folder: Path, count: int, seed: int) -> list[tuple[str, str, str]]:
    """Write the rigs that are not there yet; (case, plant, noise) of each."""
    drawn = []
    for k in range(count):
        plant, noise = PLANTS[k % len(PLANTS)], list(NOISES)[k // len(PLANTS) % len(NOISES)]
        place = folder / f"case-{k + 1:03d}"
        drawn.append((place.name, plant, noise))
        if not (place / f"{HELD_OUT}.csv").exists():
            rng = np.random.default_rng([seed, k])
            seconds = float(rng.uniform(SHORTEST, LONGEST))
            (recorded_cylinder if plant in PLANTS[:2] else recorded_axis)(place, plant, noise, seconds, rng)
    names = [case for case, _, _ in drawn]
    (folder / "cases.json").write_text(json.dumps({"seed": seed, "cases": names}, indent=1) + "\n")
    return drawn


def recorded_cylinder(place: Path, plant: str, noise: str, seconds: float, rng: np.random.Generator) -> None:
    """The pneumatic axis, under conditions as in the trial."""
    case = pneumatic.conditions(place.name, "nothing", (), plant == PLANTS[1], rng)
    found = record(case, seconds)
    for name, one in found.runs.items():
        x = NOISES[noise](one.position, case.sensors.position_noise, rng)
        found.tables[name]["x"] = np.round(1e3 * x, 5)
    write(found, place)


def recorded_axis(place: Path, plant: str, noise: str, seconds: float, rng: np.random.Generator) -> None:
    """The rotary or the hydraulic axis, with parameters as in its trial."""
    board = BOARDS[plant]
    (case,) = other_axes.compose(board, int(rng.integers(2**62)), 1, ["nothing"])
    rig = board.rig._replace(**case.fields)
    axis = axis_of(rig)
    place.mkdir(parents=True, exist_ok=True)
    (place / "rig.toml").write_text((other_axes.DATA / board.file).read_text())
    for name in (*TRAIN, HELD_OUT):
        reference = REFERENCES[name](seconds, 1e-3, rng, 0.1) * axis.reach / 0.1
        one = simulate(rig, reference, rng)
        written = table(one, rig)
        written["x"] = np.round(LENGTHS[plant] * NOISES[noise](one.position, axis.noise[0], rng), 6)
        written.to_csv(place / f"{name}.csv", index=False)


def said(place: Path) -> str:
    """The verdict, and what was named; why there is none."""
    file = place / "diagnose" / "diagnosis.json"
    if not file.exists():
        ran = place / "diagnose" / "run.json"
        return "failed: " + json.loads(ran.read_text())["said"].strip()[-200:] if ran.exists() else ""
    found = json.loads(file.read_text())
    names = [one["effect"] for one in found["findings"] if one["effect"] is not None]
    return f"{found['verdict']} {', '.join(names)}".strip()


def main() -> int:
    """Draw, run and count; 1 if anything was named or failed beyond what is asked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--limit", type=float, default=900.0, help="s, of a case")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    drawn = draw(given.folder, given.count, given.seed)

    def report(name: str, ran: CaseRun) -> None:
        print(f"{name} {ran.seconds:5.0f} s  {said(given.folder / name)}", flush=True)

    run(given.folder, "diagnose", given.limit, given.jobs, report)
    rows = [(plant, noise, said(given.folder / case)) for case, plant, noise in drawn]
    found = pd.DataFrame(rows, columns=["plant", "noise", "said"])
    found["silent"] = found["said"].isin(["consistent", "unexplained"])
    found["consistent"] = found["said"] == "consistent"
    for by in ("plant", "noise"):
        print(found.groupby(by, sort=False)[["silent", "consistent"]].agg(["sum", "count"]).to_string())
    for case, (_, row) in zip(drawn, found.iterrows(), strict=True):
        if not row["consistent"]:
            print(" ", *case, "->", row["said"])
    rate = Rate("sound rigs silent", int(found["silent"].sum()), len(found), ASKED)
    low, high = rate.interval
    print(f"silent {rate.hits} of {rate.trials} ({100 * low:.1f} to {100 * high:.1f} %)")
    return int(rate.hits < ASKED * rate.trials)


if __name__ == "__main__":
    sys.exit(main())
