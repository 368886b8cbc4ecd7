"""The blind trial: recordings in which an effect is concealed, their diagnosis, and its score.

    python studies/concealed.py draw --count 150 --out DIR [--seed S] [--kinds single,pair] [--open]
    python studies/concealed.py run DIR [--limit SECONDS] [--jobs N]
    python studies/concealed.py score DIR --key DIR.key

`draw` writes the key beside DIR, not into it; without `--seed` nobody knows what was drawn. `run` opens no seal,
and goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import os
import secrets
import sys
from pathlib import Path

sys.path.insert(
    0, str(Path(__file__).parents[1])
)  # the studies are no package: find their neighbours from any folder

from studies.trial.case import KINDS
from studies.trial.drawing import Order, draw


def key_file(folder: Path) -> Path:
    """Where `draw` leaves the key."""
    return folder.with_name(folder.name + ".key")


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("draw", help="record fresh cases, answers sealed")
    one.add_argument("--seed", type=int, help="default: one that is not told")
    one.add_argument("--count", type=int, default=150)
    one.add_argument("--kinds", default=",".join(KINDS), help="of nothing,single,pair,outside")
    one.add_argument("--out", type=Path, required=True)
    one.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    one.add_argument("--open", action="store_true", help="leave answer.json in every case, for development")
    return parser


def main() -> None:
    """Run one command."""
    asked = arguments().parse_args()
    if asked.command == "draw":
        kinds = [kind for kind in asked.kinds.split(",") if kind]
        if wrong := [kind for kind in kinds if kind not in KINDS]:
            sys.exit(f"--kinds: {', '.join(wrong)} is none of {', '.join(KINDS)}")
        seed = secrets.randbits(63) if asked.seed is None else asked.seed
        order = Order(seed, asked.count, kinds, is_open=asked.open)
        key = draw(asked.out, order, asked.jobs)
        key_file(asked.out).write_text(key + "\n")
        print(
            f"{asked.count} cases in {asked.out}; the key that opens answers.sealed is in {key_file(asked.out)}"
        )


if __name__ == "__main__":
    main()
