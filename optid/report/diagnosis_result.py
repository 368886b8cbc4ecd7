"""A diagnosis as a result: what the diagnosis package holds in memory, as data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from optid.report.diagnosis_document import diagnosis_document
from optid.report.diagnosis_tables import tables_of
from optid.results.diagnosis import DiagnosisResult
from optid.results.with_rig import RIG
from optid.rigs.per_recording import stated
from optid.rigs.rigfile import rig_text

if TYPE_CHECKING:
    from optid.diagnosis.result import Diagnosis
    from optid.effects.effect import Effect


def diagnosis_result(found: Diagnosis) -> DiagnosisResult:
    """The result of a diagnosis as data: document, tables and the improved rig file."""
    rig = found.base.rig
    document = {
        **diagnosis_document(found),
        "about": {
            "rig": rig.name,
            "rig_file": str(rig.path),
            "horizon": found.test.base.horizon,
            "outputs": {port.role: port.unit for port in rig.model.outputs},
            "training": [recording.name for recording in found.problem.train],
            "held_out": list(found.holdout),
            "asked": [one.name for one in rig.freed],
            "effects": [_effect(finding.effect) for finding in found.findings],
        },
    }
    # A parameter that only defines others is not an estimate, and keeps the tried value.
    values = {
        name: value
        for effect in found.best.effects
        for name, value in effect.qualified(found.best.own_values(effect)).items()
    }
    values |= {p.name: p.value for p in found.best_parameters}
    own = stated(found.best.rig, values, [recording.name for recording in found.problem.train])
    files = {RIG: rig_text(found.best.rig, values, own)} if rig.source else {}
    return DiagnosisResult(document, tables_of(found), files)


def _effect(effect: Effect | None) -> dict[str, Any]:
    """The texts of an effect's own file."""
    if effect is None:
        return {}
    return {"law": effect.law, "source": effect.source, "experiment": effect.experiment}
