"""Every figure of the paper, drawn once, beside what the paper prints.

    python studies/paper.py [--out DIR] [--quick]

Figures 1 to 4, 6, 7 and 13 are diagrams. 8 to 12 are Table 2's experiments on the impulse recording of
studies/table2.py: measured and predicted position, a few samples where the two can be told apart, and the error at its
own scale, with the printed numbers in the title. 14 to 16 are a step of 6 cm, demand positions and position profiles in
closed loop: the independent rig, the ARMAX model's ten-step prediction and the physical model's simulation of the same
command; the paper prints no numbers there. (Figure 5 is a photograph.) `--quick` takes shorter recordings and the
physical model as its rig file states it; otherwise it is fitted to data/bench.csv first.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.armax.model import Armax
from optid.armax.plan import Plan
from optid.armax.prediction import predict
from optid.armax.survey import survey
from optid.armax.table2 import Table2
from optid.core.readers import read_recording
from optid.core.recording import Recording
from optid.estimation.multiple_shooting import fit
from optid.estimation.prediction import predict as predict_physically
from optid.rigs.rigfile import Rig, read_rig
from studies.independent_rig import recording, simulate
from studies.make_recording import BENCH
from studies.paper_diagrams import DIAGRAMS
from studies.table2 import Experiment, impulse_experiment, printed_table

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[1]
ONE_STEP = {8: (3, 1), 9: (4, 1), 10: (5, 1), 11: (4, 5), 12: (4, 10)}
MEASURED, PREDICTED, SIMULATED, QUIET = "#2b2f36", "#0a7e8c", "#c8743a", "#9aa3ad"
CLOSE, LOOP_CLOSE, T, SEED = 30, 120, 1e-3, 20210901
DEMAND = ((0.0, 0.03), (1.0, 0.08), (2.0, -0.02), (3.0, -0.07), (4.0, 0.0))  # s, m


@dataclass(frozen=True)
class LoopRun:
    """A run of the independent rig in closed loop, cm, with both models' views of it."""

    reference: Array
    measured: Array
    predicted: Array
    simulated: Array


def main() -> None:
    """Draw all figures into a folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/paper"))
    parser.add_argument("--quick", action="store_true")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for path in draw_all(arguments.out, quick=arguments.quick):
        print(path)


def draw_all(out: Path, *, quick: bool) -> list[Path]:
    """All figures; returns their files."""
    paths = []
    for number, diagram in DIAGRAMS.items():
        paths.append(out / f"figure_{number:02d}.png")
        diagram().savefig(paths[-1], dpi=120)
    impulse = impulse_experiment(np.random.default_rng(0), seconds=1.5 if quick else 4.0)
    orders = (3, 4, 5)
    found = survey(
        impulse.y,
        impulse.u,
        impulse.sample_time,
        Plan(orders, unit=impulse.unit, horizons=False, delay=1 if quick else None),
    )
    for number, (order, steps) in ONE_STEP.items():
        paths.append(out / f"figure_{number:02d}.png")
        draw_prediction(paths[-1], number, impulse, found.table2, (order, steps))
    rig, model = physical(quick), closed_loop_model(quick)
    for number, (name, reference) in demands(quick).items():
        paths.append(out / f"figure_{number:02d}.png")
        draw_loop(paths[-1], f"Figure {number}: {name}", loop_run(rig, model, reference))
    return sorted(paths)


def draw_prediction(
    path: Path, number: int, impulse: Experiment, table: Table2, pair: tuple[int, int]
) -> None:
    """Measured and predicted: the record, where the two can be told apart, and the error at its own scale."""
    time, guess = table.time(), table.traces[pair]
    error = guess - table.real
    near = telling_window(table.real, error, CLOSE)
    figure, (top, middle, bottom) = plt.subplots(3, 1, figsize=(8, 7), height_ratios=(2, 2, 1))
    for axis, part, marker in ((top, slice(None), None), (middle, near, ".")):
        axis.plot(time[part], table.real[part], color=MEASURED, lw=1.8, marker=marker, label="measured")
        axis.plot(time[part], guess[part], color=PREDICTED, lw=1.1, marker=marker, ms=5, label="predicted")
        axis.set_ylabel(f"position ({table.unit})")
    top.legend(fontsize=8)
    middle.set_title(f"{CLOSE} samples of it", fontsize=8, loc="left")
    bottom.plot(time, error, color=PREDICTED, lw=0.6)
    for axis in (top, bottom):
        axis.axvspan(time[near][0], time[near][-1], color=QUIET, alpha=0.3, lw=0)
    bottom.set_ylabel(f"error ({table.unit})")
    bottom.set_xlabel("time (s)")
    plural = "s" if pair[1] > 1 else ""
    sd = np.nanstd(error)
    top.set_title(
        f"Figure {number}: order {pair[0]}, {pair[1]} step{plural} ahead; sd of the error {sd:.3g} {table.unit}, "
        f"printed {printed(pair):.3g} cm",
        fontsize=9,
    )
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def telling_window(real: Array, error: Array, length: int) -> slice:
    """So many samples of motion in which the error is largest as a share of what the position moves."""
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    size = maximum_filter1d(np.abs(np.nan_to_num(error)), length)
    moved = maximum_filter1d(real, length) - minimum_filter1d(real, length)
    hard = size >= 0.5 * np.max(size[length:-length])
    share = np.where(hard, size / np.maximum(moved, 1e-12), 0.0)
    share[:length] = share[-length:] = 0.0
    middle = int(np.argmax(share))
    return slice(middle - length // 2, middle + (length + 1) // 2)


def printed(pair: tuple[int, int]) -> float:
    """The paper's standard deviation of the error, cm."""
    table = printed_table()
    return float(table.loc[(*pair, "error"), "standard_deviation"])


def physical(quick: bool) -> tuple[Rig, dict[str, float]]:
    """The physical model of the bench with its parameters, fitted unless that takes too long."""
    rig = read_rig(ROOT / "data" / "bench.toml")
    if quick:
        return rig, dict(rig.parameters)
    found = fit(rig, [read_recording(ROOT / "data" / "bench.csv", rig)])
    return rig, dict(found.values)


def closed_loop_model(quick: bool) -> Armax:
    """The ARMAX model of order 4 of data/bench.csv, V to m."""
    table = pd.read_csv(ROOT / "data" / "bench.csv", comment="#")
    rows = 2000 if quick else len(table)
    y, u = 1e-3 * table["x"].to_numpy()[:rows], table["u"].to_numpy()[:rows]
    return survey(y, u, T, Plan((4,), (1,), delay=1, exact=True, horizons=False)).chosen.model


def demands(quick: bool) -> dict[int, tuple[str, Array]]:
    """Reference positions of figures 14 to 16, m."""
    step = np.full(round((0.6 if quick else 2.0) / T), 0.06)
    step[: round(0.1 / T)] = 0.0
    seconds = 1.5 if quick else 5.0
    time = T * np.arange(round(seconds / T))
    levels = np.zeros(time.size)
    for start, target in DEMAND:
        levels[time >= start * seconds / 5.0] = target
    third = time.size // 3
    sine = 0.06 * np.sin(2 * np.pi * np.arange(third) / third)
    ramp = 0.05 * np.minimum(np.arange(third) / (0.4 * third), 1.0)
    paths = np.concatenate([sine, ramp, np.full(time.size - 2 * third, -0.04)])
    return {
        14: ("a step of 6 cm", step),
        15: ("demand positions", levels),
        16: ("multiple position profiles", paths),
    }


def loop_run(rig: tuple[Rig, dict[str, float]], model: Armax, reference: Array) -> LoopRun:
    """Run the rig in closed loop, and let both models follow the recorded command."""
    rng = np.random.default_rng(SEED)
    run = simulate(BENCH, reference, rng)
    table = recording(run, rng)
    free = predict_physically(rig[0], _read(rig[0], table), rig[1]).frame["position_free_run"].to_numpy()
    y, u = 1e-3 * table["x"].to_numpy(), table["u"].to_numpy()
    return LoopRun(100 * reference, 100 * y, 100 * predict(model, y, u, 10, estimated_start=True), 100 * free)


def _read(rig: Rig, table: pd.DataFrame) -> Recording:
    """A table as the rig file's recording."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.csv"
        table.to_csv(path, index=False)
        return read_recording(path, rig)


def draw_loop(path: Path, title: str, run: LoopRun) -> None:
    """Demand, measured, predicted and simulated position; a part of it; both models' errors, each at its own scale."""
    time = T * np.arange(run.measured.size)
    figure, (top, near, middle, bottom) = plt.subplots(4, 1, figsize=(8, 8), height_ratios=(2, 2, 1, 1))
    window = telling_window(run.measured, run.predicted - run.measured, LOOP_CLOSE)
    for axis, part in ((top, slice(None)), (near, window)):
        axis.plot(time[part], run.reference[part], color=QUIET, ls="--", lw=0.9, label="demand")
        axis.plot(time[part], run.measured[part], color=MEASURED, lw=1.8, label="real")
        axis.plot(time[part], run.predicted[part], color=PREDICTED, lw=1.0, label="predicted, ten steps")
        axis.plot(time[part], run.simulated[part], color=SIMULATED, lw=1.0, label="simulated")
        axis.set_ylabel("position (cm)")
    low, high = np.nanmin(run.measured[window]), np.nanmax(run.measured[window])
    near.set_ylim(low - 0.2 * (high - low), high + 0.2 * (high - low))
    near.set_title(f"{1e3 * T * LOOP_CLOSE:.0f} ms of it", fontsize=8, loc="left")
    for axis, values, colour, name in (
        (middle, run.predicted, PREDICTED, "predicted, ten steps"),
        (bottom, run.simulated, SIMULATED, "simulated"),
    ):
        error = values - run.measured
        axis.plot(time, error, color=colour, lw=0.7)
        axis.set_ylabel("error (cm)")
        axis.set_title(f"{name}: sd of the error {np.nanstd(error):.3g} cm", fontsize=8, loc="left")
    top.axvspan(time[window][0], time[window][-1], color=QUIET, alpha=0.3, lw=0)
    top.set_title(title, fontsize=9)
    top.legend(fontsize=7, ncols=4)
    bottom.set_xlabel("time (s)")
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
