"""One HTML file that stands alone: what was fitted, how well it predicts, and what it does not know."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from optid.core.recording import Recording
from optid.estimation.prediction import Prediction
from optid.estimation.profile import Profile
from optid.estimation.result import Estimate, Fit
from optid.quality.remark import Remark
from optid.report import figures
from optid.report.scores import KINDS, friendly, pooled, residual, score_rows
from optid.rigs.rigfile import Rig

_WHITE = 0.1  # share of lags outside the 95 % band above which residuals are called coloured


@dataclass(frozen=True, eq=False)
class Exhibit:
    """One recording as a report shows it.

    Attributes:
        use: "training", "held out" or "simulated".
        recording: as read.
        prediction: of that recording.
        remarks: of the check.
    """

    use: str
    recording: Recording
    prediction: Prediction
    remarks: tuple[Remark, ...]


def simulation_page(rig: Rig, exhibit: Exhibit) -> str:
    """The report of `optid simulate`."""
    return _render(
        rig, f"{rig.name}: simulation of {exhibit.recording.name}", [exhibit],
        unknowns=_about_data([exhibit], rig), lead="The numbers are the rig file's: nothing was fitted.",
    )  # fmt: skip


def fit_page(rig: Rig, fit: Fit, exhibits: Sequence[Exhibit], profiles: Sequence[Profile] = ()) -> str:
    """The report of `optid fit`."""
    names = [one.recording.name for one in exhibits if one.use == "training"]
    frame = fit.certificate.frame
    frame = frame.assign(
        recording=[names[n] if isinstance(n, int) else n for n in frame["recording"].tolist()]
    )
    return _render(
        rig, f"{rig.name}: fit", exhibits,
        lead=f"{fit.outcome.value} {_in_short(exhibits)}",
        fit=fit, parameters=[_row(estimate) for estimate in fit.parameters],
        profiles=[(p.sentence, Markup(figures.profile(p))) for p in profiles],
        certificate=Markup(figures.certificate(frame)) if len(frame) else None,
        nodes=len(frame), sound=int(np.asarray(frame["sound"], dtype=bool).sum()),
        unknowns=[*_about_fit(fit, exhibits), *_about_data(exhibits, rig)],
    )  # fmt: skip


def _render(rig: Rig, title: str, exhibits: Sequence[Exhibit], **more: Any) -> str:
    fit: Fit | None = more.get("fit")
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.ChainableUndefined,
    )  # fmt: skip
    shown = [_exhibit(one, rig, fit) for one in exhibits]
    tables = []
    for use in dict.fromkeys(one.use for one in exhibits):
        predictions = [one.prediction for one in exhibits if one.use == use]
        scores = {kind: score_rows(pooled(predictions, kind)) for kind in KINDS}
        rows = [
            (a[0], a[1], a[2], b[1], b[2]) for a, b in zip(scores["window"], scores["free_run"], strict=True)
        ]
        tables.append((use, rows))
    return environment.get_template("report.html.j2").render(
        title=title, rig=rig, exhibits=shown, tables=tables, horizon=f"{_horizon(exhibits):g}", **more
    )


def _exhibit(one: Exhibit, rig: Rig, fit: Fit | None) -> dict[str, Any]:
    roles = list(one.prediction.scores["window"])
    inputs = [port.role for port in rig.model.recorded if port.role in one.recording]
    source = one.recording.provenance
    return {
        "name": one.recording.name, "use": one.use, "remarks": one.remarks,
        "samples": len(one.recording), "duration": one.recording.duration, "rate": one.recording.rate,
        "sha256": source.sha256 if source else None, "notes": source.notes if source else (),
        "channels": [
            {
                "role": role,
                "overlay": Markup(figures.overlay(one.recording, one.prediction, role, inputs)),
                "residuals": Markup(figures.residuals(
                    one.recording, one.prediction, role,
                    fit.noise.get(role) if fit else one.recording[role].sd,
                )),
            }
            for role in roles
        ],
    }  # fmt: skip


def _in_short(exhibits: Sequence[Exhibit]) -> str:
    """What matters first: how well it predicts what it has not seen, or at least what it has."""
    unseen = [one.prediction for one in exhibits if one.use == "held out"]
    scores = score_rows(pooled(unseen or [one.prediction for one in exhibits], "window"))
    what = "held-out data" if unseen else "the data it was fitted to"
    return f"{_horizon(exhibits):g} s ahead on {what}: " + ", ".join(
        f"{role.replace('_', ' ')} to {rmse} rms ({percent})" for role, percent, rmse in scores
    ) + "."  # fmt: skip


def _horizon(exhibits: Sequence[Exhibit]) -> float:
    return max(one.prediction.horizon for one in exhibits)


def _row(estimate: Estimate) -> dict[str, str]:
    state = "not identifiable" if not estimate.identifiable else "at its bound" if estimate.at_bound else ""
    factor, shown = _readable(estimate)
    known = not state and np.isfinite([estimate.low, estimate.high]).all()
    half = (estimate.high - estimate.low) / 2
    return {
        "name": estimate.name.replace("_", " "), "unit": shown, "state": state,
        "value": f"{estimate.value * factor:.5g}", "start": f"{estimate.start * factor:.5g}",
        "interval": _interval(estimate, factor),
        "share": f"{100 * half / abs(estimate.value):.2g} %" if known and estimate.value else "",
    }  # fmt: skip


def _interval(estimate: Estimate, factor: float) -> str:
    """In words; of an estimate at its bound, the end that the data know."""
    low, high = (f"{end * factor:.5g}" if np.isfinite(end) else None for end in (estimate.low, estimate.high))
    if low and high and estimate.identifiable:
        return f"{low} to {high}"
    return (
        f"at most {high}"
        if high and estimate.at_bound
        else f"at least {low}"
        if low and estimate.at_bound
        else "–"
    )


def _readable(estimate: Estimate) -> tuple[float, str]:
    """Factor and unit in which a value reads without powers of ten, where its unit has such names."""
    small = {"m": ((1e3, "mm"), (1e6, "µm")), "s": ((1e3, "ms"), (1e6, "µs"))}.get(estimate.unit, ())
    size = max(abs(end) for end in (estimate.value, estimate.high) if np.isfinite(end))
    for factor, unit in small:
        if size * factor >= 0.1:
            return factor, unit
    if small and size > 0:
        return small[-1]
    return (
        friendly(estimate.unit)
        if estimate.unit == "Pa"
        else (1.0, "" if estimate.unit == "1" else estimate.unit)
    )


def _about_fit(fit: Fit, exhibits: Sequence[Exhibit]) -> list[str]:
    said = []
    if fit.outcome.name.lower() != "converged":
        said.append(f"Whether better values exist: the fit did not converge. {fit.outcome.value}")
    for p in fit.parameters:
        if not p.identifiable:
            said.append(f"{p.name}: these recordings do not determine it; the value is as good as its start.")
        elif p.at_bound:
            said.append(
                f"{p.name}: it stands at its bound; the data ask for more, or the model is wrong there."
            )
    said.extend(fit.ties)
    if not any(one.use == "held out" for one in exhibits):
        said.append("How it predicts what it has not seen: no recording was held out.")
    return said


def _about_data(exhibits: Sequence[Exhibit], rig: Rig) -> list[str]:
    said = []
    for one in exhibits:
        for role in one.prediction.scores["window"]:
            _, values, band = figures.autocorrelation(residual(one.prediction, role, "window"))
            share = float(np.mean(np.abs(values) > band)) if values.size else 0.0
            if share > _WHITE:
                said.append(
                    f"Why the window residuals of {role} in {one.recording.name} are not white: "
                    f"{100 * share:.0f} % of their autocorrelation lies outside the 95 % band. "
                    "The model lacks something, or the windows start from a state that is a little off."
                )
    seen = [one for one in exhibits if one.use != "held out"]
    for role in [*(port.role for port in rig.model.outputs), *(port.role for port in rig.model.recorded)]:
        holders = [one.recording[role] for one in seen if role in one.recording]
        if holders:
            low = min(float(np.nanmin(c.recorded)) for c in holders)
            high = max(float(np.nanmax(c.recorded)) for c in holders)
            factor, unit = friendly(holders[0].recorded_unit)
            said.append(f"Anything outside the {role} these recordings visit: "
                        f"{low * factor:.4g} to {high * factor:.4g} {unit}".rstrip() + ".")  # fmt: skip
        elif role in {port.role for port in rig.model.outputs}:
            said.append(f"{role}: it was not measured, so the model's idea of it is untested.")
    return said
