"""Run the command lines of all pages, each page in a folder of its own, and record what they print.

python studies/docs/run_sessions.py [PAGE...]    a page as in the site: tutorials/diagnose
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from studies.docs.extension.sessions import DOCS, RECORD, commands_of, recorded, session_pages

ROOT = DOCS.parents[1]
OPTID = f"{sys.executable} -m optid.cli"


def run_page(page: Path, folder: Path) -> list[dict[str, Any]]:
    """Every command of a page, in order, in one folder; a status other than 0 ends it."""
    found = []
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "COLUMNS": "100"}
    for command in commands_of(page):
        began = time.monotonic()
        call = command.replace("optid ", f"{OPTID} ", 1) if command.startswith("optid ") else command
        call = call.replace("python ", f"{sys.executable} ", 1) if command.startswith("python ") else call
        done = subprocess.run(
            call, shell=True, cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise SystemExit(f"{page.name}: {command}\nstatus {done.returncode}\n{done.stdout}{done.stderr}")
        seconds = round(time.monotonic() - began, 1)
        found.append({"command": command, "output": done.stdout.strip(), "seconds": seconds})
    return found


def copy_beside(page: Path, folder: Path) -> None:
    """Copy the files that a page of a folder speaks of into the folder in which its commands run."""
    if page.parent != DOCS:
        for file in (file for kind in ("*.py", "*.toml") for file in page.parent.glob(kind)):
            shutil.copy(file, folder)


def main(wanted: list[str]) -> None:
    """Run and record."""
    for page in session_pages():
        name = page.relative_to(DOCS).with_suffix("").as_posix()
        if wanted and name not in wanted:
            continue
        with tempfile.TemporaryDirectory() as folder:
            copy_beside(page, Path(folder))
            runs = run_page(page, Path(folder))
        RECORD.write_text(
            json.dumps({**recorded(), name: runs}, indent=1, ensure_ascii=False) + "\n", encoding="utf-8"
        )
        print(name, *(f"{one['seconds']} s" for one in runs), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
