"""What tuned gains are worth on rigs that share no line with optid: beside an oracle, present gains and every baseline.

    python studies/gains_on_rigs.py [--rigs plain,sticking,leaking] [--oracle] [--out DIR]

Of each rig 8 s are recorded. From them `optid identify`, `optid fit` (`diagnose` where the fit leaves physics out),
`optid tune --rig` and `optid tune` alone are called as a user would. All gains are then judged by
studies/independent_rig/judge.py: steps of 20, 60, -40, 80, -80, 10 and -20 mm about mid-stroke, 2.5 s each, 0.03 mm of
position noise, +-5 V, five seeds; ITAE of the true position over the step's size, and its peak to peak over the last
half second. The oracle is a long global search over kp, ki and kd on the rig itself and the same seeds (--oracle, a
quarter of an hour a rig; else the gains found by it are taken), so its figure flatters it: "fresh" are other seeds.

Exit status 1 if a baseline is better than the tuned gains, or they hunt by 0.1 mm.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # the studies are no package: find their neighbours from any folder

from studies.independent_rig import Rig, recording, simulate  # noqa: E402
from studies.independent_rig.judge import Judge, oracle  # noqa: E402
from studies.make_recording import BENCH  # noqa: E402
from studies.references import mixed  # noqa: E402
from studies.robustness import RIGS as WORN  # noqa: E402

SEED, SECONDS, PRESENT = 51, 8.0, (60.0, 0.0, 0.5)  # gains by hand
RIGS: dict[str, tuple[Rig, str]] = {
    "plain": (BENCH, "fit"),
    "sticking": (WORN["sticking"][0], "diagnose"),
    "leaking": (WORN["leaking"][0], "diagnose"),
}
# kp, ki, kd as `--oracle` found them.
ORACLES: dict[str, tuple[float, float, float]] = {
    "plain": (133.869633, 0.519642073, 2.73438445),
    "sticking": (63.5641309, 2.38925140e-03, 6.63400128),
    "leaking": (179.470744, 11.2692100, 3.75622994),
}
HUNTS = 1e-4  # m


def main() -> int:
    """Print a table for each rig."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rigs", default=",".join(RIGS))
    parser.add_argument("--oracle", action="store_true", help="search anew")
    parser.add_argument("--out", type=Path, default=Path("out/gains_on_rigs"))
    arguments = parser.parse_args()
    failed = False
    for name in arguments.rigs.split(","):
        rig, way = RIGS[name]
        folder = arguments.out / name
        folder.mkdir(parents=True, exist_ok=True)
        seconds = recorded_to_gains(rig, way, folder)
        best: Sequence[float] | None = ORACLES[name]
        if arguments.oracle:
            best = oracle(rig, np.random.default_rng(SEED), print)[0][:3].tolist()
        table = judged(rig, candidates(folder, best))
        table.to_csv(folder / "gains.csv", index=False)
        print(
            f"\n{name}: {seconds:.0f} s from the first sample to gains to review, {SECONDS:g} s of them recorded"
        )
        print(table.to_string(index=False, float_format=lambda v: f"{v:.4g}"))
        failed |= said_wrong(table)
    return int(failed)


def recorded_to_gains(rig: Rig, way: str, folder: Path) -> float:
    """Record, identify, fit and tune by the command line; s it took."""
    for number, part in enumerate(("train", "holdout")):
        rng = np.random.default_rng([SEED, number])
        table = recording(simulate(rig, mixed(SECONDS, 1e-3, rng, 0.1), rng), rng)
        table[["t", "u", "x", "r"]].round(4).to_csv(folder / f"{part}.csv", index=False)
    began = time.perf_counter() - SECONDS  # a real rig records as long as it runs
    (folder / "rig.toml").write_text((ROOT / "data" / "bench.toml").read_text())
    call("identify", folder / "train.csv", "--rig", folder / "rig.toml", "--out", folder / "armax")
    call(
        way,
        folder / "rig.toml",
        folder / "train.csv",
        "--holdout",
        folder / "holdout.csv",
        "--out",
        folder / "model",
    )
    present = ("--present", ",".join(f"{g:g}" for g in PRESENT))
    tuned = folder / "armax" / "armax.json"
    call("tune", tuned, "--rig", folder / "model" / "rig.toml", *present, "--out", folder / "with_rig")
    seconds = time.perf_counter() - began
    call("tune", tuned, *present, "--out", folder / "alone")
    return seconds


def call(*arguments: object) -> None:
    """One command of optid; what it says goes to the terminal if it fails."""
    done = subprocess.run(
        [sys.executable, "-m", "optid.cli", *map(str, arguments)], capture_output=True, text=True
    )
    if done.returncode != 0:
        raise SystemExit(f"optid {' '.join(map(str, arguments))}: {done.stderr or done.stdout}")


def candidates(folder: Path, best: Sequence[float] | None) -> dict[str, tuple[float, ...]]:
    """Gains by name, six each, as the judge takes them."""
    found: dict[str, tuple[float, ...]] = {}
    if best is not None:
        found["oracle"] = (*best, 2e-3, 1.0, 0.0)
    for name in ("with_rig", "alone"):
        content = json.loads((folder / name / "pid.json").read_text())
        found[f"tuned, {name}"] = six(content["gains"])
        if name == "with_rig":
            rules = {key: six(one["gains"]) for key, one in content["baselines"].items() if one["gains"]}
    return {**found, **rules}


def six(gains: dict[str, float]) -> tuple[float, ...]:
    """In the judge's order."""
    names = ("kp", "ki", "kd", "derivative_filter", "setpoint_weight", "derivative_weight")
    return tuple(gains[name] for name in names)


def judged(rig: Rig, gains: dict[str, tuple[float, ...]]) -> pd.DataFrame:
    """ITAE over size (1000 s2) on the oracle's seeds and on fresh ones, and peak to peak at rest (mm)."""
    rows = []
    for name, one in gains.items():
        own, fresh = Judge(rig).runs(one), Judge(rig, seeds=(10, 11, 12, 13, 14)).runs(one)
        rows.append(
            {
                "gains": name,
                "kp": one[0],
                "ki": one[1],
                "kd": one[2],
                "itae": 1e3 * own[..., 0].mean(),
                "fresh": 1e3 * fresh[..., 0].mean(),
                "hunting_mm": 1e3 * max(own[..., 1].max(), fresh[..., 1].max()),
            }
        )
    table = pd.DataFrame(rows)
    if "oracle" in gains:
        table["over_oracle"] = table["itae"] / table["itae"].iloc[0]
        table["over_oracle_fresh"] = table["fresh"] / table["fresh"].iloc[0]
    return table


def said_wrong(table: pd.DataFrame) -> bool:
    """Whether a baseline is better, or tuned gains hunt; said loudly."""
    tuned = table[table["gains"].str.startswith("tuned")]
    rules = table[~table["gains"].str.startswith("tuned") & (table["gains"] != "oracle")]
    wrong = False
    for _, one in tuned.iterrows():
        better = rules[rules["fresh"] < one["fresh"]]
        if len(better):
            wrong = True
            print(f"!! {one['gains']}: {', '.join(better['gains'])} is better")
        if one["hunting_mm"] > 1e3 * HUNTS:
            wrong = True
            print(f"!! {one['gains']}: {one['hunting_mm']:.2g} mm peak to peak at rest")
    return wrong


if __name__ == "__main__":
    sys.exit(main())
