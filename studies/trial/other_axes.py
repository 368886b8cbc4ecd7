"""Blind cases on the rotary and the hydraulic axis: how they are drawn, recorded and counted.

The sealed answers, the folder of a case and the way in which it is run are those of the pneumatic trial.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from studies.independent_axes import Run, simulate
from studies.independent_axes.loop import axis_of, table
from studies.references import REFERENCES
from studies.trial.board import Rate
from studies.trial.case import SIZES
from studies.trial.compose import SHARES
from studies.trial.other_names import BOARDS, Board
from studies.trial.record import HELD_OUT, SECONDS, TRAIN
from studies.trial.seal import seal, unseal
from studies.trial.sizes import Draw

DATA = Path(__file__).parents[2] / "data"
SHOWN = 0.1  # times the noise, rms in any recording: physics that changes less cannot be found by anybody
# Kinds of sites that are right beside its own, as `also` in studies/trial/outside.py: it acts on each edge's flow.
ALSO = {"flow_force": "flow"}
ASKED = {
    "single effect, first name right": 0.90,
    "nothing missing, nothing named": 1.0,
    "outside the list: unexplained, right site": 0.85,
}


@dataclass(frozen=True)
class Concealed:
    """A case: what is in it (an empty name for nothing), and every field of its rig that is not the default's."""

    name: str
    kind: str
    effect: str
    site: str
    size: str
    fields: dict[str, float]
    seed: int


def compose(board: Board, seed: int, count: int, kinds: Sequence[str]) -> list[Concealed]:
    """The cases of a draw, in an order that says nothing; kinds without pairs, every name in turn."""
    rng = np.random.default_rng(seed)
    kinds = [kind for kind in kinds if kind != "pair"]
    total = sum(SHARES[kind] for kind in kinds)
    bounds = np.round(np.cumsum([SHARES[kind] / total for kind in kinds]) * count).astype(int)
    drawn: list[tuple[str, str, str, str, dict[str, float]]] = []
    for kind, number in zip(kinds, np.diff([0, *bounds]), strict=True):
        makers = {"single": board.named, "outside": board.outside}.get(kind, {})
        names: list[str] = []
        while makers and len(names) < number:
            names += [str(name) for name in rng.permutation(list(makers))]
        for k in range(int(number)):
            size = str(rng.choice(SIZES))
            site, fields = makers[names[k]] if makers else ("", None)
            drawn.append(
                (kind, names[k] if makers else "", site, size, fields(Draw(size, rng)) if fields else {})
            )
    cases = []
    for n, k in enumerate(rng.permutation(len(drawn))):
        kind, name, site, size, fields = drawn[k]
        base = {f: getattr(board.rig, f) * (1 + rng.uniform(-s, s)) for f, s in board.base.items()}
        cases.append(
            Concealed(
                f"case-{n + 1:03d}", kind, name, site, size, {**base, **fields}, int(rng.integers(2**62))
            )
        )
    return cases


def record(board: Board, case: Concealed, folder: Path, seconds: float = SECONDS) -> None:
    """Write what a user would have: rig.toml and one CSV per recording."""
    folder.mkdir(parents=True, exist_ok=True)
    rig = board.rig._replace(**case.fields)
    (folder / "rig.toml").write_text((DATA / board.file).read_text())
    for number, name in enumerate((*TRAIN, HELD_OUT)):
        table(simulated(rig, case, number, seconds), rig).to_csv(folder / f"{name}.csv", index=False)


def simulated(rig: Any, case: Concealed, number: int, seconds: float) -> Run:
    """The number-th recording of a case on a rig, `seconds` long; the last one is held out."""
    rng = np.random.default_rng([case.seed, number])
    reference = REFERENCES[(*TRAIN, HELD_OUT)[number]](seconds, 1e-3, rng, 0.1) * axis_of(rig).reach / 0.1
    return simulate(rig, reference, rng)


def shows(board: Board, case: Concealed, seconds: float = SECONDS) -> bool:
    """Whether any recording differs from what it would be without the concealed effect, with the same noise."""
    base = {field: value for field, value in case.fields.items() if field in board.base}
    rigs = board.rig._replace(**case.fields), board.rig._replace(**base)
    for number in range(len(TRAIN) + 1):
        there, without = (simulated(rig, case, number, seconds) for rig in rigs)
        off = there.measured - without.measured, there.other - without.other
        for change, sd in zip(off, axis_of(rigs[0]).noise, strict=True):
            if sd > 0.0 and float(np.sqrt(np.mean(change**2))) > SHOWN * sd:
                return True
    return False


def draw(
    plant: str,
    folder: Path,
    seed: int,
    count: int,
    kinds: Sequence[str],
    part: tuple[int, int] | None,
    workers: int,
) -> str:
    """Record a draw into `folder`; the key that opens its answers."""
    folder.mkdir(parents=True, exist_ok=True)
    first, last = part or (1, count)
    cases = compose(BOARDS[plant], seed, count, kinds)[first - 1 : last]
    with ProcessPoolExecutor(workers) as pool:
        list(pool.map(partial(_recorded, plant, folder), cases))
    answers = {"plant": plant, "seed": seed, "cases": [asdict(case) for case in cases]}
    key, digest = seal(answers, folder / "answers.sealed")
    manifest = {
        "schema": "optid.trial/1",
        "plant": plant,
        "answers_sha256": digest,
        "cases": [case.name for case in cases],
    }
    (folder / "cases.json").write_text(json.dumps(manifest, indent=1) + "\n")
    return key


def _recorded(plant: str, folder: Path, case: Concealed) -> None:
    record(BOARDS[plant], case, folder / case.name)


@dataclass(frozen=True)
class Judged:
    """A case, and what a diagnosis says: its verdict ("failed" where there is none), names and kinds of sites.

    Of an effect that is not `shown` by any recording nothing can be said: there "consistent" is right.
    """

    case: Concealed
    verdict: str
    named: tuple[str, ...]
    sites: tuple[str, ...]
    shown: bool = True

    @property
    def right(self) -> bool:
        """Whether it says what it should."""
        if self.case.kind == "single":
            return self.named[:1] == (self.case.effect,)
        if self.case.kind == "nothing":
            return not self.named and self.verdict != "failed"
        if not self.shown:
            return self.verdict == "consistent"
        sites = {self.case.site, ALSO.get(self.case.effect, self.case.site)}
        return not self.named and self.verdict == "unexplained" and not sites.isdisjoint(self.sites)

    @property
    def said(self) -> str:
        """In a few words."""
        if self.named:
            return ", ".join(self.named)
        if not self.shown:
            return f"{self.verdict}; no recording shows it"
        return f"unexplained at {', '.join(self.sites)}" if self.verdict == "unexplained" else self.verdict


def score(folder: Path, key: str, method: str) -> str:
    """Each case that was run in a line, and the figures."""
    manifest = json.loads((folder / "cases.json").read_text())
    answers = unseal(folder / "answers.sealed", key, manifest["answers_sha256"])
    found = [judged(Concealed(**case), folder / case["name"] / method) for case in answers["cases"]]
    board = BOARDS[manifest["plant"]]
    ran = [
        replace(one, shown=shows(board, one.case))
        if one.case.kind == "outside" and one.verdict == "consistent"
        else one
        for one in found
        if one is not None
    ]
    lines = [f"{'case':9s} {'kind':8s} {'size':7s} {'concealed':28s} said"]
    for one in ran:
        c = one.case
        lines.append(f"{c.name:9s} {c.kind:8s} {c.size:7s} {c.effect or '-':28s} {one.said}")
    for kind, (words, target) in zip(("single", "nothing", "outside"), ASKED.items(), strict=True):
        some = [one for one in ran if one.case.kind == kind]
        rate = Rate(words, sum(one.right for one in some), len(some), target)
        low, high = (100 * end for end in rate.interval)
        asked = f"({low:.0f} to {high:.0f} %), asked {100 * target:.0f} %"
        lines.append(f"{words:42s} {rate.hits}/{rate.trials}  {asked}")
    return "\n".join(lines)


def judged(case: Concealed, place: Path) -> Judged | None:
    """A case as a method left it; None where it has not run."""
    if not (place / "run.json").exists():
        return None
    if not (place / "diagnosis.json").exists():
        return Judged(case, "failed", (), ())
    d = json.loads((place / "diagnosis.json").read_text())
    named = tuple(f["effect"] for f in d["findings"] if f["effect"] is not None)
    sites = sorted({str(f["site"]).partition(".")[0] for f in d["findings"]})
    return Judged(case, str(d["verdict"]), named, tuple(sites))
