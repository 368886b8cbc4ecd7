"""Is what a live session suspects since commissioning what truly changed, and is a sound rig left alone?

    python studies/live_following.py [--sound 24] [--rows N] [--out DIR]

Sessions of data/bench.toml at 500 Hz run in lockstep against simulated rigs: the rig file itself, and the same with one
thing changed at its usual size. Four looks of twenty seconds each; every judgement counts. Of the sound rigs it is also
told how far all estimates lie from the truth, in their own standard deviations. Rows are kept in
DIR/live_following.json, and a run that was cut (or has made its N new rows) goes on from there.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.stats import binomtest, norm

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from optid.live.commissioning import LEVEL, RIG_FILE, Commissioned  # noqa: E402
from optid.live.driver import open_driver  # noqa: E402
from optid.live.following import LEAST, LOOKS, SECONDS, look  # noqa: E402
from optid.live.lockstep import run_lockstep  # noqa: E402
from optid.live.log import LOG, Layout, Log  # noqa: E402
from optid.live.loop import Choices, Loop  # noqa: E402
from optid.live.reference import tour  # noqa: E402
from optid.live.settings import live_settings, wiring_of  # noqa: E402
from optid.pid.controller import Gains  # noqa: E402
from optid.rigs.rigfile import read_rig  # noqa: E402

RATE = 500.0  # Hz
SOURCE = (ROOT / "data" / "bench.toml").read_text(encoding="utf-8")


def effect(name: str, **values: str | float) -> str:
    """A table of the rig file."""
    lines = [f"{key} = {json.dumps(value)}" for key, value in values.items()]
    return "\n".join([f"\n[effects.{name}]", *lines, ""])


# Name of the change (what the first suspect should begin with) -> the rig file that is simulated.
CHANGES = {
    "ambient_leakage": SOURCE
    + effect("ambient_leakage", area_a="0.1 mm^2", area_b="0 mm^2", laminar_share=0),
    "cross_leakage": SOURCE + effect("cross_leakage", area="0.2 mm^2"),
    "valve_deadband": SOURCE + effect("valve_deadband", width=0.02),
    "valve_offset": SOURCE + effect("valve_offset", offset=0.02),
    "coulomb_friction": SOURCE.replace('coulomb_friction = "83 N"', 'coulomb_friction = "100 N"'),
    "viscous_friction": SOURCE.replace('viscous_friction = "78 N s/m"', 'viscous_friction = "100 N s/m"'),
}


def session(real: str, seed: int, folder: Path) -> list[dict[str, Any]]:
    """At each judgement of a session: the suspects, the first one first, and each quantity's difference in its sd."""
    (folder / "real.toml").write_text(real, encoding="utf-8")
    path = folder / "rig.toml"
    path.write_text(
        f'{SOURCE}\n[live.simulated]\nrig = "real.toml"\n'.replace("[live", "[live]\n[live", 1),
        encoding="utf-8",
    )
    rig = read_rig(path)
    settings, wiring = live_settings(rig, RATE), wiring_of(rig)
    choices = Choices(Gains(18.0 + 4.0 * (seed % 4), 10.0 * (seed % 3)), seed=seed)
    loop = Loop(rig, settings, wiring, tour(settings.limits), choices)
    order = {"wiring": wiring, "settings": settings, "recording": None, "seed": seed}
    log = Log(folder / LOG, Layout(wiring).columns)
    run_lockstep(open_driver("simulated", rig, order), loop, log, LOOKS * SECONDS)
    log.close()
    head, *rows = (folder / LOG).read_text(encoding="utf-8").splitlines(keepends=True)
    looks: list[Any] = []
    told = []
    for k in range(LOOKS):
        (folder / LOG).write_text(head + "".join(rows[: round((k + 1) * SECONDS * RATE)]), encoding="utf-8")
        looks.append(look(SimpleNamespace(rig=path, out=folder), RATE))  # type: ignore[arg-type]
        if len(looks) >= LEAST:
            since = Commissioned(
                RIG_FILE, {name: (value, 0.0, 0.0) for name, value in looks[-1].stated.items()}
            )
            found = since.compare([one.found for one in looks], looks[-1].bounds)
            told.append(
                {
                    "told": [one.name for one in found if one.changed],
                    "sds": {one.name: round(one.sds, 2) for one in found if one.sd > 0.0},
                    "explained": {one.name: round(one.explained, 4) for one in found},
                }
            )
    return told


def main() -> None:
    """All sessions, and what they come to."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sound", type=int, default=24)
    parser.add_argument("--rows", type=int, default=1000, help="new ones at most")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "live_following")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    path, new = arguments.out / "live_following.json", 0
    rows: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    every = [(name, real, 100 + seed) for seed, (name, real) in enumerate(CHANGES.items())]
    every += [(f"sound {seed}", SOURCE, seed) for seed in range(arguments.sound)]
    for name, real, seed in every:
        if name not in rows:
            if new == arguments.rows:
                break
            new += 1
            with tempfile.TemporaryDirectory() as folder:
                rows[name] = session(real, seed, Path(folder))
            path.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        print(f"{name:18s} {[one['told'] for one in rows[name]]}", flush=True)
    summary(rows)


def summary(rows: dict[str, Any]) -> None:
    """What they come to."""
    sound = [one for name, judged in rows.items() if name.startswith("sound") for one in judged]
    changed = {name: judged[-1]["told"] for name, judged in rows.items() if not name.startswith("sound")}
    first = sum(told[:1] != [] and told[0].startswith(name) for name, told in changed.items())
    among = sum(any(one.startswith(name) for one in told[:3]) for name, told in changed.items())
    alarms = sum(bool(one["told"]) for one in sound)
    low, high = binomtest(alarms, len(sound)).proportion_ci(method="exact") if sound else (0.0, 1.0)
    print(
        f"sound: {alarms} of {len(sound)} judgements suspect something (95 %: {100 * low:.1f} to {100 * high:.1f} %; "
        f"designed for {100 * LEVEL:g} %)"
    )
    away = np.abs([value for one in sound for value in one["sds"].values()])
    for limit in (1.96, 2.58, 3.29) if sound else ():
        share, normal = 100 * float(np.mean(away > limit)), 200 * float(norm.sf(limit))
        print(f"  {share:.2f} % of {away.size} estimates lie beyond {limit} sd (normal: {normal:.2f} %)")
    print(f"changed: first suspect right in {first}, among three in {among} of {len(changed)}")


if __name__ == "__main__":
    main()
