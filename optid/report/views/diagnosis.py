"""The view of a diagnosis, made from its document and tables alone."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from matplotlib.axes import Axes

from optid.core.quantity import plain, quantity
from optid.diagnosis.summary import p_told
from optid.report import diagnosis_figures as figures
from optid.report.interactive import interactive
from optid.report.prediction_figures import residuals
from optid.report.shell import render
from optid.report.views.canvas import axes_or_new
from optid.results.diagnosis import DiagnosisResult
from optid.results.words import error, parameter_rows, percent

HEADLINES = {
    "consistent": "Nothing is missing",
    "parameters": "The physics is right, the parameters are not",
    "missing-physics": "Physics is missing",
    "unexplained": "Something is missing that is not in the catalogue",
}
SHOWN = 12  # intervals that a page lists of a finding


def plot(result: DiagnosisResult, axes: Axes | None = None) -> Axes:
    """The windows' error before and after, on the held-out recordings."""
    drawn = axes_or_new(axes)
    role = _roles(result)[0]
    figures.errors(drawn, result.tables["holdout"], role, _unit(result, role), _noise(result, role))
    drawn.set_xlabel("time over the recordings held out (s)")
    return drawn


def page(result: DiagnosisResult) -> str:
    """The report of `optid diagnose`."""
    d, about = result.document, result.document["about"]
    return render(
        "diagnosis.html.j2",
        f"{about['rig']}: diagnosis",
        d=d,
        about=about,
        headline=HEADLINES[d["verdict"]],
        scores=[_score(result, role) for role in _roles(result)],
        outputs=[_output(result, role) for role in _roles(result)],
        findings=[_finding(result, number, entry) for number, entry in enumerate(d["findings"], 1)],
        parameters=[
            (heading, *_asked_and_settings(d[part], about["asked"]))
            for heading, part in (("before", "baseline"), ("after", "improved"))
        ],
        rivals=_rivals(result),
        next_command=_next(result),
    )


def _roles(result: DiagnosisResult) -> list[str]:
    return list(result.baseline["holdout"])


def _unit(result: DiagnosisResult, role: str) -> str:
    return str(result.baseline["holdout"][role]["unit"])


def _noise(result: DiagnosisResult, role: str) -> float | None:
    noise: float | None = result.document["noise_floor"].get(role, {}).get("rmse")
    return noise


def _output(result: DiagnosisResult, role: str) -> dict[str, Any]:
    unit, frame = _unit(result, role), result.tables["holdout"]
    changed = result.baseline["holdout"] != result.improved["holdout"]
    drawn = figures.before_after(frame, role, unit, _noise(result, role), changed)
    name = str(frame["recording"].iloc[0])
    left = frame[frame["recording"] == name].rename(columns={f"{role}_after": f"{role}_window"})
    return {
        "name": role,
        "figure": interactive(drawn, f"{role} before and after"),
        "left": interactive(residuals(left, role, unit), f"{role} residual"),
        "recording": name,
    }


def _score(result: DiagnosisResult, role: str) -> dict[str, str]:
    before, after = result.baseline["holdout"][role], result.improved["holdout"][role]
    return {
        "name": role.replace("_", " "),
        "before": error(before["rmse"], before["unit"]),
        "after": error(after["rmse"], before["unit"]),
        "noise": error(_noise(result, role), before["unit"]),
        "fit_before": percent(before["fit_percent"]),
        "fit_after": percent(after["fit_percent"]),
    }


def _finding(result: DiagnosisResult, number: int, f: Mapping[str, Any]) -> dict[str, Any]:
    tables, where = result.tables, f["where"]
    told = result.document["about"]["effects"]
    says = {"law": "", "source": "", "experiment": "", **(told[number - 1] if number <= len(told) else {})}
    title = "not explained" if f["effect"] is None else f["effect"].replace("_", " ")
    mapped, missing = tables.get(f"map {number}"), tables.get(f"signal {number}")
    cause = next(iter(where["states"]), None)
    return {
        "entry": f,
        "title": title,
        "says": says,
        "parameters": _parameters(f),
        "law": missing is not None and "law" in missing,
        "evidence": _evidence(f["evidence"]),
        "suspected": _suspected(f),
        "map": None if mapped is None else interactive(figures.mismatch_map(mapped), f"{title} when"),
        "states": [_state(tables, number, name, entry) for name, entry in where["states"].items()],
        "signal": None
        if missing is None
        else interactive(
            figures.missing_signal(missing, f["place"], f.get("unit", ""), cause, where["states"]),
            f"{title} signal",
        ),
        "intervals": [f"{name} {a:.2f} to {b:.2f} s" for name, a, b in where["intervals"][:SHOWN]],
        "more": max(len(where["intervals"]) - SHOWN, 0),
    }


def _rivals(result: DiagnosisResult) -> list[list[dict[str, str]]]:
    """The rounds of contenders."""
    frame = result.tables.get("rivals")
    if frame is None:
        return []
    return [
        [
            {
                "effect": str(r["effect"]),
                "error": plain(r["error_over_noise"]),
                "loss": plain(r["loss"], 4),
                "why": str(r["why"]),
            }
            for r in part.to_dict("records")
        ]
        for _, part in frame.groupby("round")
    ]


def _suspected(f: Mapping[str, Any]) -> list[str]:
    """Effects that are not proven, with the reason: names, or entries with a name."""
    return [
        f"{one['effect']}: {one['why']}" if isinstance(one, Mapping) and "why" in one else str(one)
        for one in f.get("suspected") or ()
    ]


def _state(tables: Mapping[str, Any], number: int, name: str, entry: Mapping[str, Any]) -> tuple[Any, str]:
    low, high = (quantity(entry[end], entry["unit"]) for end in ("low", "high"))
    share = f"{100 * entry['share_of_mismatch']:.0f} % of the mismatch"
    words = f"{share} lies between {low} and {high}"
    if entry.get("by_law"):
        words = f"By its law it acts between {low} and {high}. {share} lies there"
    if entry.get("share_of_samples") is not None:
        words += f", and {100 * entry['share_of_samples']:.0f} % of the samples"
    frame = tables.get(f"state {number} {name}")
    drawn = None if frame is None else interactive(figures.over_state(frame, name, entry["unit"]), name)
    return drawn, f"{words}."


def _evidence(evidence: Mapping[str, Any]) -> str:
    said = []
    if evidence.get("holdout_fit_gain") is not None:
        said.append(f"the windows' fit rises by {plain(evidence['holdout_fit_gain'])} points")
    if evidence.get("p_value") is not None:
        said.append(p_told(evidence["p_value"]))
    return f"On the recordings held out {', '.join(said)}" if said else ""


def _parameters(part: Mapping[str, Any]) -> list[dict[str, str]]:
    rows = parameter_rows(part["parameters"], {})
    return [
        {"name": name.replace("_", " ").replace(".", ": "), "value": value, "interval": interval}
        for name, value, interval, _ in rows
    ]


def _asked_and_settings(
    part: Mapping[str, Any], asked: Collection[str]
) -> tuple[list[dict[str, str]], list[dict[str, str]]]:
    """Rows of the fitted parameters and of the effects', and of the equations' settings fitted with them."""
    every = part["parameters"]
    wanted = {name: entry for name, entry in every.items() if name in asked or "." in name}
    settings = {name: entry for name, entry in every.items() if name not in wanted}
    return _parameters({"parameters": wanted}), _parameters({"parameters": settings})


def _next(result: DiagnosisResult) -> str:
    d, about = result.document, result.document["about"]
    folder = about.get("folder", "out/diagnosis")
    open_ended = any(f["effect"] and f["indistinguishable_from"] for f in d["findings"])
    if open_ended or d["verdict"] == "unexplained":
        return f"optid plan {about['rig_file']} --diagnosis {folder} --out out/plan"
    return f"optid simulate {folder}/rig.toml {' '.join(about['held_out'])} --out out/sim"
