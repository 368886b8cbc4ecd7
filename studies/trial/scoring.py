"""Scoring: the seal is opened, every case is judged, and the board is written."""

from __future__ import annotations

import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from studies.trial.board import board, text
from studies.trial.case import case_from
from studies.trial.judging import CaseOutcome, Judged, Pairs, judge, judged_from
from studies.trial.oracle import oracle_rmse
from studies.trial.record import record
from studies.trial.seal import unseal

INSEPARABLE = Path(__file__).parents[1] / "inseparable.json"  # what studies/distinguish.py found


def score(folder: Path, key: str, method: str, workers: int, former: Path | None = None) -> str:
    """Judge what `method` said of the cases that it was run on; the board as text.

    Args:
        folder: of the draw; DIR/scores/METHOD.json and .txt are written.
        key: that `draw` gave.
        method: as in running.METHODS.
        workers: processes.
        former: METHOD.json of other cases of the same draw, run before, that the board counts, too.

    Raises:
        ValueError: a case is in `former` and in `folder`.
    """
    manifest = json.loads((folder / "cases.json").read_text())
    answers = unseal(folder / "answers.sealed", key, manifest["answers_sha256"])["cases"]
    ran = [a for a in answers if (folder / a["case"]["name"] / method / "run.json").exists()]
    oracles = known_oracles(folder, ran, workers)
    pairs = inseparable()
    judged = [
        judge(a, outcome(folder / a["case"]["name"] / method, oracles[a["case"]["name"]], pairs)) for a in ran
    ]
    commitments = [manifest["answers_sha256"]]
    if former is not None:
        before = json.loads(former.read_text())
        if twice := sorted({one["name"] for one in before["every"]} & {one.name for one in judged}):
            raise ValueError(f"{former}: counts {', '.join(twice)} already; a part is counted once")
        judged = [judged_from(one) for one in before["every"]] + judged
        commitments = before["commitments"] + commitments
    left = len(answers) - len(ran)
    return written(folder / "scores", method, judged, commitments) + (
        f"\n\n{left} cases were not run yet" if left else ""
    )


def written(place: Path, method: str, judged: list[Judged], commitments: list[str]) -> str:
    """Write the board, with the hashes that committed to its answers; its text."""
    place.mkdir(exist_ok=True)
    result = {"method": method, "commitments": commitments, **board(judged)}
    (place / f"{method}.json").write_text(json.dumps(result, indent=1) + "\n")
    (place / f"{method}.txt").write_text(text(result) + "\n")
    return text(result)


def known_oracles(folder: Path, answers: list[dict[str, Any]], workers: int) -> dict[str, float]:
    """The oracle's RMSE of these cases, computed once for all methods."""
    kept = folder / "scores" / "oracle.json"
    found = json.loads(kept.read_text()) if kept.exists() else {}
    left = [a for a in answers if a["case"]["name"] not in found]
    if left:
        with ProcessPoolExecutor(workers) as pool:
            found |= dict(pool.map(_oracle, [a["case"] for a in left], [a["seconds"] for a in left]))
        kept.parent.mkdir(exist_ok=True)
        kept.write_text(json.dumps(found, indent=1) + "\n")
    return {str(name): float(rmse) for name, rmse in found.items()}


def _oracle(stated: dict[str, Any], seconds: float) -> tuple[str, float]:
    return stated["name"], oracle_rmse(record(case_from(stated), seconds))


def outcome(place: Path, oracle: float | None, pairs: Pairs) -> CaseOutcome:
    """What a method left in its folder of a case."""
    said, ended = place / "diagnosis.json", json.loads((place / "run.json").read_text())
    usable = ended["status"] == 0 and said.exists()
    diagnosis = json.loads(said.read_text()) if usable else None
    return CaseOutcome(diagnosis, ended["status"], ended["seconds"], oracle, pairs)


def inseparable() -> Pairs:
    """Pairs of effects that the distinguishability study could not tell apart at usual sizes."""
    if not INSEPARABLE.exists():
        return frozenset()
    return frozenset(frozenset(pair) for pair in json.loads(INSEPARABLE.read_text())["pairs"])
