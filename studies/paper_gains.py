"""PID gains by direct ITAE optimisation: the paper's figures 13 to 16 redrawn, and what the gains are worth.

    python studies/paper_gains.py [--out DIR] [--quick]

The paper tunes by Ziegler and Nichols and by trial and error. Here an order-4 ARMAX model is identified from
data/bench.csv, the physical model of data/bench.toml is fitted to the same recording, and gains are tuned for both.
The real system is the rig that made the recording (studies/independent_rig, which shares no line with optid): it has
true stick-slip, sensor noise and a command in steps of 2.44 mV, and no tuning has seen it but through the recording.

Written to DIR: figure_13.png (the real system in its loop), figure_14.png (a step of 6 cm: predicted by the
identified model, simulated by the physical one, and real), figure_15.png (demand positions), figure_16.png (several
position profiles), paper_gains.csv (ITAE of every baseline on all three), and the claims below on the terminal:
limits, maximum sensitivity by python-control, the best of an exhaustive grid (left out with --quick).
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.armax import Armax
from optid.core.readers import read_recording
from optid.estimation.multiple_shooting import fit
from optid.pid.controller import Controller, Gains, Settings
from optid.rigs.rigfile import Rig, read_rig, write_rig
from optid.tuning.bench import PhysicalBench
from optid.tuning.criterion import Criterion
from optid.tuning.loop import ClosedLoop
from optid.tuning.margins import Required
from optid.tuning.optimise import Options, optimise
from optid.tuning.plant import plant_of
from optid.tuning.response_metrics import Response, response
from optid.tuning.scenarios import Episode, moves, profile, step
from optid.tuning.task import Task
from optid.tuning.tuning import Scored, Tuning, compared, open_loop, tune
from studies.benchmark_tune import LIMIT, ROOT, STEP, T, identified
from studies.live_rig import LiveRig
from studies.make_recording import BENCH

SETTINGS = Settings(T, -LIMIT, LIMIT, resolution=10.0 / 4096)
SECONDS, SEED = 2.0, 7
DEMAND = [(0.0, 0.03), (1.0, 0.08), (2.0, -0.02), (3.0, -0.07), (4.0, 0.0)]  # s, m
OLD, NEW, REAL = "#c8743a", "#0a7e8c", "#2b2f36"


def main() -> None:
    """Tune, draw, and print what is claimed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/paper_gains"))
    parser.add_argument("--quick", action="store_true", help="without the exhaustive grid")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    model, rig = identified(), fitted(arguments.out)
    episodes = (step(STEP, round(SECONDS / T), T),)
    plant = plant_of(model)
    bench = PhysicalBench(rig, episodes, noise=plant.noise)
    task = Task((plant,), episodes, SETTINGS, required=Required(2.0), bench=bench)
    tuning = tune(task, np.random.default_rng(SEED), Options(free=("kp", "ki", "kd", "setpoint_weight")))
    table = compare(tuning)
    table.to_csv(arguments.out / "paper_gains.csv", index=False)
    print(f"model: {model}\ngains: {tuning.gains}")
    print(table.to_string(index=False, float_format=lambda v: f"{v:.4g}"))
    claims(tuning)
    if not arguments.quick:
        certify(task)
    draw(tuning, rig, model, arguments.out)


def fitted(folder: Path) -> Rig:
    """The physical model, fitted to the recording that the ARMAX model was identified from."""
    rig = read_rig(ROOT / "data" / "bench.toml")
    found = fit(rig, [read_recording(ROOT / "data" / "bench.csv", rig)])
    write_rig(rig, folder / "rig.toml", found.values)
    return read_rig(folder / "rig.toml")


def real(gains: Gains, episode: Episode, seed: int = SEED) -> Response:
    """One episode on the real system: the response as its sensor saw it, distances from where it stood."""
    axis, controller = LiveRig(BENCH, seed), Controller(gains, SETTINGS)
    n = episode.reference.size
    y, u = np.empty(n), np.empty(n)
    start = axis.read(0.0)[0] * 1e-3
    controller.reset(0.0, 0.0)
    for k in range(n):
        y[k] = axis.read(k * T)[0] * 1e-3 - start
        u[k] = controller.step(float(episode.reference[k]), y[k])
        axis.write(u[k] + episode.load[k], k * T)
    return response(episode, y, u, T)


def compare(tuning: Tuning) -> pd.DataFrame:
    """ITAE of all gains on the identified model, on the physical one and on the real system."""
    rows = []
    for one in (tuning.found, *compared(tuning), *tuning.baselines):
        if one.gains is None or one.margins is None:
            continue
        run = real(one.gains, tuning.task.episodes[0])
        rows.append(
            {
                "gains": one.name,
                "kp": one.gains.kp,
                "ki": one.gains.ki,
                "kd": one.gains.kd,
                "b": one.gains.setpoint_weight,
                "stable": one.stable,
                "Ms": one.margins.maximum_sensitivity,
                "identified": one.total("itae"),
                "physical": one.total("itae", True),
                "real": run.measures["itae"],
                "overshoot_real": run.overshoot,
            }
        )
    return pd.DataFrame(rows)


def claims(tuning: Tuning) -> None:
    """What a tuning promises, looked at from outside."""
    found: Scored = tuning.found
    command = np.concatenate(
        [run.command for run in (*found.responses, *found.bench, real(found.gains, tuning.task.episodes[0]))]
    )
    print(f"command: {command.min():g} to {command.max():g} V within +-{LIMIT:g} V")
    tight = replace(tuning.task, required=Required(1.6), bench=None)
    gains = optimise(tight, Options(), np.random.default_rng(SEED)).gains
    L = open_loop(tight.plant, gains)(np.exp(1j * np.geomspace(1e-4, np.pi, 200_000)))
    print(f'"maximum sensitivity at most 1.6": {np.max(1 / np.abs(1 + L)):.5f} by python-control')
    if tuning.unaware is not None:
        aware, unaware = tuning.aware.total("itae"), tuning.unaware.total("itae")
        print(f"knowing the limits: ITAE {aware:.4g} instead of {unaware:.4g} on the identified model")


def certify(task: Task, aside: int = 90) -> None:
    """kp, ki and kd on a fine grid over the whole box, beside the search for the same three."""
    alone = replace(task, bench=None, required=Required())
    search = optimise(alone, Options(free=("kp", "ki", "kd")), np.random.default_rng(SEED))
    axis = np.linspace(0.0, 1.0, aside)
    best = np.inf
    for x in axis:
        points = np.stack([c.ravel() for c in np.meshgrid([x], axis, axis, indexing="ij")], axis=1)
        best = min(best, float(alone.fitness(search.within.gains(points)).min()))
    found = float(alone.fitness(search.gains.vector)[0])
    print(f"kp, ki, kd: {found:.6g}, best of {aside}^3 grid points {best:.6g}: {found / best:.5f} times that")


def draw(tuning: Tuning, rig: Rig, model: Armax, folder: Path) -> None:
    """The four figures."""
    paper = next(one.gains for one in tuning.baselines if one.name == "paper")
    assert paper is not None
    pair = {"paper's gains": (paper, OLD), "tuned": (tuning.gains, NEW)}
    first = tuning.task.episodes[0]
    figure, (top, bottom) = plt.subplots(2, 1, sharex=True, figsize=(8, 5), height_ratios=(2, 1))
    for name, (gains, colour) in pair.items():
        run = real(gains, first)
        _lines(top, bottom, run, name, colour)
    _finish(
        figure,
        top,
        bottom,
        first,
        "Figure 13: the real system in its loop, step of 6 cm",
        folder / "figure_13.png",
    )
    for number, episode, title in (
        (14, first, "step of 6 cm"),
        (15, moves(DEMAND, round(5.0 / T), T), "demand positions"),
        (16, profiles(), "position profiles"),
    ):
        figure, axes = plt.subplots(2, 2, sharex=True, sharey="row", figsize=(10, 5.5), height_ratios=(2, 1))
        for column, (name, (gains, colour)) in enumerate(pair.items()):
            _three(axes[:, column], gains, colour, episode, rig, model)
            axes[0, column].set_title(f"Figure {number}: {title}, {name}", fontsize=9)
        axes[0, 0].set_ylabel("position (cm)")
        axes[1, 0].set_ylabel("command (V)")
        axes[0, 0].legend(fontsize=8)
        figure.tight_layout()
        figure.savefig(folder / f"figure_{number}.png", dpi=120)
        plt.close(figure)
        print(folder / f"figure_{number}.png")


def profiles() -> Episode:
    """A sine, a ramp, a step and a slow creep in turn."""
    time = T * np.arange(round(2.0 / T))
    rest = np.full(round(0.5 / T), 0.0)
    parts = [
        0.06 * np.sin(2 * np.pi * time / 2.0),
        rest,
        0.05 * np.minimum(time / 0.8, 1.0),
        np.full(rest.size, -0.04),
        -0.04 + 0.02 * time / 2.0,
    ]
    return profile(np.concatenate(parts), T, "profiles")


def _three(axes: np.ndarray, gains: Gains, colour: str, episode: Episode, rig: Rig, model: Armax) -> None:
    """Predicted, simulated and real, over the demand."""
    closed_loop = ClosedLoop((plant_of(model),), (episode,), Criterion(), SETTINGS.vector, 2 * LIMIT)
    predicted = response(episode, *closed_loop.trace(gains.vector), T)
    [simulated] = PhysicalBench(rig, (episode,))(gains, SETTINGS)
    measured = real(gains, episode)
    time = T * np.arange(episode.reference.size)
    axes[0].plot(time, 100 * episode.reference, color="#9aa3ad", lw=0.9, ls="--")
    for run, name, line in (
        (measured, "real", "-"),
        (simulated, "simulated", "--"),
        (predicted, "predicted", ":"),
    ):
        label = f"{name}: IAE {1e3 * run.measures['iae']:.3g} mm s"
        axes[0].plot(
            time, 100 * run.output, color=REAL if name == "real" else colour, lw=1.2, ls=line, label=label
        )
        axes[1].plot(time, run.command, color=REAL if name == "real" else colour, lw=0.6, ls=line)
    axes[0].legend(fontsize=7)
    axes[1].set_xlabel("time (s)")


def _lines(top: plt.Axes, bottom: plt.Axes, run: Response, name: str, colour: str) -> None:
    time = T * np.arange(run.output.size)
    top.plot(
        time, 100 * run.output, color=colour, lw=1.2, label=f"{name}: ITAE {run.measures['itae']:.3g} m s²"
    )
    bottom.plot(time, run.command, color=colour, lw=0.8)


def _finish(
    figure: plt.Figure, top: plt.Axes, bottom: plt.Axes, episode: Episode, title: str, path: Path
) -> None:
    top.plot(T * np.arange(episode.reference.size), 100 * episode.reference, color="#9aa3ad", lw=0.9, ls="--")
    top.set_title(title, fontsize=9)
    top.set_ylabel("position (cm)")
    top.legend(fontsize=8)
    bottom.set_ylabel("command (V)")
    bottom.set_xlabel("time (s)")
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)
    print(path)


if __name__ == "__main__":
    main()
