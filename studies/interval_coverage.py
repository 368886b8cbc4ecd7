"""Do 95 % intervals hold the truth in 95 % of cases? Fits of many noisy repeats of a rig with known parameters.

    python studies/interval_coverage.py [--repeats 400] [--seconds 4] [--colour 0.8] [--workers 2] [--table FILE.csv]
    python studies/interval_coverage.py --quick

Every repeat moves the independent rig (dry friction with true stick, other equations' solver) under a new reference
and new noise, in closed loop at 1 kHz, and fits its position as a user would: from the wrong values of data/bench.toml,
with the shape of friction's yield free, because that rig sticks truly and Dahl's law does not.
The colour is the autoregression coefficient of the sensor's noise, 0 for white. Beside the coverage stands the range
in which it would lie in 95 % of studies of this size if the intervals were exact (binomial), the median half-width of
the intervals, and z: the error over the standard deviation the interval claims, whose mean shows bias and whose
standard deviation should be 1. --quick runs a few repeats and fails only where an interval misses by far.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import tempfile
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
FAR = 5.0  # of the half-widths: no interval of a sound method misses by so much in a few repeats


def repeat(number: int, seconds: float, colour: float) -> Rows:
    """Record, fit, and say for every known parameter where truth and interval lie."""
    from optid.core.readers import read_recording
    from optid.errors import NotIdentifiable
    from optid.estimation.multiple_shooting import fit
    from optid.rigs.rigfile import read_rig
    from studies.independent_rig import Rig, Sensors, recording, simulate
    from studies.references import mixed

    rng = np.random.default_rng([SEED, number])
    bench = Rig(
        viscous=TRUTH["viscous_friction"],
        coulomb=TRUTH["coulomb_friction"],
        discharge=TRUTH["discharge_coefficient"],
        residual_length=TRUTH["residual_length"],
    )
    sensors = Sensors(colour=colour)
    table = recording(simulate(bench, mixed(seconds, 1e-3, rng, 0.1), rng, sensors=sensors), rng, sensors)
    with tempfile.TemporaryDirectory() as folder:
        path, stated = Path(folder) / "repeat.csv", Path(folder) / "bench.toml"
        table[["t", "u", "x", "r"]].to_csv(path, index=False)
        stated.write_text((ROOT / "data" / "bench.toml").read_text().replace("[fit]", f"[fit]\n{SHAPE}"))
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
            "value": e.value,
            "low": e.low,
            "high": e.high,
            "held": e.low <= TRUTH[e.name] <= e.high,
            "level": float(result.process_noise[0]),
            "seconds": result.seconds,
        }
        for e in result.parameters
        if e.name in TRUTH
    ]


def study(repeats: int, seconds: float, colour: float, workers: int) -> pd.DataFrame:
    """One row for every repeat and parameter."""
    work = partial(repeat, seconds=seconds, colour=colour)
    context = multiprocessing.get_context("spawn")
    with context.Pool(workers, _alone) as pool:
        rows = [row for found in _told(pool.imap_unordered(work, range(repeats)), repeats) for row in found]
    return pd.DataFrame(rows).sort_values(["repeat", "parameter"], ignore_index=True)


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
    truth = rows["parameter"].map(TRUTH)
    half = (rows["high"] - rows["low"]) / 2
    rows = rows.assign(half=half, z=1.96 * (rows["value"] - truth) / half)
    by = rows.groupby("parameter")
    return pd.DataFrame(
        {
            "repeats": by["held"].size(),
            "coverage": 100 * by["held"].mean(),
            "half_width": by["half"].median(),
            "error_sd": (rows["value"] - truth).groupby(rows["parameter"]).std(),
            "z_mean": by["z"].mean(),
            "z_sd": by["z"].std(),
        }
    )


def main() -> int:
    """Run the study and print its table; 1 if an interval misses by far."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("--repeats", type=int, default=400)
    options.add_argument("--seconds", type=float, default=4.0)
    options.add_argument("--colour", type=float, default=0.0)
    options.add_argument("--workers", type=int, default=2)
    options.add_argument("--table", type=Path)
    options.add_argument("--quick", action="store_true")
    chosen = options.parse_args()
    repeats, seconds = (4, 3.0) if chosen.quick else (chosen.repeats, chosen.seconds)
    rows = study(repeats, seconds, chosen.colour, chosen.workers)
    if chosen.table:
        rows.to_csv(chosen.table, index=False)
    table = coverage(rows)
    ends = (rows["outcome"] == "CONVERGED").groupby(rows["repeat"]).first()
    low, high = (100 * end / repeats for end in stats.binom.interval(0.95, repeats, 0.95))
    print(
        f"{repeats} repeats of {seconds:g} s at 1 kHz, noise colour {chosen.colour:g}, {ends.mean():.0%} converged"
    )
    print(table.to_string(float_format=lambda number: f"{number:.4g}"))
    print(f"exact intervals: {low:.1f} to {high:.1f} % in 95 % of such studies")
    missed = (rows["value"] - rows["parameter"].map(TRUTH)).abs() > FAR * (rows["high"] - rows["low"]) / 2
    return int(missed.any())


if __name__ == "__main__":
    sys.exit(main())
