"""From recordings of a servo axis to a model you can trust.

    import optid

    rig = optid.read_rig("bench.toml")
    result = optid.fit(rig, "run1.csv", holdout="run2.csv")
    result.plot()

Every name below is imported when it is first used, so that `import optid` costs next to nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from optid.results.views import register

if TYPE_CHECKING:
    from optid import datasets, laws
    from optid.api.casadi_view import CasadiFunctions
    from optid.api.checking import check
    from optid.api.control_view import from_control
    from optid.api.diagnosing import diagnose
    from optid.api.document import version
    from optid.api.fitting import fit, profile
    from optid.api.fmu import export_fmu
    from optid.api.identifying import identify
    from optid.api.planning import plan
    from optid.api.simulating import simulate
    from optid.api.tuning import tune
    from optid.core.linearise import linearise
    from optid.core.model import Model
    from optid.core.parameter import Parameter
    from optid.core.readers import read_recording
    from optid.core.recording import Recording
    from optid.core.sheet import Sheet, build
    from optid.diagnosis.finding import Verdict
    from optid.effects.effect import Effect
    from optid.errors import InputError, JobError, OptidError
    from optid.estimation.result import Outcome
    from optid.live.driver import Driver
    from optid.results.check import CheckResult
    from optid.results.diagnosis import DiagnosisResult, Finding
    from optid.results.fit import FitResult, ProfileResult
    from optid.results.identification import IdentificationResult
    from optid.results.loading import load
    from optid.results.plan import PlanResult
    from optid.results.result import Result
    from optid.results.simulation import SimulationResult
    from optid.results.tuning import TuningResult
    from optid.rigs.rigfile import Rig, read_rig, write_rig

    __version__: str

# Public name -> the module that holds it.
_HOMES = {
    **dict.fromkeys(("read_rig", "write_rig", "Rig"), "optid.rigs.rigfile"),
    "read_recording": "optid.core.readers",
    "Recording": "optid.core.recording",
    "check": "optid.api.checking",
    "simulate": "optid.api.simulating",
    **dict.fromkeys(("fit", "profile"), "optid.api.fitting"),
    "diagnose": "optid.api.diagnosing",
    "identify": "optid.api.identifying",
    "tune": "optid.api.tuning",
    "plan": "optid.api.planning",
    "load": "optid.results.loading",
    **dict.fromkeys(("build", "Sheet"), "optid.core.sheet"),
    "Model": "optid.core.model",
    "Parameter": "optid.core.parameter",
    "Effect": "optid.effects.effect",
    "Driver": "optid.live.driver",
    "linearise": "optid.core.linearise",
    "from_control": "optid.api.control_view",
    "export_fmu": "optid.api.fmu",
    "CasadiFunctions": "optid.api.casadi_view",
    "Verdict": "optid.diagnosis.finding",
    "Outcome": "optid.estimation.result",
    **dict.fromkeys(("OptidError", "InputError", "JobError"), "optid.errors"),
    "Result": "optid.results.result",
    "CheckResult": "optid.results.check",
    "SimulationResult": "optid.results.simulation",
    **dict.fromkeys(("FitResult", "ProfileResult"), "optid.results.fit"),
    **dict.fromkeys(("DiagnosisResult", "Finding"), "optid.results.diagnosis"),
    "IdentificationResult": "optid.results.identification",
    "TuningResult": "optid.results.tuning",
    "PlanResult": "optid.results.plan",
}
_MODULES = ("datasets", "laws")

__all__ = [*_HOMES, *_MODULES, "__version__"]  # noqa: PLE0604

for _kind in ("check", "simulation", "fit", "profile", "diagnosis", "plan"):
    register(f"optid.{_kind}/1", f"optid.report.views.{_kind}")
register("optid.armax/1", "optid.report.views.identification")
register("optid.pid/1", "optid.report.views.tuning")


def __getattr__(name: str) -> Any:
    """Import a public name when it is first asked for."""
    if name == "__version__":
        from optid.api.document import version

        value: Any = version()
    elif name in _HOMES:
        value = getattr(importlib.import_module(_HOMES[name]), name)
    elif name in _MODULES:
        value = importlib.import_module(f"optid.{name}")
    else:
        raise AttributeError(f"module 'optid' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
