"""The content of diagnosis.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from optid.diagnosis.localisation.region import Range
from optid.diagnosis.result import Diagnosis, Finding
from optid.estimation.result import Estimate, Score
from optid.report.scores import number

SCHEMA = "optid.diagnosis/1"


def diagnosis_document(d: Diagnosis) -> dict[str, Any]:
    """The document of a diagnosis, as its schema defines it."""
    return {
        "schema": SCHEMA,
        "verdict": d.verdict.value,
        "summary": d.summary,
        "baseline": {"parameters": _parameters(d.base_parameters), "holdout": _scores(d.test.base.scores)},
        "improved": {"parameters": _parameters(d.best_parameters), "holdout": _scores(d.test.best.scores)},
        "noise_floor": {role: {"rmse": number(sd), "unit": _unit(d, role)} for role, sd in d.noise.items()},
        "findings": [_finding(d, f) for f in d.findings],
        "test": _test(d),
        "rejected": [{"effect": name, "why": why} for name, why in d.rejected],
        "not_testable": [
            {"effect": name, "why": why, "smallest_visible": smallest}
            for name, why, smallest in d.not_testable
        ],
        "residual_after": {
            "white": d.test.residuals.white,
            "independent_of_input": d.test.residuals.independent,
            "p_white": number(d.test.residuals.whiteness),
            "p_independent": number(d.test.residuals.independence),
        },
    }


def _test(d: Diagnosis) -> dict[str, Any]:
    """The test of the whole answer on the held-out recordings: is anything missing at all?"""
    return {
        "p_value": number(d.test.p_value),
        "level": d.test.level,
        "error_over_noise": number(d.test.error_over_noise),
        "recordings": list(d.holdout),
    }


def _unit(d: Diagnosis, role: str) -> str:
    return next(port.unit for port in d.best.rig.model.outputs if port.role == role)


def _unit_at(d: Diagnosis, place: str) -> str:
    """SI unit of the signal at a site, as the plant states it; "" where it states none."""
    model = d.base.rig.model
    return dict(zip(model.sites, model.site_units, strict=True)).get(place, "")


def _parameters(estimates: Sequence[Estimate]) -> dict[str, Any]:
    return {
        e.name: {"value": number(e.value), "unit": e.unit, "ci95": [number(e.low), number(e.high)]}
        for e in estimates
    }


def _scores(scores: Mapping[str, Score]) -> dict[str, Any]:
    return {
        role: {"fit_percent": number(s.fit_percent), "rmse": number(s.rmse), "unit": s.unit}
        for role, s in scores.items()
    }


def _finding(d: Diagnosis, f: Finding) -> dict[str, Any]:
    return {
        "effect": None if f.effect is None else f.effect.name,
        "site": f.site,
        "place": f.place,
        "unit": _unit_at(d, f.place),
        "equation": "" if f.effect is None else f.effect.equation,
        "sentence": f.sentence,
        "parameters": _parameters(f.parameters),
        "where": {
            "channels": list(f.region.channels),
            "intervals": [[name, number(a), number(b)] for name, a, b in f.region.intervals],
            "states": {name: range_entry(f.region.states[name]) for name in f.shown},
        },
        "evidence": {
            "holdout_fit_gain": number(f.evidence.fit_gain),
            "p_value": number(f.evidence.p_value),
            "delta_bic": number(f.delta_bic),
        },
        "selection": {"cross_validated_gain": number(f.train_gain)},
        "suspected": [{"effect": one.effect, "why": one.why} for one in f.suspected],
        "indistinguishable_from": list(f.indistinguishable),
    }


def range_entry(r: Range) -> dict[str, Any]:
    """A range of a signal, its shares, and whether the law singles it out."""
    return {
        "low": number(r.low),
        "high": number(r.high),
        "unit": r.unit,
        "share_of_mismatch": number(r.share),
        "share_of_samples": number(r.occupancy),
        "by_law": r.by_law,
    }
