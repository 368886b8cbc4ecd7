"""Drawing: cases are recorded on all cores, the answers go under a seal, what remains says nothing of them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from studies.trial.case import KINDS, Case
from studies.trial.compose import compose
from studies.trial.concealment import acts_when, hidden_by, loop_shows, traces
from studies.trial.record import DT, SECONDS, TRAIN, Recorded, record, write
from studies.trial.seal import seal

SHOWN = {
    "viscous": "viscous_friction_N_s_per_m",
    "coulomb": "coulomb_friction_N",
    "discharge": "discharge_coefficient",
    "residual_length": "residual_length_m",
}


@dataclass(frozen=True)
class Order:
    """What is to be drawn.

    Attributes:
        seed: of everything.
        count: of cases.
        kinds: nothing, single, pair, outside: those to draw.
        seconds: length of a recording.
        is_open: leave answer.json in every case, for development.
        part: first and last of those cases of the draw that are recorded now, from 1; None: all.
    """

    seed: int
    count: int
    kinds: Sequence[str] = KINDS
    seconds: float = SECONDS
    is_open: bool = False
    part: tuple[int, int] | None = None

    def cases(self) -> list[Case]:
        """Those to record; the rest of the draw is the same whichever part is taken."""
        first, last = self.part or (1, self.count)
        return compose(self.seed, self.count, self.kinds)[first - 1 : last]


def draw(folder: Path, order: Order, workers: int) -> str:
    """Record a draw into `folder`, on so many processes; the key that opens its answers.

    `folder` is made: recordings by case, cases.json with a hash that commits to the answers, answers.sealed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cases = order.cases()
    with ProcessPoolExecutor(workers) as pool:
        answers = list(pool.map(partial(_drawn, folder=folder, seconds=order.seconds), cases))
    key, digest = seal({"seed": order.seed, "cases": answers}, folder / "answers.sealed")
    manifest = {"schema": "optid.trial/1", "answers_sha256": digest, "cases": [case.name for case in cases]}
    (folder / "cases.json").write_text(json.dumps(manifest, indent=1) + "\n")
    if order.is_open:
        for answer in answers:
            (folder / answer["case"]["name"] / "answer.json").write_text(json.dumps(answer, indent=1) + "\n")
    return key


def _drawn(case: Case, folder: Path, seconds: float) -> dict[str, Any]:
    recorded = record(case, seconds)
    write(recorded, folder / case.name)
    return answer(recorded)


def answer(recorded: Recorded) -> dict[str, Any]:
    """What is concealed, how well, and when it acts; the first lines are those of the example rigs' answers."""
    case = recorded.case
    together, each = traces(recorded)
    tracking = loop_shows(recorded) if case.hidden else 0.0
    parts = []
    for effect, found in zip(case.hidden, each, strict=True):
        intervals = {name: acts_when(case, run, effect) for name, run in recorded.runs.items()}
        active = sum(b - a for name in TRAIN for a, b in intervals[name])
        ways = hidden_by(
            case, found, active / sum(len(recorded.runs[name].t) * DT for name in TRAIN), tracking
        )
        parts.append({"effect": effect.name, **asdict(found), "hidden_by": ways, "intervals": intervals})
    return {
        "effects": [effect.name for effect in case.hidden],
        **{shown: case.base[name] for name, shown in SHOWN.items()},
        "kind": case.kind,
        "together": None if together is None else asdict(together),
        "tracking_change": tracking,
        "seconds": len(recorded.runs[TRAIN[0]].t) * DT,
        "parts": parts,
        "case": case.stated(),
    }
