"""Do 95 % intervals hold the truth in 95 % of cases? Fits of many noisy repeats of a rig with known parameters.

    python studies/interval_coverage.py [--plant servo-pneumatic] [--repeats 400] [--seconds 4] [--colour 0.8]
        [--workers 2] [--seed N] [--table FILE.csv] [--stop S]
    python studies/interval_coverage.py --quick

Every repeat moves the independent rig (dry friction with true stick, other equations' solver) under a new reference
and new noise, in closed loop at 1 kHz, and fits what is measured as a user would. The pneumatic rig is one, fitted by
its position from the wrong values of data/bench.toml, with the shape of friction's yield free, because that rig sticks
truly and Dahl's law does not. The rotary and the hydraulic rig differ from their files in `data` by up to 30 %, drawn
anew for every repeat; the hydraulic one is fitted by position and both pressures. The rotary one turns round within
a millisecond, so that the damping of its contact is free as well.
The colour is the autoregression coefficient of the pneumatic sensor's noise, 0 for white. Beside the coverage stands
the range in which it would lie in 95 % of studies of this size if the intervals were exact (binomial), the median
half-width of the intervals, the largest error, both in percent of the truth, and z: the error over the standard
deviation the interval claims, whose mean shows bias and whose standard deviation should be 1. --quick runs a few
repeats and fails only where an interval misses by far. A run with --table goes on where one that was stopped ended;
--stop ends it after so many seconds.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from scipy import stats

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # the studies are no package: find their neighbours from any folder

Rows = list[dict[str, object]]

SEED = 1995
TRUTH = {
    "viscous_friction": 61.3,
    "coulomb_friction": 71.4,
    "discharge_coefficient": 0.733,
    "residual_length": 9.2e-3,
}
SHAPE = "presliding_shape = { bounds = [0, 1] }"
DAMPING = 'bristle_damping = { bounds = ["0 s", "10 ms"] }'
SPREAD = 0.3  # of the other axes' truths about their files' values
OWN = {
    "rotary-axis": {
        "load_inertia": "inertia",
        "payload_mass": "mass",
        "viscous_friction": "viscous",
        "coulomb_friction": "coulomb",
    },
    "servo-hydraulic": {
        "rated_flow": "rated_flow",
        "bulk_modulus": "bulk",
        "viscous_friction": "viscous",
        "coulomb_friction": "coulomb",
    },
}
FAR = 5.0  # of the half-widths: no interval of a sound method misses by so much in a few repeats


def pneumatic(
    seconds: float, colour: float, rng: np.random.Generator
) -> tuple[pd.DataFrame, str, dict[str, float]]:
    """What is recorded, the rig file's text, and the truth, SI."""
    from studies.independent_rig import Rig, Sensors, recording, simulate
    from studies.references import mixed

    bench = Rig(
        viscous=TRUTH["viscous_friction"],
        coulomb=TRUTH["coulomb_friction"],
        discharge=TRUTH["discharge_coefficient"],
        residual_length=TRUTH["residual_length"],
    )
    sensors = Sensors(colour=colour)
    table = recording(simulate(bench, mixed(seconds, 1e-3, rng, 0.1), rng, sensors=sensors), rng, sensors)
    text = (ROOT / "data" / "bench.toml").read_text().replace("[fit]", f"[fit]\n{SHAPE}")
    return table[["t", "u", "x", "r"]], text, TRUTH


def other(plant: str, seconds: float, rng: np.random.Generator) -> tuple[pd.DataFrame, str, dict[str, float]]:
    """The same of the rotary and the hydraulic axis."""
    from studies.independent_axes import Hydraulic, Rotary, simulate
    from studies.independent_axes.loop import axis_of, table
    from studies.references import mixed

    usual = Rotary() if plant == "rotary-axis" else Hydraulic()
    own = OWN[plant]
    truth = {name: getattr(usual, key) * (1 + rng.uniform(-SPREAD, SPREAD)) for name, key in own.items()}
    rig = usual._replace(**{own[name]: value for name, value in truth.items()})
    wanted = mixed(seconds, 1e-3, rng, 0.1) * axis_of(rig).reach / 0.1
    text = (ROOT / "data" / f"{plant.replace('-', '_')}.toml").read_text()
    if plant == "rotary-axis":
        text = text.replace("[fit]", f"[fit]\n{DAMPING}")
    return table(simulate(rig, wanted, rng), rig), text, truth


def repeat(
    number: int, seconds: float, colour: float = 0.0, plant: str = "servo-pneumatic", seed: int = SEED
) -> Rows:
    """Record, fit, and say for every known parameter where truth and interval lie."""
    from optid.core.readers import read_recording
    from optid.errors import NotIdentifiable
    from optid.estimation.multiple_shooting import fit
    from optid.rigs.rigfile import read_rig

    rng = np.random.default_rng([seed, number])
    recorded = pneumatic(seconds, colour, rng) if plant == "servo-pneumatic" else other(plant, seconds, rng)
    table, text, truth = recorded
    with tempfile.TemporaryDirectory() as folder:
        path, stated = Path(folder) / "repeat.csv", Path(folder) / "rig.toml"
        table.to_csv(path, index=False)
        stated.write_text(text)
        rig = read_rig(stated)
        try:
            result = fit(rig, [read_recording(path, rig)])
        except (
            NotIdentifiable
        ):  # this motion shows nothing of one parameter: the fit is refused, and said to be
            return []
    return [
        {
            "repeat": number,
            "outcome": result.outcome.name,
            "parameter": e.name,
            "truth": truth[e.name],
            "value": e.value,
            "low": e.low,
            "high": e.high,
            "held": e.low <= truth[e.name] <= e.high,
            "level": float(result.process_noise[0]),
            "seconds": result.seconds,
        }
        for e in result.parameters
        if e.name in truth
    ]


def study(work: partial[Rows], repeats: int, workers: int, kept: Path | None, stop: float) -> pd.DataFrame:
    """One row for every repeat and parameter; those kept in a file are not done again."""
    began, frames = time.monotonic(), []
    if kept is not None and kept.exists():
        frames.append(pd.read_csv(kept))
    done = {number for frame in frames for number in frame["repeat"]}
    left = [number for number in range(repeats) if number not in done]
    with multiprocessing.get_context("spawn").Pool(workers, _alone) as pool:
        for rows in _told(pool.imap_unordered(work, left), len(left)):
            frames.append(pd.DataFrame(rows))
            if kept is not None:
                pd.concat(frames).to_csv(kept, index=False)
            if time.monotonic() - began > stop:
                break
    return pd.concat(frames).sort_values(["repeat", "parameter"], ignore_index=True)


def _alone() -> None:
    """One core for each worker: a fit spreads over all it may use."""
    if hasattr(os, "sched_setaffinity"):
        cores = sorted(os.sched_getaffinity(0))
        number = multiprocessing.current_process()._identity[0] - 1
        os.sched_setaffinity(0, {cores[number % len(cores)]})


def _told(found: Iterator[Rows], total: int) -> Iterator[Rows]:
    for done, one in enumerate(found, 1):
        if sys.stderr.isatty():
            print(f"\r{done} of {total}", end="\n" if done == total else "", file=sys.stderr)
        yield one


def coverage(rows: pd.DataFrame) -> pd.DataFrame:
    """One row for every parameter: how often its interval held the truth, and how it missed."""
    truth, half = rows["truth"], (rows["high"] - rows["low"]) / 2
    error = rows["value"] - truth
    rows = rows.assign(half=half, z=1.96 * error / half, error=100 * error / truth, wide=100 * half / truth)
    by = rows.groupby("parameter")
    return pd.DataFrame(
        {
            "repeats": by["held"].size(),
            "coverage": 100 * by["held"].mean(),
            "half_width": by["wide"].median(),
            "error_sd": by["error"].std(),
            "largest_error": by["error"].agg(lambda one: one.abs().max()),
            "z_mean": by["z"].mean(),
            "z_sd": by["z"].std(),
        }
    )


def main() -> int:
    """Run the study and print its table; 1 if an interval misses by far."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--plant", choices=("servo-pneumatic", *OWN), default="servo-pneumatic")
    options.add_argument("--repeats", type=int, default=400)
    options.add_argument("--seconds", type=float, default=4.0)
    options.add_argument("--colour", type=float, default=0.0, help="of the pneumatic rig's sensor")
    options.add_argument("--workers", type=int, default=2)
    options.add_argument("--seed", type=int, default=SEED, help="of all repeats (default: %(default)s)")
    options.add_argument("--table", type=Path)
    options.add_argument(
        "--stop", type=float, default=float("inf"), help="s after which no result is waited for"
    )
    options.add_argument("--quick", action="store_true")
    chosen = options.parse_args()
    if chosen.colour and chosen.plant != "servo-pneumatic":
        options.error("--colour: only the pneumatic rig's sensor has coloured noise")
    repeats, seconds = (4, 3.0) if chosen.quick else (chosen.repeats, chosen.seconds)
    work = partial(repeat, seconds=seconds, colour=chosen.colour, plant=chosen.plant, seed=chosen.seed)
    rows = study(work, repeats, chosen.workers, chosen.table, chosen.stop)
    table, found = coverage(rows), rows["repeat"].nunique()
    ends = (rows["outcome"] == "CONVERGED").groupby(rows["repeat"]).first()
    low, high = (100 * end / found for end in stats.binom.interval(0.95, found, 0.95))
    print(
        f"{chosen.plant}: {found} repeats of {seconds:g} s at 1 kHz, noise colour {chosen.colour:g}, "
        f"{ends.mean():.0%} converged, {rows['seconds'].median():.1f} s a fit"
    )
    print(table.to_string(float_format=lambda number: f"{number:.4g}"))
    print(f"all: {100 * rows['held'].mean():.1f} % of {len(rows)}")
    print(f"exact intervals: {low:.1f} to {high:.1f} % of each in 95 % of such studies")
    missed = (rows["value"] - rows["truth"]).abs() > FAR * (rows["high"] - rows["low"]) / 2
    return int(missed.any())


if __name__ == "__main__":
    sys.exit(main())
