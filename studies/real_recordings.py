"""Diagnoses of the real recordings: the EMPS axis, the cascaded tanks, and a cylinder with an unmeasured chamber.

    python studies/real_recordings.py DIR [NAME...]

Each record is cut into what is fitted and what is held out, written as CSV into DIR/NAME, and given to
`optid diagnose`, which leaves its report beside them. `concealed.py page --real DIR/NAME...` shows what they say.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.io import loadmat

ROOT = Path(__file__).parents[1]
RECORDINGS = ROOT.parent / "shared" / "recordings"
SKIPPED = 20  # samples at the start of each EMPS record, as the benchmark asks
LAST_STROKES = 6.4  # s: of the cylinder's eight strokes the last three are held out


def emps() -> dict[str, pd.DataFrame]:
    """The training record and the one with pulses."""
    folder, names = RECORDINGS / "emps", {"train": "DATA_EMPS", "holdout": "DATA_EMPS_PULSES"}
    return {
        part: _columns(folder / f"{name}.mat", ("t", "vir", "qm", "qg"))[SKIPPED:]
        for part, name in names.items()
    }


def tanks() -> dict[str, pd.DataFrame]:
    """The estimation record and the validation record, under the columns that the rig file names."""
    both = pd.read_csv(RECORDINGS / "cascaded_tanks" / "dataBenchmark.csv")
    held = both[["uVal", "yVal"]].set_axis(["uEst", "yEst"], axis=1)
    return {"train": both[["uEst", "yEst"]], "holdout": held}


def cylinder() -> dict[str, pd.DataFrame]:
    """The first five strokes and the last three."""
    whole = _columns(RECORDINGS / "pneumatic_cylinder" / "data.mat", ("t", "press", "desl"))
    late = whole["t"] >= LAST_STROKES
    return {"train": whole[~late], "holdout": whole[late]}


def _columns(path: Path, names: tuple[str, ...]) -> pd.DataFrame:
    held = loadmat(path)
    return pd.DataFrame({name: np.ravel(held[name]) for name in names})


@dataclass(frozen=True)
class Case:
    """A rig file and what cuts its recording into two."""

    rig: Path
    parts: Callable[[], dict[str, pd.DataFrame]]


CASES = {
    "emps": Case(ROOT / "data" / "emps.toml", emps),
    "cascaded_tanks": Case(ROOT / "data" / "cascaded_tanks.toml", tanks),
    "pneumatic_cylinder": Case(ROOT / "studies" / "hanging_cylinder.toml", cylinder),
}


def run(name: str, folder: Path) -> int:
    """Diagnose one of them into a folder; the command's exit status."""
    case, files = CASES[name], {}
    folder.mkdir(parents=True, exist_ok=True)
    for part, table in case.parts().items():
        files[part] = folder / f"{part}.csv"
        table.to_csv(files[part], index=False)
    call = [
        "diagnose",
        str(case.rig),
        str(files["train"]),
        "--holdout",
        str(files["holdout"]),
        "--out",
        str(folder),
    ]
    return subprocess.run([sys.executable, "-m", "optid.cli", *call], check=False).returncode


def main() -> int:
    """Run those that were asked for; the largest exit status, 1 where recordings are absent."""
    options = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    options.add_argument("folder", type=Path)
    options.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join(CASES)}; all when none is named"
    )
    asked = options.parse_args()
    if wrong := [name for name in asked.names if name not in CASES]:
        options.error(f"{', '.join(wrong)}: none of {', '.join(CASES)}")
    if not RECORDINGS.is_dir():
        print(f"skipped: {RECORDINGS} is not there; data/README.md says where the recordings are published")
        return 1
    return max(run(name, asked.folder / name) for name in asked.names or CASES)


if __name__ == "__main__":
    sys.exit(main())
