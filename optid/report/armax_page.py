"""The report of `optid identify`: a self-contained HTML file."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from markupsafe import Markup

from optid.armax.candidate import Candidate
from optid.armax.frequency import measured_response
from optid.armax.model import Armax
from optid.armax.offline import names
from optid.armax.physical import physical_poles
from optid.armax.prediction import innovations
from optid.armax.resample import Sampled
from optid.armax.survey import Survey
from optid.armax.table2 import CAPTIONS, Table2
from optid.armax.words import number
from optid.core.quantity import friendly
from optid.core.recording import Recording
from optid.quality.remark import Remark
from optid.report import armax_figures as figures
from optid.report import armax_response_figures as responses
from optid.report.shell import render
from optid.rigs.rigfile import Rig

FEW = 3.0  # standard errors by which a mean differs from zero


@dataclass(frozen=True, eq=False)
class Source:
    """The source of the data: the rig, the recording, and the remarks of the check."""

    rig: Rig
    recording: Recording
    remarks: tuple[Remark, ...]


def armax_page(found: Survey, sampled: Sampled, source: Source, folder: str = "out/armax") -> str:
    """The page of a survey; `folder` is where its model is written, for the next command."""
    factor, unit = friendly(sampled.output_unit)
    table = found.table2.in_unit(unit or "1", factor)
    model, name = found.chosen.model, sampled.output.replace("_", " ")
    groups = [[pair for pair in table.traces if pair[1] == 1], _horizons(table)]
    e = innovations(model, sampled.signals.y, sampled.signals.u, estimated_start=True)
    poles, taken = physical_poles(source.rig, source.recording, sampled.output, model)
    models = [candidate.model for candidate in found.candidates]
    return render(
        "armax.html.j2",
        title=f"{source.rig.name}: ARMAX of {name} from {_listed(sampled)}",
        rig=source.rig,
        found=found,
        source=source,
        sampled=sampled,
        table=table,
        captions=table.captions(),
        cells=_cells(table),
        equation=equation(model),
        coefficients=_coefficients(model),
        chosen=found.chosen,
        noise=f"{math.sqrt(model.noise_variance) * factor:.4g} {unit}".rstrip(),
        figures=[
            Markup(figures.responses(table, sampled.time, g, name))
            for g in groups
            if len(g) > 1 or g[0][1] == 1
        ],
        path=Markup(figures.path(found.chosen.recursive, float(sampled.time[0]))),
        correlations=Markup(figures.correlations(e, sampled.signals.u, sampled.sample_time, sampled.inputs)),
        bodes=[_bode(models, sampled, i, source.recording, factor, unit) for i in range(len(sampled.inputs))],
        poles=poles,
        taken=taken,
        number=number,
        z_map=Markup(responses.pole_zero_map(found.candidates, poles)),
        steps=[
            Markup(responses.steps(models, _per(unit, sampled, i), factor, i))
            for i in range(len(sampled.inputs))
        ],
        orders=_orders(found),
        unknowns=_unknowns(found, sampled, source.recording, e),
        next_command=f"optid tune {folder}/armax.json --rig {source.rig.path} --out out/tune",
    )


def _per(unit: str, sampled: Sampled, input: int) -> str:
    over = sampled.input_units[input]
    return f"{unit or '1'}/{over}" if over not in ("", "1") else unit


def _bode(
    models: list[Armax], sampled: Sampled, input: int, recording: Recording, factor: float, unit: str
) -> Markup:
    """The measured response and the models'; estimated from the reference where one was recorded."""
    reference = None
    if "reference" in recording and len(recording) == sampled.time.size:
        reference = recording["reference"].values
    measured = measured_response(sampled.signals, sampled.sample_time, input, reference)
    if measured is not None:
        measured = replace(measured, response=factor * measured.response)
    scaled = [replace(m, b=tuple(tuple(factor * x for x in b) for b in m.b)) for m in models]
    return Markup(responses.bode(scaled, measured, _per(unit, sampled, input), input))


def equation(model: Armax) -> str:
    """The difference equation in one line."""
    terms = [("y", -a, k) for k, a in enumerate(model.a[1:], start=1)]
    for i, (b, nk) in enumerate(zip(model.b, model.nk, strict=True)):
        terms += [("u" if len(model.b) == 1 else f"u{i + 1}", x, nk + k) for k, x in enumerate(b)]
    terms += [("e", c, k) for k, c in enumerate(model.c)]
    said = []
    for signal, x, lag in terms:
        when = f"{signal}(t−{lag})" if lag else f"{signal}(t)"
        size = "" if signal == "e" and lag == 0 else f"{abs(x):.5g} "
        said.append(f"{'−' if x < 0 else '+'} {size}{when}")
    return f"y(t) = {' '.join([*said, *_trend_terms(model)]).removeprefix('+ ')}"


def _trend_terms(model: Armax) -> list[str]:
    """Constant and slope, t being seconds from the recording's first sample."""
    parts = (("", model.constant), (" t", model.slope))
    return [f"{'−' if x < 0 else '+'} {abs(x):.5g}{what}" for what, x in parts if x]


def _listed(sampled: Sampled) -> str:
    return ", ".join(role.replace("_", " ") for role in sampled.inputs)


def _horizons(table: Table2) -> list[tuple[int, int]]:
    """The experiments of the order that was predicted over several horizons."""
    many = [order for order, steps in table.traces if steps > 1]
    return [pair for pair in table.traces if pair[0] in many[:1]] or list(table.traces)[:1]


def _cells(table: Table2) -> list[list[str]]:
    return [[_cell(row[column]) for column in CAPTIONS] for row in table.rows]


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.4g}"
    return str(value)


def _coefficients(model: Armax) -> list[tuple[str, str, str]]:
    rows = [*zip(names(model.orders), model.theta, model.standard_errors, strict=True)]
    trend = zip(("constant", "slope"), (model.constant, model.slope), model.trend_errors, strict=True)
    rows += [row for row in trend if row[1]]
    return [(name, f"{x:.6g}", _error(sd)) for name, x, sd in rows]


def _error(sd: float) -> str:
    if math.isnan(sd):
        return "unknown"
    return "not determined" if math.isinf(sd) else f"{sd:.2g}"


def _orders(found: Survey) -> list[dict[str, str | bool]]:
    rows: list[dict[str, str | bool]] = []
    for row in found.orders.rows:
        o = row.orders
        rows.append(
            {
                "chosen": o == found.orders.recommended,
                "order": str(o.na),
                "delay": str(o.nk[0]) if o.nk else "",
                "parameters": str(o.parameters),
                "aic": f"{row.aic:.1f}",
                "bic": f"{row.bic:.1f}",
                "fpe": f"{row.fpe:.4g}",
                "one": _percent(row.fit_one_step),
                "ten": _percent(row.fit_ten_steps),
                "simulated": _percent(row.fit_simulated),
            }
        )
    return rows


def _percent(value: float) -> str:
    return f"{value:.2f}" if value > -1000.0 else "diverges"


def _unknowns(found: Survey, sampled: Sampled, recording: Recording, e: Any) -> list[str]:
    """What the models do not know."""
    said = []
    if "reference" in recording:
        said.append(
            "Whether the input acts on the output alone: a reference was recorded, so a controller may have closed "
            "the loop. Then the model is right only if its noise model is: read the residual tests first."
        )
    if not all(map(_white, found.candidates)):
        said.append(
            "Why the residuals of some models are not white or depend on the input: a linear model of this order "
            "lacks something there (friction, choked flow and the stroke are not linear), and its "
            "standard errors are too small."
        )
    mean, count = float(np.nanmean(e)), int(np.isfinite(e).sum())
    error = float(np.nanstd(e)) / math.sqrt(max(count, 1))
    factor, unit = friendly(sampled.output_unit)
    if abs(mean) > FEW * error:
        said.append(
            f"Why the residuals of the recommended model have a mean of {mean * factor:.3g} ± {error * factor:.1g} "
            f"{unit}: the operating point moved, or the model has no constant."
        )
    low, high = (f(sampled.signals.y) * factor for f in (np.nanmin, np.nanmax))
    said.append(
        f"Anything outside the {sampled.output.replace('_', ' ')} this recording visits, {low:.4g} to "
        f"{high:.4g} {unit}, and any other operating point: the models are linear."
    )
    return said


def _white(candidate: Candidate) -> bool:
    tests = candidate.audit.residuals
    return tests is not None and tests.white and tests.independent
