"""The board as Markdown, JSON and one HTML table."""

from __future__ import annotations

import html
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from studies.field.scoring import Answer, diagnosed, fitted, score
from studies.field.table import Row

COLUMNS = ("row", "truth", "told", "p", "error before -> after", "noise", "seconds", "score")
STYLE = (
    "body{font:14px sans-serif;margin:2em}td,th{padding:.3em .6em;border-bottom:1px solid #ccc;text-align:left;"
    "vertical-align:top}.accept{background:#cfe8cf}.tolerate{background:#f3ecc4}.reject{background:#f2c9c4}"
)


def write_board(rows: Sequence[Row], folder: Path) -> None:
    """Write what is answered so far into a folder."""
    told = [_entry(row, folder / row.name) for row in rows if (folder / row.name / "run.json").is_file()]
    counts = Counter(one["score"] for one in told)
    total = ", ".join(f"{name} {counts[name]}" for name in ("accept", "tolerate", "reject", "none"))
    cells = [[str(one[column]) for column in COLUMNS] for one in told]
    lines = ["| " + " | ".join(COLUMNS) + " |", "|---" * len(COLUMNS) + "|"]
    lines += ["| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in cells]
    (folder / "board.md").write_text(
        f"{total} of {len(rows)} rows\n\n" + "\n".join(lines) + "\n", encoding="utf-8"
    )
    (folder / "board.json").write_text(json.dumps(told, indent=1), encoding="utf-8")
    (folder / "board.html").write_text(_page(total, cells), encoding="utf-8")


def _entry(row: Row, folder: Path) -> dict[str, Any]:
    ran = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    file = folder / "answer" / ("fit.json" if row.command == "fit" else "diagnosis.json")
    document = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None
    answer = Answer("")
    if document is not None:
        answer = (fitted if row.command == "fit" else diagnosed)(document)
    return {
        "row": row.name,
        "truth": row.truth,
        "told": _told(answer, ran) if row.command != "fit" or document is None else _fit_told(document),
        "p": _p(document),
        "error before -> after": _errors(document),
        "noise": _noise(document),
        "seconds": round(ran["seconds"]),
        "score": score(row, answer),
        "doubts": list(answer.doubts),
        "source": row.source,
    }


def _told(answer: Answer, ran: Mapping[str, Any]) -> str:
    if not answer.verdict:
        last = (ran["error"].strip() or ran["said"].strip() or "nothing").splitlines()[0]
        return f"refused (status {ran['status']}): {last}"
    words = []
    for name in answer.named:
        own = {k: v for k, v in answer.values.items() if k.startswith(f"{name}.")}
        sizes = ", ".join(f"{k.removeprefix(f'{name}.')} {v:.3g} {u}" for k, (v, u) in own.items())
        words.append(f"{name} ({sizes})")
    if answer.suspected:
        words.append("suspected: " + ", ".join(answer.suspected))
    return "; ".join([answer.verdict, *words])


def _fit_told(document: Mapping[str, Any]) -> str:
    sizes = ", ".join(f"{k} {p['value']:.4g} {p['unit']}" for k, p in document["parameters"].items())
    return f"{document['outcome']}; {sizes}"


def _p(document: Mapping[str, Any] | None) -> str:
    if document is None or "test" not in document:
        return ""
    each = [f["evidence"]["p_value"] for f in document["findings"] if f["effect"] is not None]
    return ", ".join("-" if p is None else f"{p:.2g}" for p in each or [document["test"]["p_value"]])


def _errors(document: Mapping[str, Any] | None) -> str:
    if document is None or "baseline" not in document:
        return ""
    before, after = document["baseline"]["holdout"], document["improved"]["holdout"]
    return ", ".join(
        f"{before[role]['rmse']:.3g} -> {after[role]['rmse']:.3g} {after[role]['unit']}" for role in after
    )


def _noise(document: Mapping[str, Any] | None) -> str:
    floors = {} if document is None else document.get("noise_floor", {})
    return ", ".join(f"{one['rmse']:.2g} {one['unit']}" for one in floors.values())


def _page(total: str, cells: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{html.escape(column)}</th>" for column in COLUMNS)
    body = "\n".join(
        f'<tr class="{line[-1]}">' + "".join(f"<td>{html.escape(cell)}</td>" for cell in line) + "</tr>"
        for line in cells
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Field board</title><style>{STYLE}</style>'
        f"<h1>Field board</h1><p>{total}</p><table><tr>{head}</tr>\n{body}</table></html>\n"
    )
