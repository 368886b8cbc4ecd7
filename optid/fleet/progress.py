"""Progress of a fleet: done, running, failed and why, and the expected end."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from optid.fleet.fleet import read_names
from optid.fleet.row import is_running, read_run

MANY = 20  # failed rows that are listed


@dataclass(frozen=True)
class Status:
    """The progress of a fleet.

    Attributes
    ----------
    rows : int
        that are to be answered.
    outcomes : Mapping[str, int]
        answered ones by outcome.
    running : tuple[str, ...]
        rows that somebody works on.
    failed : tuple[tuple[str, str, str], ...]
        name, outcome and last words of rows without a result.
    left : float
        s until the end, expected; NaN where nothing tells.
    """

    rows: int
    outcomes: Mapping[str, int]
    running: tuple[str, ...]
    failed: tuple[tuple[str, str, str], ...]
    left: float

    @property
    def answered(self) -> int:
        """Rows that have an outcome."""
        return sum(self.outcomes.values())

    def summary(self) -> str:
        """In a few lines."""
        counts = ", ".join(f"{count} {outcome}" for outcome, count in self.outcomes.items())
        waiting = self.rows - self.answered - len(self.running)
        lines = [
            f"{self.answered} of {self.rows} rows finished ({counts or 'none yet'}), "
            f"{len(self.running)} running, {waiting} waiting"
        ]
        lines += [f"  {name}: {outcome}: {said}" for name, outcome, said in self.failed[:MANY]]
        if len(self.failed) > MANY:
            lines.append(f"  and {len(self.failed) - MANY} more")
        if self.left > 0.0:
            lines.append(f"expected end {datetime.fromtimestamp(time.time() + self.left):%Y-%m-%d %H:%M:%S}")
        return "\n".join(lines)


def status(out: str | Path) -> Status:
    """The progress of the fleet that runs into a folder.

    Parameters
    ----------
    out : str | Path
        folder of the fleet.

    Returns
    -------
    Status
        counts of rows, running and failed ones, and the expected end.

    Raises
    ------
    InputError
        no fleet was run into it.
    """
    place = Path(out).resolve()
    names, _, began = read_names(place)
    outcomes: Counter[str] = Counter()
    running, failed, seconds = [], [], []
    for name in names:
        run = read_run(place / name)
        if run is not None:
            outcomes[run["outcome"]] += 1
            if datetime.fromisoformat(run["began"]).timestamp() >= began - 1.0:
                seconds.append(float(run["seconds"]))
            if run["outcome"] != "done":
                said = run["said"].splitlines()
                failed.append((name, str(run["outcome"]), said[-1][:300] if said else ""))
        elif is_running(place / name):
            running.append(name)
    waiting = len(names) - sum(outcomes.values())
    left = float("nan")
    if running and seconds:
        left = waiting * sum(seconds) / len(seconds) / len(running)
    return Status(len(names), dict(outcomes), tuple(running), tuple(failed), left)
