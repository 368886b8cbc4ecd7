"""One HTML file on a diagnosis, to hand to a colleague."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from optid.diagnosis.result import Diagnosis, Finding
from optid.diagnosis.selection import Contender, Round
from optid.diagnosis.summary import quantity
from optid.estimation.result import Estimate
from optid.report import diagnosis_figures as figures

_HEADLINES = {
    "consistent": "Nothing is missing",
    "parameters": "The physics is right, the stated parameters are not",
    "missing-physics": "Physics is missing",
    "unexplained": "Something is missing that the catalogue does not know",
}


def diagnosis_page(d: Diagnosis) -> str:
    """The report of `optid diagnose`."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    names = tuple(recording.name for recording in d.problem.train)
    outputs = [
        (port.role.replace("_", " "), Markup(figures.before_after(d, j)))
        for j, port in enumerate(d.base.rig.model.outputs)
        if port.role in d.test.base.scores
    ]
    return environment.get_template("diagnosis.html.j2").render(
        title=f"{d.base.rig.name}: diagnosis", headline=_HEADLINES[d.verdict.value], d=d, names=names,
        held=list(d.holdout), outputs=outputs, scores=_scores(d),
        horizon=f"{d.test.base.horizon:g}",
        findings=[_finding(f, names) for f in d.findings], rivals=_rivals(d),
        before=[_row(e) for e in d.base_parameters], after=[_row(e) for e in d.best_parameters],
    )  # fmt: skip


def _scores(d: Diagnosis) -> list[dict[str, str]]:
    rows = []
    for role, before in d.test.base.scores.items():
        after = d.test.best.scores[role]
        rows.append({
            "name": role.replace("_", " "), "before": quantity(before.rmse, before.unit),
            "after": quantity(after.rmse, after.unit), "noise": quantity(d.noise.get(role, 0.0), before.unit),
            "fit_before": f"{before.fit_percent:.2f} %", "fit_after": f"{after.fit_percent:.2f} %",
        })  # fmt: skip
    return rows


def _finding(f: Finding, names: tuple[str, ...]) -> dict[str, Any]:
    return {
        "title": "not explained" if f.effect is None else f.effect.name.replace("_", " "),
        "site": f.site, "place": f.place, "law": "" if f.effect is None else f.effect.law,
        "equation": "" if f.effect is None else f.effect.equation, "sentence": f.sentence,
        "source": "" if f.effect is None else f.effect.source,
        "experiment": "" if f.effect is None else f.effect.experiment,
        "parameters": [_row(e) for e in f.parameters], "evidence": f.evidence, "gain": f.train_gain,
        "drawn": f.law is not None,
        "twins": [name.replace("_", " ") for name in f.indistinguishable],
        "map": Markup(figures.mismatch_map(f, names)),
        "states": [
            (
                Markup(figures.over_state(f, name)),
                f"{100 * f.region.states[name].share:.0f} % of the mismatch and "
                f"{100 * f.region.states[name].occupancy:.0f} % of the samples lie between "
                f"{quantity(f.region.states[name].low, f.region.states[name].unit)} and "
                f"{quantity(f.region.states[name].high, f.region.states[name].unit)}.",
            )
            for name in f.shown
        ],
        "signal": Markup(figures.missing_signal(f, names)) if f.signal is not None else None,
        "intervals": [(name, f"{a:.2f}", f"{b:.2f}") for name, a, b in f.region.intervals[:12]],
        "more": max(len(f.region.intervals) - 12, 0),
    }  # fmt: skip


def _rivals(d: Diagnosis) -> list[list[dict[str, str]]]:
    kept = {effect.name for effect in d.best.effects}
    return [[_rival(one, step, kept) for one in step.contenders] for step in d.path.rounds]


def _rival(one: Contender, step: Round, kept: Collection[str]) -> dict[str, str]:
    taken = one is step.taken
    later = (
        "; taken all the same, with what was missing beside it" if one.why and one.effect.name in kept else ""
    )
    return {
        "name": one.effect.name.replace("_", " "), "error": f"{one.validated.error_over_noise:.3g}",
        "gain": f"{one.validated.windows.sum():.4g}",
        "why": "taken" if taken else one.why + later or "explains less than the one taken",
    }  # fmt: skip


def _row(e: Estimate) -> dict[str, str]:
    state = "not identifiable" if not e.identifiable else "at its bound" if e.at_bound else ""
    return {
        "name": e.name.replace("_", " ").replace(".", ": "), "value": quantity(e.value, e.unit),
        "low": quantity(e.low, e.unit), "high": quantity(e.high, e.unit), "state": state,
    }  # fmt: skip
