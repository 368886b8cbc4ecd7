"""What tuned gains are worth on rigs that share no line with optid: beside an oracle, present gains and every baseline.

    python studies/pid_gains.py [--rigs plain,sticking,leaking] [--oracle] [--reuse] [--out DIR]

The paper's figures 13 to 16 are in paper_gains.py. Of each rig 8 s are recorded. From them `optid identify`,
`optid fit` (`diagnose` where the fit leaves physics out), `optid tune --rig` and `optid tune` alone are called as a
user would. All gains are then judged by studies/independent_rig/judge.py: steps of 20, 60, -40, 80, -80, 10 and -20 mm
about mid-stroke, 2.5 s each, 0.03 mm of position noise, +-5 V, five seeds; ITAE of the true position over the step's
size, and its peak to peak over the last half second.
The oracle is a long global search over kp, ki and kd on the rig itself and the same seeds, with a derivative filter of
2 ms (--oracle, four minutes of a core a rig; else the gains found by it are taken). It knows the very noise that it is
judged by, so its figure flatters it: "fresh" are seeds that nobody has seen. A tuning may choose its filter, and so can
beat it. Where an axis comes to rest depends on the step's size as if by chance, and the oracle knows these seven:
"others" are twelve sets of sizes down to three quarters of them, which show what gains are worth when nobody knows the
sizes; on the plain rig the oracle's own cost rises there by 40 per cent. "oracle, blind" (twenty minutes) is the same
search on the rig itself where it knows neither these steps nor this noise, but others like them: what gains can be
worth to somebody who does not know the steps in advance.

--reuse takes the recording, the model and the fit of an earlier run in DIR. Beside the three rigs there are "heavy"
(5 kg, little friction) and "small" (32 mm bore, break-away, an overlapped valve): the ranges of
optid/tuning/sticking_axis.py and the length of the search with `--rig` were chosen beside them, too.

Exit status 1 if a baseline is better than the tuned gains, or they hunt by 0.1 mm.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # the studies are no package: find their neighbours from any folder

from studies.independent_rig import Rig, recording, simulate  # noqa: E402
from studies.independent_rig.judge import FILTER, SIZES, Judge, oracle  # noqa: E402
from studies.make_recording import BENCH  # noqa: E402
from studies.references import mixed  # noqa: E402
from studies.robustness import RIGS as WORN  # noqa: E402

SEED, SECONDS, PRESENT = 51, 8.0, (60.0, 0.0, 0.5)  # gains by hand
OVERLAP = dict.fromkeys(
    ("overlap_supply_a", "overlap_exhaust_a", "overlap_supply_b", "overlap_exhaust_b"), 0.01
)
SMALL = Rig(
    viscous=66.0,
    coulomb=45.0,
    discharge=0.77,
    residual_length=10.5e-3,
    bore=32e-3,
    rod=12e-3,
    stick_ratio=1.3,
)
RIGS: dict[str, tuple[Rig, str]] = {
    "plain": (BENCH, "fit"),
    "sticking": (WORN["sticking"][0], "diagnose"),
    "leaking": (WORN["leaking"][0], "diagnose"),
    "heavy": (WORN["sound"][0]._replace(mass=5.0, viscous=50.0, coulomb=40.0), "fit"),
    "small": (SMALL._replace(stribeck_speed=0.02, stribeck_form=1.0, **OVERLAP), "diagnose"),
}
# What their rig files say in place of data/bench.toml's: what a caliper and a balance tell.
SAID: dict[str, dict[str, str]] = {
    "heavy": {'payload_mass = "1.9 kg"': 'payload_mass = "5 kg"'},
    "small": {
        'bore_diameter = "42 mm"': 'bore_diameter = "32 mm"',
        'rod_diameter = "16 mm"': 'rod_diameter = "12 mm"',
    },
}
JUDGED = ("plain", "sticking", "leaking")
# kp, ki, kd as `--oracle` found them.
ORACLES: dict[str, tuple[float, float, float]] = {
    "plain": (134.253415, 0.404279776, 2.91408863),
    "sticking": (63.5641309, 2.38925140e-03, 6.63400128),
    "leaking": (179.470744, 11.2692100, 3.75622994),
    "heavy": (35.2745556, 0.289633635, 0.924306593),
    "small": (133.978159, 4.08378854e-02, 6.10626103),
}
BLIND: dict[str, tuple[float, float, float]] = {
    "plain": (144.904288, 1.49597844, 3.18627518),
}
KNOWN = {"oracle": ORACLES, "oracle, blind": BLIND}
HUNTS = 1e-4  # m
FRESH = (10, 11, 12, 13, 14)  # seeds that no search has seen
OTHERS, SHORTEST = 12, 0.75  # sets of sizes drawn between this share of the steps and all of them


def main() -> int:
    """Print a table for each rig."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rigs", default=",".join(JUDGED), help=f"of {', '.join(RIGS)}")
    parser.add_argument("--oracle", action="store_true", help="search anew")
    parser.add_argument("--reuse", action="store_true", help="models of an earlier run")
    parser.add_argument("--out", type=Path, default=Path("out/pid_gains"))
    arguments = parser.parse_args()
    failed = False
    for name in arguments.rigs.split(","):
        rig, way = RIGS[name]
        folder = arguments.out / name
        folder.mkdir(parents=True, exist_ok=True)
        began = time.perf_counter() - SECONDS  # a real rig records as long as it runs
        if not (arguments.reuse and (folder / "model" / "rig.toml").exists()):
            recorded_to_model(rig, way, folder, SAID.get(name, {}))
        else:
            began = math.nan
        seconds = tuned(folder)
        review = time.perf_counter() - began - seconds["alone"]
        best = {key: each[name] for key, each in KNOWN.items() if name in each}
        if arguments.oracle:
            best = {key: searched(rig, key == "oracle, blind") for key in KNOWN}
        table = judged(rig, candidates(folder, best))
        table.to_csv(folder / "gains.csv", index=False)
        print(
            f"\n{name}: {review:.0f} s from the first sample to gains to review, {SECONDS:g} s of them recorded; "
            f"tune --rig {seconds['with_rig']:.0f} s, tune alone {seconds['alone']:.0f} s"
        )
        print(table.to_string(index=False, float_format=lambda v: f"{v:.4g}"))
        failed |= said_wrong(table)
    return int(failed)


def recorded_to_model(rig: Rig, way: str, folder: Path, said: dict[str, str]) -> None:
    """Record, identify and fit by the command line."""
    for number, part in enumerate(("train", "holdout")):
        rng = np.random.default_rng([SEED, number])
        table = recording(simulate(rig, mixed(SECONDS, 1e-3, rng, 0.1), rng), rng)
        table[["t", "u", "x", "r"]].round(4).to_csv(folder / f"{part}.csv", index=False)
    text = (ROOT / "data" / "bench.toml").read_text()
    for stated, measured in said.items():
        text = text.replace(stated, measured)
    (folder / "rig.toml").write_text(text)
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


def tuned(folder: Path) -> dict[str, float]:
    """Tune with the rig's model and on the identified one alone; s that each took."""
    present = ("--present", ",".join(f"{g:g}" for g in PRESENT))
    model, seconds = folder / "armax" / "armax.json", {}
    for name, known in (("with_rig", ("--rig", folder / "model" / "rig.toml")), ("alone", ())):
        began = time.perf_counter()
        call("tune", model, *known, *present, "--out", folder / name)
        seconds[name] = time.perf_counter() - began
    return seconds


def call(*arguments: object) -> None:
    """One command of optid; what it says goes to the terminal if it fails."""
    done = subprocess.run(
        [sys.executable, "-m", "optid.cli", *map(str, arguments)], capture_output=True, text=True
    )
    if done.returncode != 0:
        raise SystemExit(f"optid {' '.join(map(str, arguments))}: {done.stderr or done.stdout}")


def searched(rig: Rig, blind: bool) -> tuple[float, float, float]:
    """kp, ki and kd of an oracle."""
    kp, ki, kd, *_ = oracle(rig, np.random.default_rng(SEED), print, blind)[0].tolist()
    return kp, ki, kd


def candidates(folder: Path, best: Mapping[str, Sequence[float]]) -> dict[str, tuple[float, ...]]:
    """Gains by name, six each, as the judge takes them; those of the oracles first."""
    found: dict[str, tuple[float, ...]] = {key: (*gains, FILTER, 1.0, 0.0) for key, gains in best.items()}
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
    """ITAE over size (1000 s2) on the oracle's seeds, on fresh ones, and of other sizes; peak to peak at rest (mm)."""
    rows = []
    nearby = np.random.default_rng(SEED).uniform(SHORTEST, 1.0, (OTHERS, len(SIZES))) * SIZES
    for name, one in gains.items():
        own, fresh = Judge(rig).runs(one), Judge(rig, seeds=FRESH).runs(one)
        others = np.array(
            [Judge(rig, sizes, (k,)).runs(one) for k, sizes in enumerate(nearby, FRESH[-1] + 1)]
        )
        rows.append(
            {
                "gains": name,
                "kp": one[0],
                "ki": one[1],
                "kd": one[2],
                "itae": 1e3 * own[..., 0].mean(),
                "fresh": 1e3 * fresh[..., 0].mean(),
                "others": 1e3 * others[..., 0].mean(),
                "hunting_mm": 1e3 * max(runs[..., 1].max() for runs in (own, fresh, others)),
            }
        )
    table = pd.DataFrame(rows)
    if "oracle" in gains:
        table["over_oracle"] = table["itae"] / table["itae"].iloc[0]
        table["fresh_over"] = table["fresh"] / table["fresh"].iloc[0]
        table["others_over"] = table["others"] / table["others"].iloc[0]
    return table


def said_wrong(table: pd.DataFrame) -> bool:
    """Whether a baseline is better, or tuned gains hunt; said loudly."""
    tuned = table[table["gains"].str.startswith("tuned")]
    rules = table[~table["gains"].str.startswith(("tuned", "oracle"))]
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
