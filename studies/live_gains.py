"""Are the gains in force at the end of a session ever worse on the rig than those it began with?

    python studies/live_gains.py [--seeds 10] [--quick | --shown] [--out DIR]

Rigs that share no line with optid (studies/independent_rig) run in lockstep beside the model of data/bench.toml: learn
for one tour of the stroke, tune, apply what the review finds no worse, and go on until the trial has decided. Then both
sets of gains run the tour on the same rig without noise. A row is the ratio of their ITAE, end over start. Rows are
kept in DIR/live_gains.json, and a run that was cut goes on from there. `--shown` runs two sessions instead: one that
begins with sluggish gains, and one whose user insists on worse ones.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from optid.live.gains import gentle  # noqa: E402
from optid.live.lockstep import run_lockstep  # noqa: E402
from optid.live.log import Layout, Log  # noqa: E402
from optid.live.loop import Choices, Loop  # noqa: E402
from optid.live.plan import ROOM, Plan  # noqa: E402
from optid.live.reference import HOLD, TOUR, tour  # noqa: E402
from optid.live.review import Case, Review, case_of  # noqa: E402
from optid.live.review import review as review_of  # noqa: E402
from optid.live.settings import live_settings, wiring_of  # noqa: E402
from optid.live.trial import WINDOW  # noqa: E402
from optid.live.tuning import tuned  # noqa: E402
from optid.pid.controller import Gains  # noqa: E402
from optid.rigs.rigfile import read_rig  # noqa: E402
from optid.tuning.bench import PhysicalBench  # noqa: E402
from studies.live_rig import REAL, LiveRig  # noqa: E402

RATE = 500.0  # Hz
RIGS = {
    "bench": REAL,
    "sticky": REAL._replace(coulomb=95.0, stick_ratio=1.4),
    "heavy": REAL._replace(viscous=110.0, valve_frequency=250.0),
}
BENCH = read_rig(ROOT / "data" / "bench.toml")
SETTINGS, WIRING = live_settings(BENCH, RATE), wiring_of(BENCH)
LAP = HOLD * len(TOUR)  # s


class Quiet(LiveRig):
    """Without noise."""

    def __init__(self, real: Any) -> None:
        super().__init__(real, 0)
        self._rng = Silence()


class Silence:
    """In the place of a generator."""

    def standard_normal(self) -> float:
        """None of it."""
        return 0.0


def run(rig: LiveRig, choices: Choices, seconds: float, asked: Callable[[Loop, float], None]) -> pd.DataFrame:
    """A session's log; `asked` sees the loop and the time before each sample."""
    loop, number = Loop(BENCH, SETTINGS, WIRING, tour(SETTINGS.limits), choices), 0

    def before() -> None:
        nonlocal number
        asked(loop, number / RATE)
        number += 1

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.csv"
        log = Log(path, Layout(WIRING).columns)
        run_lockstep(rig, loop, log, seconds, before)
        log.close()
        return pd.read_csv(path)


def itae(real: Any, gains: Gains, seconds: float = LAP + HOLD) -> float:
    """Of a tour without noise, m s2 summed over its moves."""
    log = run(Quiet(real), Choices(gains), seconds, lambda loop, time: None)
    t, error = log["t"].to_numpy(), 1e-3 * np.abs(log["x"] - log["r"]).to_numpy()
    moves = log["t"][log["r"].diff().fillna(0.0) != 0.0].to_numpy()
    return float(sum(np.sum(((t - m) * error)[(t >= m) & (t < m + WINDOW)]) / RATE for m in moves))


def row(real: Any, seed: int, start: Gains, insisted: Gains | None = None) -> dict[str, Any]:
    """One session and its verdict; `insisted`: gains that are applied whatever the review says."""
    choices = Choices(start, seed=seed)
    plan = Plan(
        BENCH.path, "studies/live_rig.py:rig", Path(), tour(SETTINGS.limits), choices, rate=RATE, seed=seed
    )
    found: dict[str, Any] = {"applied": False, "verdict": None}
    learn = LAP + 1.9  # nothing moves then

    def asked(loop: Loop, time: float) -> None:
        if abs(time - learn) < 0.5 / RATE:
            case = case_of(loop.identifier.model, (SETTINGS, WIRING), choices, start)
            review = tuned(case, plan) if insisted is None else insist(case, insisted)
            found.update(worse=list(review.worse), review=review.words, tuned=vars(review.new))
            new = insisted or review.new
            if review.better or insisted:
                found["applied"] = True
                loop.change(new)
        if loop.verdict is not None:
            found["verdict"] = {"kept": loop.verdict.kept, "words": loop.verdict.words}
        found["gains"] = loop.controller.gains

    run(LiveRig(real, seed), choices, learn + LAP + 2.5, asked)
    end = found.pop("gains")
    before, after = itae(real, start), itae(real, end)
    offered = itae(real, Gains(**found["tuned"])) if end == start else after
    return {**found, "end": vars(end), "ratio": after / before, "offered": offered / before}


def insist(case: Case, gains: Gains) -> Review:
    """The review of gains that nobody has tuned."""
    return review_of(case, gains, PhysicalBench(BENCH, (case.episode,), case.output), ROOM)


def shown(path: Path) -> None:
    """A session whose better gains are kept, and one whose worse gains go."""
    gains = gentle(SETTINGS.limits)
    for name, start, insisted in (
        ("sluggish at the start", replace(gains, kp=0.3 * gains.kp), None),
        ("worse ones insisted on", gains, replace(gains, kp=0.4 * gains.kp)),
    ):
        one = row(RIGS["bench"], 0, start, insisted)
        words = one["verdict"]["words"] if one["verdict"] else "; ".join(one["worse"])
        print(f"{name}: kp {start.kp:.3g} V/m, applied {one['applied']}, reviewed worse: {one['worse']}")
        print(
            f"  {words}; kept {one['verdict'] and one['verdict']['kept']}, at the end kp {one['end']['kp']:.3g} V/m"
        )
        print(
            f"  noise-free ITAE over that at the start: in force {one['ratio']:.3f}, offered {one['offered']:.3f}"
        )
        path.write_text(json.dumps(one, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """All rigs, all seeds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--quick", action="store_true", help="one seed of the first rig")
    parser.add_argument("--shown", action="store_true", help="the two sessions told above")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "live_gains")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    if arguments.shown:
        shown(arguments.out / "shown.json")
        return
    path = arguments.out / "live_gains.json"
    rows: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    every = [(name, seed) for seed in range(arguments.seeds) for name in RIGS]
    for name, seed in every[:1] if arguments.quick else every:
        key = f"{name} {seed}"
        if key not in rows:
            rows[key] = row(RIGS[name], seed, gentle(SETTINGS.limits))
            path.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        one = rows[key]
        words = one["verdict"]["words"] if one["verdict"] else "; ".join(one["worse"])
        print(f"{key:10s} in force {one['ratio']:.3f}  offered {one['offered']:.3f}  {words}", flush=True)
    ratios = [one["ratio"] for one in rows.values()]
    print(
        f"{len(ratios)} sessions: median {np.median(ratios):.3f}, largest {max(ratios):.3f} of the ITAE at the start"
    )


if __name__ == "__main__":
    main()
