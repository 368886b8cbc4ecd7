"""Are the gains in force at the end of a session ever worse on the rig than those it began with?

    python studies/live_gains.py [--seeds 10] [--rig NAME] [--quick | --shown] [--out DIR]

Rigs that share no line with optid (studies/independent_rig) run in lockstep beside the model of data/bench.toml: learn
for two tours of the stroke, tune, apply what the review finds better, and go on until the trial has decided. Then both
sets of gains run the tour on the same rig without noise. A row is the ratio of their ITAE, end over start. Rows are
kept in DIR/live_gains.json, and a run that was cut goes on from there. `--shown` runs sessions instead that begin with
sluggish gains, and sessions whose user insists on worse ones.
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
from optid.live.guard import Stop  # noqa: E402
from optid.live.lockstep import run_lockstep  # noqa: E402
from optid.live.log import Layout, Log  # noqa: E402
from optid.live.loop import Choices, Loop  # noqa: E402
from optid.live.plan import ROOM, Plan  # noqa: E402
from optid.live.reference import HOLD, TOUR, tour  # noqa: E402
from optid.live.review import Case, Review, case_of  # noqa: E402
from optid.live.review import review as review_of  # noqa: E402
from optid.live.settings import live_settings, wiring_of  # noqa: E402
from optid.live.trial import LOOKS, WINDOW  # noqa: E402
from optid.live.tuning import physical, tuned  # noqa: E402
from optid.pid.controller import Gains  # noqa: E402
from optid.rigs.rigfile import read_rig  # noqa: E402
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
LEARN = 2 * LAP + 1.9  # s until the tuning; nothing moves then
TRIAL = LOOKS[-1] * HOLD + 2 * HOLD  # s, at most


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

    def asked(loop: Loop, time: float) -> None:
        found["gains"] = loop.controller.gains
        if abs(time - LEARN) < 0.5 / RATE:
            case = case_of(loop.identifier.model, (SETTINGS, WIRING), choices, start)
            review = tuned(case, plan) if insisted is None else insist(case, insisted)
            found.update(worse=list(review.worse), review=review.words, tuned=vars(review.new))
            if not (review.better or insisted):
                raise Stop("not applied")
            found["applied"] = True
            loop.change(review.new)
        if loop.verdict is not None:
            found["verdict"] = {"word": loop.verdict.word, "words": loop.verdict.words}
            raise Stop("decided")

    run(LiveRig(real, seed), choices, LEARN + TRIAL, asked)
    end = found.pop("gains")
    before, after = itae(real, start), itae(real, end)
    offered = itae(real, Gains(**found["tuned"])) if end == start else after
    return {**found, "end": vars(end), "ratio": after / before, "offered": offered / before}


def insist(case: Case, gains: Gains) -> Review:
    """The review of gains that nobody has tuned."""
    return review_of(case, gains, physical(case, BENCH, np.random.default_rng(0))[0], ROOM)


def shown(path: Path, rigs: list[str], seeds: int) -> None:
    """Sessions whose better gains are kept, and such whose worse gains go."""
    gains = gentle(SETTINGS.limits)
    kinds = {
        "sluggish at the start": (replace(gains, kp=0.3 * gains.kp), None),
        "worse ones insisted on": (gains, replace(gains, kp=0.7 * gains.kp)),
    }
    rows = read(path)
    for seed in range(seeds):
        for rig in rigs:
            for kind, (start, insisted) in kinds.items():
                key = f"{kind}, {rig} {seed}"
                if key not in rows:
                    rows[key] = row(RIGS[rig], seed, start, insisted)
                    path.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
                print(line(key, rows[key]), flush=True)


def read(path: Path) -> dict[str, Any]:
    """Rows of an earlier run."""
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else {}


def line(key: str, one: dict[str, Any]) -> str:
    """A row in words."""
    verdict = one["verdict"]
    words = f"{verdict['word']}: {verdict['words']}" if verdict else "not applied: " + "; ".join(one["worse"])
    return f"{key:10s} in force {one['ratio']:.3f}  offered {one['offered']:.3f}  {words}"


def main() -> None:
    """All rigs, all seeds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--rig", choices=RIGS, action="append", help="only this one; may be given again")
    parser.add_argument("--quick", action="store_true", help="one seed of the first rig")
    parser.add_argument("--shown", action="store_true", help="the sessions told above")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "live_gains")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    rigs = arguments.rig or list(RIGS)
    if arguments.shown:
        shown(arguments.out / "shown.json", rigs, arguments.seeds)
        return
    path = arguments.out / "live_gains.json"
    rows = read(path)
    every = [(name, seed) for seed in range(arguments.seeds) for name in rigs]
    for name, seed in every[:1] if arguments.quick else every:
        key = f"{name} {seed}"
        if key not in rows:
            rows[key] = row(RIGS[name], seed, gentle(SETTINGS.limits))
            path.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        print(line(key, rows[key]), flush=True)
    ratios = [one["ratio"] for one in rows.values()]
    words = [one["verdict"]["word"] if one["verdict"] else "not applied" for one in rows.values()]
    print(
        f"{len(ratios)} sessions: median {np.median(ratios):.3f}, largest {max(ratios):.3f} of the ITAE at the start; "
        + ", ".join(f"{word} {words.count(word)}" for word in ("kept", "undecided", "worse", "not applied"))
    )


if __name__ == "__main__":
    main()
