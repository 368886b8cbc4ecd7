"""A fleet over nights: how soon and how surely wear is found, false alarms, and what a fleet costs.

    python studies/fleet.py nights DIR [--seed 58] [--rigs 200] [--nights 30] [--part 1-25]   simulate, test; resumes
    python studies/fleet.py score DIR                                             what the fleet statistics tell
    python studies/fleet.py nights DIR --quick                                    a small fleet, and its score
    python studies/fleet.py throughput DIR [--rows 8] [--workers 1,2]             rows by hand, and through the fleet
    python studies/fleet.py small DIR [--rows 1000]                               many small jobs: the client's memory
    python studies/fleet.py drill DIR [--kills 20]                                kill -9 of worker, scheduler, client
    python studies/fleet.py paper DIR                                             what a million recordings a day take

The rigs are those of `independent_rig`, with steps of 50 microseconds. Each has parameters of its own, but for what
siblings share; from night to night friction and supply pressure wander by a per cent or so. 14 of 200 wear, in four
ways, from a night that is drawn, and reach the medium size of the blind trial in 12 nights. A wear counts as visible
from the night on which it exceeds the least size that `distinguishability.json` says the best possible test tells from
nothing (rich motion, position only). A night's recording is 24 s at 500 Hz, as many samples as that table's motions
have, another motion every night.

`nights` calls the functions that rows call, in this process: 6 200 starts of Python would take 6 hours of a core. The
model of each rig is fitted to its first night; a fleet fits all reference nights, which takes longer and tells no more.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # finds the studies beside it from any folder

from studies.plant.drill import drill
from studies.plant.load import paper, small, throughput
from studies.plant.nights import SEED, Plant, nights
from studies.plant.scoring import score, text


def part(words: str) -> tuple[int, int]:
    """First and last rig of a part."""
    first, _, last = words.partition("-")
    return int(first), int(last)


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    for name in ("nights", "score", "throughput", "small", "drill", "paper"):
        one = commands.add_parser(name)
        one.add_argument("folder", type=Path)
        if name == "nights":
            one.add_argument("--rigs", type=int, default=200)
            one.add_argument("--nights", type=int, default=30)
            one.add_argument("--part", type=part)
            one.add_argument("--seed", type=int, default=SEED)
            one.add_argument("--quick", action="store_true")
        if name in ("throughput", "small"):
            one.add_argument("--rows", type=int, default=8 if name == "throughput" else 1000)
        if name == "throughput":
            one.add_argument("--workers", default="1,2")
        if name == "drill":
            one.add_argument("--kills", type=int, default=20)
    return parser


def main() -> int:
    """Run one command; 1 where its figures miss what is asked by far."""
    asked = arguments().parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    if asked.command == "nights":
        plant = (
            Plant(rigs=8, nights=16, wearing=2, begins=(8, 8), seed=asked.seed, seconds=6.0)
            if asked.quick
            else Plant(asked.rigs, asked.nights, seed=asked.seed)
        )
        nights(plant, asked.folder, (1, plant.rigs) if asked.part is None else asked.part)
        if not asked.quick:
            return 0
    if asked.command in ("nights", "score"):
        found = score(asked.folder)
        (asked.folder / "score.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
        print(text(found))
        return int(found["false"] > 1 or found["in_time"] < 0.7 * found["wearing"])
    found = {
        "throughput": lambda: throughput(
            asked.folder, asked.rows, [int(n) for n in asked.workers.split(",")]
        ),
        "small": lambda: small(asked.folder, asked.rows),
        "drill": lambda: drill(asked.folder, asked.kills),
        "paper": lambda: paper(asked.folder),
    }[asked.command]()
    (asked.folder / f"{asked.command}.json").write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(found, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
