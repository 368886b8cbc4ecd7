"""What a diagnosis says as recordings get worse: it may fall silent, it may not say a wrong name.

    python studies/robustness.py [--conditions usual,noise_0.5mm] [--rigs sound,leaking] [--jobs N]

Three rigs of the independent simulation (nothing missing, a leak from chamber A to the room, Stribeck friction) are
recorded under one bad condition at a time and diagnosed from position alone: three recordings to fit, one held out.
One row each: the names, whether they are right, and the windows' error over the noise. About two minutes of a core a
row; all of it takes an hour and a half of one core.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))  # the studies are no package: find their neighbours from any folder

from optid.core.recording import Channel, Recording  # noqa: E402
from optid.diagnosis.pipeline import diagnose  # noqa: E402
from optid.rigs.rigfile import Rig as RigFile  # noqa: E402
from optid.rigs.rigfile import read_rig  # noqa: E402
from studies.independent_rig import Rig, Sensors, recording, simulate  # noqa: E402
from studies.references import REFERENCES  # noqa: E402

SEED = 11
SPARE, STILL = 6.0, 0.1  # s in which a rest should come; mm within which it stays
SOUND = Rig(viscous=66.0, coulomb=75.0, discharge=0.77, residual_length=10.5e-3)
RIGS: dict[str, tuple[Rig, tuple[str, ...]]] = {
    "sound": (SOUND, ()),
    "leaking": (SOUND._replace(leak_a=2e-7), ("ambient_leakage",)),
    "sticking": (
        SOUND._replace(stick_ratio=1.5, stribeck_speed=0.025, stribeck_form=1.0),
        ("stribeck_friction",),
    ),
}


@dataclass(frozen=True)
class Condition:
    """How a rig is recorded.

    Attributes:
        rate: Hz.
        seconds: length of a recording, s.
        running: s after which it begins, at the first rest; 0: with the loop.
        sensors: what they do.
        start: by what factor the rig file's start values are wrong.
    """

    rate: float = 1000.0
    seconds: float = 8.0
    running: float = 0.0
    sensors: Sensors = field(default_factory=Sensors)
    start: float = 1.0


CONDITIONS = {
    "usual": Condition(),
    "noise_0.005mm": Condition(sensors=Sensors(position_noise=5e-6)),
    "noise_0.1mm": Condition(sensors=Sensors(position_noise=1e-4)),
    "noise_0.5mm": Condition(sensors=Sensors(position_noise=5e-4)),
    "coloured_noise": Condition(sensors=Sensors(colour=0.8)),
    "12_bits": Condition(sensors=Sensors(quantum=0.26 / 4096)),
    "missing_2_percent": Condition(sensors=Sensors(dropouts=0.02)),
    "250_Hz": Condition(rate=250.0),
    "10_kHz": Condition(rate=10_000.0),
    "4_s": Condition(seconds=4.0),
    "60_s": Condition(seconds=60.0),
    "begun_at_rest": Condition(running=20.0),
    "start_values_50_percent_high": Condition(start=1.5),
    "start_values_50_percent_low": Condition(start=0.5),
}


@dataclass(frozen=True)
class Row:
    """What was said of one rig under one condition."""

    condition: str
    rig: str
    verdict: str
    names: str
    result: str
    error_over_noise: float
    seconds: float  # of processor time


def recorded(rig: Rig, condition: Condition) -> list[Recording]:
    """Three recordings to fit and one to hold out."""
    made = []
    seconds = condition.seconds + (condition.running + SPARE if condition.running else 0.0)
    for number, (name, reference) in enumerate(REFERENCES.items()):
        rng, dt = np.random.default_rng([SEED, number]), 1.0 / condition.rate
        run = simulate(
            rig, reference(seconds, dt, rng, 0.1), rng, sensors=condition.sensors, dt=dt, step=2e-5
        )
        table = recording(run, rng, condition.sensors)
        if condition.running:
            table = from_rest(table, condition)
        volts, x = table["u"].to_numpy(), table["x"].to_numpy() * 1e-3
        channels = {
            "command": Channel("command", "u", "1", volts / 5.0, full_scale=1.0, per_unit=5.0),
            "position": Channel("position", "x", "m", x),
        }
        made.append(Recording(name, table["t"].to_numpy(), channels))
    return made


def from_rest(table: pd.DataFrame, condition: Condition) -> pd.DataFrame:
    """As long a part as was asked for, from the first rest of 0.1 s on after the time it had been running."""
    ahead = round(0.1 * condition.rate)
    smooth = table["x"].rolling(ahead // 10).mean()
    span = (smooth.rolling(ahead).max() - smooth.rolling(ahead).min()).shift(-ahead)
    still = span.to_numpy() < STILL
    first = int(np.flatnonzero(still & (table["t"].to_numpy() >= condition.running))[0])
    part = table.iloc[first : first + round(condition.seconds * condition.rate)].reset_index(drop=True)
    return part.assign(t=part["t"] - part["t"][0])


def rig_file(condition: Condition) -> RigFile:
    """The bench's rig file; what may be fitted starts at values that are wrong by a factor, within its bounds."""
    rig = read_rig(ROOT / "data" / "bench.toml")
    values = dict(rig.parameters)
    for freed in rig.freed:
        values[freed.name] = float(np.clip(condition.start * values[freed.name], freed.low, freed.high))
    return replace(rig, parameters=values)


def row(asked: tuple[str, str]) -> Row:
    """Diagnose one rig under one condition."""
    condition, (rig, missing) = CONDITIONS[asked[0]], RIGS[asked[1]]
    *train, held = recorded(rig, condition)
    began = time.process_time()
    found = diagnose(rig_file(condition), train, [held])
    spent = time.process_time() - began
    names = tuple(f.effect.name for f in found.findings if f.effect is not None)
    right = set(names) == set(missing) and (bool(missing) or found.verdict.value == "consistent")
    result = "right" if right else "wrong name" if set(names) - set(missing) else "silent"
    ratio = round(found.test.error_over_noise, 2)
    return Row(*asked, found.verdict.value, ", ".join(names), result, ratio, round(spent, 1))


def table(conditions: Sequence[str], rigs: Sequence[str], jobs: int) -> pd.DataFrame:
    """All rows, computed `jobs` at a time."""
    asked = [(condition, rig) for condition in conditions for rig in rigs]
    rows = []
    with ProcessPoolExecutor(jobs) as pool:
        for done in pool.map(row, asked):
            rows.append(asdict(done))
            print(f"{done.condition:30}{done.rig:10}{done.result:12}{done.names or done.verdict}", flush=True)
    return pd.DataFrame(rows)


def main() -> None:
    """Print the rows as they come, then all of them."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--conditions", default=",".join(CONDITIONS))
    parser.add_argument("--rigs", default=",".join(RIGS))
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    asked = parser.parse_args()
    conditions, rigs = asked.conditions.split(","), asked.rigs.split(",")
    for given, known in ((conditions, CONDITIONS), (rigs, RIGS)):
        if wrong := [name for name in given if name not in known]:
            sys.exit(f"{', '.join(wrong)}: none of {', '.join(known)}")
    found = table(conditions, rigs, asked.jobs)
    print("\n" + found.to_string(index=False))
    print("\n" + found["result"].value_counts().to_string())


if __name__ == "__main__":
    main()
