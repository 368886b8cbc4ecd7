"""Section 5 of the paper and its figures 6, 7 and 13 to 16 in one command, on a rig that shares no line with optid.

    python studies/mixed_reality.py [--out DIR] [--quick]

A rig (studies/live_rig.py) and the model of data/bench.toml run side by side; the ARMAX model is identified online,
the controller is tuned on it, reviewed, and given to the rig without a jump. Everything runs in lockstep, so that
the same numbers come out on any machine. Written to DIR: figures as PNG, and mixed_reality.json.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.live.gains import gentle
from optid.live.lockstep import run_lockstep
from optid.live.log import Layout, Log
from optid.live.loop import Choices, Loop
from optid.live.plan import ROOM, Plan
from optid.live.reference import Reference, tour
from optid.live.review import Review, case_of
from optid.live.settings import live_settings, wiring_of
from optid.live.tuning import tuned
from optid.pid.controller import Gains
from optid.rigs.rigfile import read_rig
from studies.live_rig import REAL, LiveRig

ROOT = Path(__file__).parents[1]
BENCH = read_rig(ROOT / "data" / "bench.toml")
SETTINGS, WIRING = live_settings(BENCH), wiring_of(BENCH)
STEP, ARRIVED = 0.06, 0.002  # m: the paper's step of 6 cm, and how near counts as there
LEARN, AFTER = 13.0, 15.0  # s: one tour of the stroke with either gains; nothing moves at the change
ROOMS = (ROOM, 1.4, 2.0)  # maximum sensitivities: what the default costs and saves
SEED = 20210901


@dataclass(frozen=True)
class Session:
    """A session's log (columns t, u, r, x, x_predicted, x_simulated; s, V, mm) and the loop at its end."""

    log: pd.DataFrame
    loop: Loop

    def fits(self) -> dict[str, float]:
        """100 (1 - |y - yhat| / |y - mean y|) of what was predicted and simulated."""
        y = self.log["x"]
        spread = float(np.sum((y - y.mean()) ** 2))
        errors = {
            kind: (y - self.log[f"x_{kind}"]).dropna() for kind in ("predicted", "simulated", "windowed")
        }
        return {
            kind: round(100 * (1 - (float(np.sum(e**2)) / spread) ** 0.5), 2) for kind, e in errors.items()
        }


def session(
    path: Path,
    reference: Reference,
    seconds: float,
    gains: Gains,
    at: tuple[float, Callable[[Loop], None]] | None = None,
) -> Session:
    """Run the rig and its simulation side by side.

    Args:
        path: of the log.
        reference: m.
        seconds: how long.
        gains: the controller starts with.
        at: a moment, s, and what is done then.
    """
    path.unlink(missing_ok=True)
    loop = Loop(BENCH, SETTINGS, WIRING, reference, Choices(gains, seed=SEED))
    log, count = Log(path, Layout(WIRING).columns), 0

    def asked() -> None:
        nonlocal count
        if at is not None and count == round(at[0] * SETTINGS.rate):
            at[1](loop)
        count += 1

    run_lockstep(LiveRig(REAL, SEED), loop, log, seconds, asked)
    log.close()
    return Session(pd.read_csv(path), loop)


def merits(log: pd.DataFrame, begin: float, goal: float) -> dict[str, float]:
    """Of the answer to a step at `begin` (s) to `goal` (mm) until the reference moves on: ITAE, IAE, arrival."""
    part = log[(log["t"] >= begin) & (log["r"] == goal)]
    part = part[part["t"] < begin + 2.0]
    time, error = part["t"].to_numpy() - begin, 1e-3 * np.abs(part["x"].to_numpy() - goal)
    away = np.flatnonzero(error > ARRIVED)
    return {
        "itae": float(np.sum(time * error) / SETTINGS.rate),
        "iae": float(np.sum(error) / SETTINGS.rate),
        "arrival": float(time[away[-1]]) if away.size else 0.0,
    }


def story(folder: Path) -> tuple[Session, list[Review]]:
    """Record, identify, tune, review, apply without a jump: one session, the gains changed half way.

    Returns:
        The session, and the reviews for every room, the applied one first.
    """
    found: list[Review] = []
    choices = Choices(gentle(SETTINGS.limits), seed=SEED)
    plan = Plan(BENCH.path, "studies/live_rig.py:rig", folder, tour(SETTINGS.limits), choices, seed=SEED)

    def improve(loop: Loop) -> None:
        case = case_of(loop.identifier.model, (SETTINGS, WIRING), choices, loop.controller.gains)
        found.extend(tuned(case, plan, room) for room in ROOMS)
        loop.change(found[0].new)

    run = session(folder / "story.csv", plan.reference, LEARN + AFTER, choices.gains, (LEARN, improve))
    return run, found


def profiles() -> Reference:
    """Figure 16: a ramp, steps and a sine after one another, 1 kHz values."""
    t = np.arange(0.0, 2.0, 1e-3)
    ramp, stairs = 0.04 * t, 0.08 - 0.04 * np.floor(t / 0.5)
    sine, back = -0.04 + 0.05 * np.sin(np.pi * t), np.linspace(-0.04, 0.0, t.size)
    values = np.concatenate([ramp, stairs, sine, back])
    return Reference(tuple((1e-3 * np.arange(values.size)).tolist()), tuple(values.tolist()))


def draw(path: Path, title: str, log: pd.DataFrame, marks: tuple[float, ...] = ()) -> None:
    """Reference, real, predicted and simulated position over the command."""
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(9, 5), height_ratios=(3, 1))
    for column, label, style in (
        ("r", "reference", {"color": "0.6", "linestyle": "--", "linewidth": 1.0}),
        ("x", "real", {"color": "black", "linewidth": 1.8}),
        ("x_predicted", "predicted (ARMAX, one step)", {"color": "tab:cyan", "linewidth": 0.9}),
        (
            "x_simulated",
            "simulated (physical model in its own loop)",
            {"color": "tab:orange", "linewidth": 1.1},
        ),
    ):
        above.plot(log["t"], log[column], label=label, **style)
    below.plot(log["t"], log["u"], color="black", linewidth=0.8)
    for mark in marks:
        for axis in (above, below):
            axis.axvline(mark, color="tab:red", linewidth=0.8)
    above.set_ylabel("position (mm)")
    above.set_title(title, loc="left")
    above.legend(loc="best", fontsize=8)
    below.set_ylabel("command (V)")
    below.set_xlabel("time (s)")
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def draw_review(path: Path, review: Review) -> None:
    """What the two models expected of old and new gains, before anything was applied."""
    figure, axes = plt.subplots(1, 2, sharey=True, figsize=(9, 3.4))
    for axis, (model, pair) in zip(axes, review.responses.items(), strict=True):
        for name, run, colour in zip(("old", "new"), pair, ("0.6", "tab:cyan"), strict=True):
            time = review.sample_time * np.arange(run.output.size)
            axis.plot(
                time,
                1e3 * run.output,
                color=colour,
                label=f"{name} gains, ITAE {run.measures['itae']:.3g} m s²",
            )
        axis.axhline(1e3 * review.step, color="black", linewidth=0.6, linestyle="--")
        axis.set_title(f"{model} model", loc="left")
        axis.set_xlabel("time (s)")
        axis.legend(loc="lower right", fontsize=8)
    axes[0].set_ylabel("position (mm)")
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


def steps_of(log: pd.DataFrame, begin: float, end: float) -> list[dict[str, float]]:
    """Merits of every step of the reference between two moments."""
    moved = log[(log["r"].diff().fillna(0.0) != 0.0) & (log["t"] > begin) & (log["t"] < end - 1.9)]
    return [merits(log, float(row["t"]), float(row["r"])) for _, row in moved.iterrows()]


def median(rows: list[dict[str, float]]) -> dict[str, float]:
    """Of each merit over the steps."""
    return {name: float(np.median([row[name] for row in rows])) for name in rows[0]}


def main() -> None:
    """Tell the story, and compare as figures 14 to 16 do."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "mixed_reality")
    parser.add_argument("--quick", action="store_true", help="without figures 15 and 16")
    arguments = parser.parse_args()
    folder: Path = arguments.out
    folder.mkdir(parents=True, exist_ok=True)
    run, reviews = story(folder)
    review = reviews[0]
    around = run.log[(run.log["t"] > LEARN - 0.011) & (run.log["t"] < LEARN + 0.011)]
    document = {
        "old": asdict(review.old),
        "new": asdict(review.new),
        "better": review.better,
        "expected_itae": {m: [r.measures["itae"] for r in pair] for m, pair in review.responses.items()},
        "real_before": median(steps_of(run.log, 0.0, LEARN)),
        "real_after": median(steps_of(run.log, LEARN, LEARN + AFTER)),
        "jump_of_command_at_the_change": float(around["u"].diff().abs().max()),
        "taken_back": run.loop.taken_back is not None,
        "fit_percent": {"story": run.fits()},
    }
    draw(
        folder / "story.png", "Identified and tuned on the way; new gains at the red line", run.log, (LEARN,)
    )
    draw_review(folder / "review.png", review)
    up = Reference((0.0, 0.5), (0.0, STEP))
    shown = {"figure_14": ("A step of 6 cm (figure 14)", up, 2.5)}
    if not arguments.quick:
        demand = Reference((0.0, 1.0, 3.0, 5.0, 7.0), (0.0, 0.08, 0.03, -0.05, 0.02))
        shown["figure_15"] = ("Demand positions (figure 15)", demand, 9.0)
        shown["figure_16"] = ("Multiple position profiles (figure 16)", profiles(), 8.0)
    document["rooms"] = {}
    for room, one in zip(ROOMS, reviews, strict=True):
        log = session(folder / "room.csv", up, 2.5, one.new).log
        document["rooms"][str(room)] = {"gains": asdict(one.new), **merits(log, 0.5, 1e3 * STEP)}
    for name, (title, reference, seconds) in shown.items():
        part = session(folder / f"{name}.csv", reference, seconds, review.new)
        document["fit_percent"][name] = part.fits()
        draw(folder / f"{name}.png", title, part.log)
    (folder / "mixed_reality.json").write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(document, indent=1))


if __name__ == "__main__":
    main()
