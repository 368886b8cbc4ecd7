"""The field board: every real recording is diagnosed, and scored against what engineers accept.

    python studies/field_board.py DIR [--only NAME...] [--time-limit S]

The rows stand in field/answers.toml, written down before any was run. Every row has a folder DIR/NAME; one that has
been answered is not run again, so that a board can be stopped and gone on with, and written anew from its answers.
Writes DIR/board.md, board.json and board.html. The recordings lie beside the checkout and are not part of it.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from studies.field.page import write_board
from studies.field.table import Row, read_table
from studies.real_recordings import CASES, RECORDINGS

ROOT = Path(__file__).parents[1]
DEFAULT_LIMIT = 240.0  # s of the process's own time


def located(name: str) -> Path:
    """A file of the table, in the project or among the recordings."""
    start, _, rest = name.rpartition(":")
    return (ROOT if start == "project" else RECORDINGS) / rest


def recording(name: str, folder: Path) -> Path:
    """The file of a recording; one that is cut from a larger one is written into a folder."""
    if not name.startswith("cut:"):
        return located(name)
    case, part = name.removeprefix("cut:").split("/")
    file = folder / f"{part}.csv"
    CASES[case].parts()[part].to_csv(file, index=False)
    return file


def rig_file(row: Row, folder: Path) -> Path:
    """The row's rig file; one with parameters stated otherwise is written into a folder and names its plant there."""
    file = located(row.rig)
    if not row.parameters:
        return file
    text = file.read_text(encoding="utf-8")
    for name, value in row.parameters.items():
        text, found = re.subn(rf'(?m)^{name} = "[^"]*"', f'{name} = "{value}"', text, count=1)
        if not found:
            raise ValueError(f"{file}: no parameter {name} to state otherwise")
    text = re.sub(r'(?m)^model = "([^"]*\.py:)', lambda m: f'model = "{file.parent / m[1]}', text)
    written = folder / file.name
    written.write_text(text, encoding="utf-8")
    return written


def run(row: Row, folder: Path, limit: float) -> None:
    """Run one row, unless it has been; what it said and what it cost stand in run.json."""
    if (folder / "run.json").is_file():
        return
    folder.mkdir(parents=True, exist_ok=True)
    out = folder / "answer"
    call = [row.command, str(rig_file(row, folder)), *(str(recording(one, folder)) for one in row.train)]
    for one in row.holdout:
        call += ["--holdout", str(recording(one, folder))]
    if row.command == "diagnose":
        call += ["--time-limit", f"{limit:g}"]
    if row.parameters:
        call.append("--outside-files")
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "optid.cli", *call, "--progress", "none", "--out", str(out)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    said = {"status": done.returncode, "seconds": seconds, "said": done.stdout, "error": done.stderr}
    (folder / "run.json").write_text(json.dumps(said, indent=1), encoding="utf-8")


def main() -> int:
    """Run what was asked for and write the board of all that is answered; 1 where the recordings are absent."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("folder", type=Path)
    options.add_argument(
        "--only", nargs="+", metavar="NAME", default=None, help="rows to run; all by default"
    )
    options.add_argument("--time-limit", type=float, default=DEFAULT_LIMIT, metavar="S")
    asked = options.parse_args()
    rows = read_table()
    known = [row.name for row in rows]
    if wrong := [name for name in asked.only or () if name not in known]:
        options.error(f"{', '.join(wrong)}: none of {', '.join(known)}")
    if not RECORDINGS.is_dir():
        print(f"skipped: {RECORDINGS} is not there; data/README.md says where the recordings are published")
        return 1
    for name in asked.only or known:
        print(f"{name} ...", flush=True)
        run(rows[known.index(name)], asked.folder / name, asked.time_limit)
        write_board(rows, asked.folder)
    print((asked.folder / "board.md").read_text(encoding="utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
