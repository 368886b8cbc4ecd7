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
    from optid import datasets as datasets
    from optid import fleet as fleet
    from optid import laws as laws
    from optid.api.checking import check as check
    from optid.api.control_view import from_control as from_control
    from optid.api.diagnosing import diagnose as diagnose
    from optid.api.fitting import fit as fit
    from optid.api.fitting import profile as profile
    from optid.api.fmu import export_fmu as export_fmu
    from optid.api.identifying import identify as identify
    from optid.api.planning import plan as plan
    from optid.api.simulating import simulate as simulate
    from optid.api.tuning import tune as tune
    from optid.core.casadi_functions import CasadiFunctions as CasadiFunctions
    from optid.core.linearise import linearise as linearise
    from optid.core.model import Model as Model
    from optid.core.parameter import Parameter as Parameter
    from optid.core.readers import read_recording as read_recording
    from optid.core.recording import Recording as Recording
    from optid.core.sheet import Sheet as Sheet
    from optid.core.sheet import build as build
    from optid.effects.effect import Effect as Effect
    from optid.errors import InputError as InputError
    from optid.errors import JobError as JobError
    from optid.errors import OptidError as OptidError
    from optid.estimation.result import Outcome as Outcome
    from optid.live.driver import Driver as Driver
    from optid.results.check import CheckResult as CheckResult
    from optid.results.diagnosis import DiagnosisResult as DiagnosisResult
    from optid.results.diagnosis import Finding as Finding
    from optid.results.diagnosis import Verdict as Verdict
    from optid.results.fit import FitResult as FitResult
    from optid.results.fit import ProfileResult as ProfileResult
    from optid.results.fleet import FleetResult as FleetResult
    from optid.results.identification import IdentificationResult as IdentificationResult
    from optid.results.loading import load as load
    from optid.results.plan import PlanResult as PlanResult
    from optid.results.result import Result as Result
    from optid.results.simulation import SimulationResult as SimulationResult
    from optid.results.tuning import TuningResult as TuningResult
    from optid.rigs.rigfile import Rig as Rig
    from optid.rigs.rigfile import read_rig as read_rig
    from optid.rigs.rigfile import write_rig as write_rig

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
    "CasadiFunctions": "optid.core.casadi_functions",
    "Verdict": "optid.results.diagnosis",
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
    "FleetResult": "optid.results.fleet",
}
_MODULES = ("datasets", "fleet", "laws")

__all__ = [*_HOMES, *_MODULES, "__version__"]

for _kind in ("check", "simulation", "fit", "profile", "diagnosis", "plan", "fleet"):
    register(f"optid.{_kind}/1", f"optid.report.views.{_kind}")
register("optid.armax/1", "optid.report.views.identification")
register("optid.pid/1", "optid.report.views.tuning")


if not TYPE_CHECKING:  # a type checker knows the names, and tells those that are not there

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
