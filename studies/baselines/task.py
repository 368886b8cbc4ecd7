"""The call that all baselines answer, and the form of their answer."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optid.core.readers import read_recording
from optid.core.recording import Recording
from optid.estimation.prediction import predict
from optid.estimation.result import Fit
from optid.report.scores import number
from optid.rigs.rigfile import Rig, read_rig


@dataclass(frozen=True)
class Task:
    """A rig, recordings to fit, one held out, and where the answer goes."""

    rig: Rig
    train: tuple[Recording, ...]
    holdout: Recording
    out: Path


def asked(arguments: Sequence[str] | None = None) -> Task:
    """The task of the command line: RIG RECORDING... --holdout RECORDING --out DIR."""
    parser = argparse.ArgumentParser()
    parser.add_argument("rig", type=Path)
    parser.add_argument("recordings", type=Path, nargs="+")
    parser.add_argument("--holdout", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    rig = read_rig(given.rig)
    train = tuple(read_recording(path, rig) for path in given.recordings)
    return Task(rig, train, read_recording(given.holdout, rig), given.out)


def window_rmse(rig: Rig, recording: Recording, found: Fit) -> float:
    """Of the position over windows of 0.5 s, m."""
    known = {q.name for q in rig.model.parameters}
    values = {**rig.parameters, **{k: v for k, v in found.values.items() if k in known}}
    return predict(rig, recording, values, _noise(rig, found)).scores["window"]["position"].rmse


def _noise(rig: Rig, found: Fit) -> Any:
    return found.process_noise if len(found.process_noise) == len(rig.model.states) else None


def parameters(found: Fit) -> dict[str, Any]:
    """Fitted parameters as in the contract."""
    return {
        e.name: {"value": e.value, "unit": e.unit, "ci95": [number(e.low), number(e.high)]}
        for e in found.parameters
    }


@dataclass(frozen=True)
class Said:
    """An answer: the verdict, findings, base parameters, and RMSE of the position on the hold-out before and after."""

    verdict: str
    findings: tuple[Mapping[str, Any], ...]
    parameters: Mapping[str, Any]
    before: float | None
    after: float


def finding(effect: str | None, site: str, values: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """A finding as in the contract, without where and evidence."""
    return {"effect": effect, "site": site, "parameters": dict(values or {}), "indistinguishable_from": []}


def deliver(task: Task, said: Said) -> None:
    """Write diagnosis.json."""
    document = {
        "schema": "optid.diagnosis/1",
        "verdict": said.verdict,
        "findings": list(said.findings),
        "baseline": {"parameters": dict(said.parameters), "holdout": _holdout(said.before)},
        "improved": {"parameters": {}, "holdout": _holdout(said.after)},
    }
    task.out.mkdir(parents=True, exist_ok=True)
    (task.out / "diagnosis.json").write_text(json.dumps(document, indent=1) + "\n")


def _holdout(rmse: float | None) -> dict[str, Any]:
    return {} if rmse is None else {"position": {"rmse": rmse, "unit": "m"}}
