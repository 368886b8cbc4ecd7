"""The page of the blind trial, from what `score` wrote: board, confusions, stories, baselines, and what is possible."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from markupsafe import Markup

from studies.trial import pictures
from studies.trial.record import TRAIN
from studies.trial.running import METHODS, ROOT
from studies.trial.seal import unseal

BASELINES = {
    "diagnose": "optid diagnose",
    "exhaustive": "every effect refitted, BIC",
    "sparse": "sparse regression",
    "neural": "neural residual",
    "armax": "ARMAX",
}
FIRST = "single effect, first name right, "
COLUMNS = {
    "first name right": (FIRST + "position only", FIRST + "with pressures"),
    "false alarms": ("nothing missing, nothing named",),
    "named outside the list": ("... given a name",),
}
AFTER = "hold-out RMSE after, over the oracle's"


def page(folder: Path, key: str, real: Sequence[Path] = ()) -> str:
    """The page as HTML that stands alone.

    Args:
        folder: of a draw that was run and scored.
        key: that opens its answers.
        real: folders of diagnoses of real recordings.
    """
    manifest = json.loads((folder / "cases.json").read_text())
    answers = unseal(folder / "answers.sealed", key, manifest["answers_sha256"])["cases"]
    board = json.loads((folder / "scores/diagnose.json").read_text())
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    return environment.get_template("page.html.j2").render(
        style=Markup((ROOT / "optid/report/style.css").read_text()),
        cases=board["cases"],
        digests=board["commitments"],
        lead=lead(board),
        rates=[shown(r) for r in board["rates"]],
        rates_figure=Markup(pictures.rates(board["rates"])),
        spreads=[{"name": n, **{k: f"{v:.3g}" for k, v in s.items()}} for n, s in board["spreads"].items()],
        gain_figure=Markup(pictures.gains(board["every"])),
        confusion_figure=Markup(pictures.confusion(board["confusion"])),
        groups=[(name, [shown(r) for r in group]) for name, group in board["by"].items()],
        stories=stories(folder, board, {a["case"]["name"]: a for a in answers}),
        baselines=baselines(folder),
        baseline_columns=[*COLUMNS, "RMSE after / oracle, median"],
        matrix_figure=distinguishable(),
        real=[told(place) for place in real],
    )


def lead(board: Mapping[str, Any]) -> str:
    """The board in one sentence."""
    asked = [r for r in board["rates"] if r["target"] is not None and r["trials"]]
    met = sum(r["share"] >= r["target"] for r in asked)
    return f"{met} of {len(asked)} figures that were asked for are reached."


def shown(r: Mapping[str, Any]) -> dict[str, str]:
    """A rate as text."""
    if not r["trials"]:
        return {
            **dict.fromkeys(("share", "interval", "target", "mark"), ""),
            "figure": r["figure"],
            "count": "0",
        }
    low, high = r["interval"]
    target = r["target"]
    return {
        "figure": r["figure"],
        "share": f"{100 * r['share']:.0f} %",
        "count": f"{r['hits']}/{r['trials']}",
        "interval": f"{100 * low:.0f} to {100 * high:.0f} %",
        "target": "" if target is None else f"{100 * target:.0f} %",
        "mark": "" if target is None else "hit" if r["share"] >= target else "miss",
    }


def stories(folder: Path, board: Mapping[str, Any], answers: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Three cases named exactly, each hidden in another way, the faintest first."""
    told_of: dict[str, Any] = {}
    exact = [
        c
        for c in board["every"]
        if c["exact"] and c["true"] and c["kind"] == "single" and c["name"] in answers
    ]
    for case in sorted(exact, key=lambda c: answers[c["name"]]["together"]["rise"]):
        way = case["conditions"]["hidden_by"][0]
        told_of.setdefault(f"{way} {case['true'][0]}" if len(told_of) < 3 and way in told_of else way, case)
    return [story(folder, case, answers[case["name"]]) for case in list(told_of.values())[:3]]


def story(folder: Path, case: Mapping[str, Any], answer: Mapping[str, Any]) -> dict[str, Any]:
    """One case: what was hidden and how well, its recording, and what the diagnosis said."""
    diagnosis = json.loads((folder / case["name"] / "diagnose/diagnosis.json").read_text())
    part, hidden = answer["parts"][0], answer["case"]["hidden"][0]
    where = diagnosis["findings"][0].get("where", {})
    flagged = [(Path(f).stem, a, b) for f, a, b in where.get("intervals", ())]
    recording = next((name for name, _, _ in flagged), TRAIN[0])
    numbers = ", ".join(f"{k.replace('_', ' ')} {v:.3g}" for k, v in hidden["fields"].items() if v)
    before, after = case["before"] / case["oracle"], case["after"] / case["oracle"]
    return {
        "title": f"{hidden['name'].replace('_', ' ')}, {hidden['size']}, {case['conditions']['sensors']}",
        "hidden": f"Concealed: {numbers}. A refit takes {100 * part['absorbed']:.0f} % of its trace.",
        "figure": Markup(
            pictures.story(
                pd.read_csv(folder / case["name"] / f"{recording}.csv"),
                part["intervals"][recording],
                [(a, b) for name, a, b in flagged if name == recording],
            )
        ),
        "said": f"Diagnosis: {diagnosis.get('summary', '')} On the held-out recording the RMSE went from {before:.3g} "
        f"to {after:.3g} times the oracle's.",
    }


def baselines(folder: Path) -> list[dict[str, Any]]:
    """One row per method that was run and scored."""
    rows = []
    for method in METHODS:
        place = folder / "scores" / f"{method}.json"
        if not place.exists():
            continue
        board = json.loads(place.read_text())
        rates = {r["figure"]: r for r in board["rates"]}
        cells = [
            _pooled([rates[f] for f in figures], name == "false alarms") for name, figures in COLUMNS.items()
        ]
        spread = board["spreads"].get(AFTER)
        answered = rates["answered in time"]["hits"]
        cells.append(f"{spread['median']:.3g}" if spread else "")
        rows.append({"name": BASELINES[method], "cases": answered, "cells": cells})
    return rows if len(rows) > 1 else []


def _pooled(rates: Sequence[Mapping[str, Any]], complement: bool) -> str:
    hits, trials = sum(r["hits"] for r in rates), sum(r["trials"] for r in rates)
    if not trials:
        return ""
    return f"{100 * ((trials - hits) if complement else hits) / trials:.0f} %"


def distinguishable() -> Markup | None:
    """The matrix of the distinguishability study, if it was run."""
    kept = ROOT / "studies/distinguishability.json"
    if not kept.exists():
        return None
    return Markup(pictures.matrix(json.loads(kept.read_text())["rich"]["position only"]))


def told(place: Path) -> dict[str, str]:
    """What a diagnosis of a real recording says."""
    diagnosis = json.loads((place / "diagnosis.json").read_text())
    return {"title": place.name.replace("_", " "), "said": diagnosis.get("summary", diagnosis["verdict"])}
