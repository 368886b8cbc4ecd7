"""The blind trial: recordings in which an effect is concealed, their diagnosis, and its score.

    python studies/concealed.py draw --count 150 --out DIR [--seed S] [--kinds single,pair] [--part 1-50] [--open]
    python studies/concealed.py run DIR [--limit SECONDS] [--jobs N]
    python studies/concealed.py score DIR --key DIR.key [--former BOARD.json]
    python studies/concealed.py page DIR --key DIR.key [--real DIAGNOSIS_DIR...] [--out concealed.html]
    python studies/concealed.py table BOARD.json...

With `--plant rotary-axis` or `servo-hydraulic` cases come from `studies/independent_axes`; `score` counts them.

`draw` writes the key beside DIR, not into it; without `--seed` nobody knows what was drawn. `run` opens no seal,
and goes on where it was stopped. A draw too long for one sitting goes in parts: with the hash of the code's commit
as its seed (`--seed 0x5741c692`), which nobody can have chosen the code by, each part is drawn where it is run, and
`score` counts the parts before it by their board, DIR/scores/diagnose.json, which `page` puts beside the page. `table`
sets boards side by side, as the README has them.
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))  # finds the studies beside it from any folder

from studies.trial import other_axes
from studies.trial.board import beside
from studies.trial.case import KINDS
from studies.trial.drawing import Order, draw
from studies.trial.page import page
from studies.trial.running import METHODS, CaseRun, run
from studies.trial.scoring import score


def key_file(folder: Path) -> Path:
    """Where `draw` leaves the key."""
    return folder.with_name(folder.name + ".key")


def part(text: str) -> tuple[int, int]:
    """First and last case of a part."""
    first, _, last = text.partition("-")
    return int(first), int(last)


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("draw", help="record fresh cases, answers sealed")
    plants = ("servo-pneumatic", *other_axes.BOARDS)
    one.add_argument(
        "--plant", choices=plants, default=plants[0], help="whose rig the effects are concealed in"
    )
    one.add_argument("--seed", type=lambda s: int(s, 0), help="default: one that is not told")
    one.add_argument("--count", type=int, default=150)
    one.add_argument("--kinds", default=",".join(KINDS), help="of nothing,single,pair,outside")
    one.add_argument("--part", type=part, help="first and last case to record, as in 51-100; default: all")
    one.add_argument("--out", type=Path, required=True)
    one.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    one.add_argument("--open", action="store_true", help="leave answer.json in every case, for development")
    for name in ("run", "score", "page"):
        two = commands.add_parser(name)
        two.add_argument("folder", type=Path)
        if name != "page":
            two.add_argument("--method", choices=METHODS, default="diagnose")
            two.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
        if name == "run":
            two.add_argument("--limit", type=float, default=1800.0, help="seconds that a case may take")
        else:
            two.add_argument("--key", type=Path, help="default: DIR.key")
        if name == "score":
            two.add_argument("--former", type=Path, help="board of the parts before this one, as JSON")
        if name == "page":
            two.add_argument("--real", type=Path, nargs="*", default=[], help="diagnoses of real recordings")
            two.add_argument("--out", type=Path, default=Path(__file__).with_suffix(".html"))
    three = commands.add_parser("table", help="boards side by side, in Markdown")
    three.add_argument("boards", type=Path, nargs="+")
    return parser


def main() -> None:
    """Run one command."""
    asked = arguments().parse_args()
    if asked.command == "draw":
        kinds = [kind for kind in asked.kinds.split(",") if kind]
        if wrong := [kind for kind in kinds if kind not in KINDS]:
            sys.exit(f"--kinds: {', '.join(wrong)} is none of {', '.join(KINDS)}")
        seed = secrets.randbits(63) if asked.seed is None else asked.seed
        if asked.plant in other_axes.BOARDS:
            key = other_axes.draw(asked.plant, asked.out, seed, asked.count, kinds, asked.part, asked.jobs)
            key_file(asked.out).write_text(key + "\n")
            return
        order = Order(seed, asked.count, kinds, is_open=asked.open, part=asked.part)
        key_file(asked.out).write_text(draw(asked.out, order, asked.jobs) + "\n")
        print(
            f"{len(order.cases())} cases in {asked.out}; the key to its answers.sealed is {key_file(asked.out)}"
        )
    elif asked.command == "table":
        boards = {file.stem.removeprefix("concealed_"): json.loads(file.read_text()) for file in asked.boards}
        print(beside(boards))
    elif asked.command == "run":
        run(asked.folder, asked.method, asked.limit, asked.jobs, say)
    else:
        key = (asked.key or key_file(asked.folder)).read_text()
        if "plant" in json.loads((asked.folder / "cases.json").read_text()):
            print(other_axes.score(asked.folder, key, getattr(asked, "method", "diagnose")))
            return
        if asked.command == "score":
            try:
                print(score(asked.folder, key, asked.method, asked.jobs, asked.former))
            except ValueError as error:
                sys.exit(str(error))
        else:
            asked.out.write_text(page(asked.folder, key, asked.real))
            board = asked.out.with_suffix(".json")
            board.write_text((asked.folder / "scores/diagnose.json").read_text())
            print(f"written to {asked.out}, its figures to {board}")


def say(name: str, ran: CaseRun) -> None:
    """A line for a case that ended."""
    how = (
        "late" if ran.status is None else "done" if ran.status == 0 else f"failed: {ran.said.strip()[-200:]}"
    )
    print(f"{name} {ran.seconds:6.0f} s  {how}", flush=True)


if __name__ == "__main__":
    main()
