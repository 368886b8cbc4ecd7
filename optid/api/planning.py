"""`optid.plan`: the next experiment."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optid.api.document import stamp
from optid.api.inputs import Progress, rig_of, silent
from optid.effects.effect import Effect
from optid.effects.library import from_file
from optid.errors import InputError
from optid.experiments.design import design
from optid.experiments.files import Planned, document, table
from optid.experiments.loop import Loop, refuse_endless, refuse_unfit
from optid.experiments.rivals import from_diagnosis, named
from optid.live.gains import controller_settings, gentle, read_gains
from optid.live.settings import live_settings
from optid.results.diagnosis import DiagnosisResult
from optid.results.plan import EXPERIMENT, PlanResult
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    import pandas as pd


def plan(
    rig: str | Path | Rig,
    rivals: str | Sequence[str] | DiagnosisResult | Path,
    *,
    seconds: float = 12.0,
    rate: float | None = None,
    gains: str | None = None,
    effects: Sequence[str | Path] = (),
    seed: int = 0,
    progress: Progress = silent,
) -> PlanResult:
    """Design the experiment that best distinguishes rival effects: a reference within stroke and limits.

    Parameters
    ----------
    rig : str | Path | Rig
        a rig file with [live] limits, or what `read_rig` made of one.
    rivals : str | Sequence[str] | DiagnosisResult | Path
        names of effects to distinguish, or of one effect to detect; or a diagnosis (its result, folder or file) that
        left effects open.
    seconds : float
        duration of the experiment, s.
    rate : float | None
        samples a second; the rig file's when absent.
    gains : str | None
        a pid.json, or "kp=40 ki=60"; cautious gains when absent.
    effects : Sequence[str | Path]
        files with your own effects.
    seed : int
        seed of all random numbers.
    progress : Progress
        called with the share done and a few words.

    Returns
    -------
    PlanResult
        the reference, and the separation of the rivals by it.

    Raises
    ------
    InputError
        an unknown effect, no limits, or too few samples.
    SolveError
        no reference stays within the stroke limits.
    """
    understood = rig_of(rig)
    refuse_unfit(understood)
    settings = live_settings(understood, rate)
    refuse_endless(understood, settings)
    found, pid = read_gains(gains, settings) if gains else (gentle(settings.limits), None)
    loop = Loop(understood, settings, found, controller_settings(settings, pid))
    own = [effect for file in effects for effect in from_file(Path(file))]
    chosen = _rivals(understood, rivals, own)
    planned = Planned(loop, design(loop, chosen, seconds, np.random.default_rng(seed), progress), seed)
    return result_of(planned)


def result_of(planned: Planned) -> PlanResult:
    """A plan as a result."""
    rig = planned.loop.rig
    content = document(planned)
    laws = {effect.name: effect.law for effect in planned.design.rivals}
    content["rivals"] = [{**entry, "law": laws[entry["effect"]]} for entry in content["rivals"]]
    head = stamp(PlanResult.SCHEMA, "plan", rig, ())
    about = {"rig_file": str(rig.path), "starts": list(planned.design.starts)}
    return PlanResult(
        {**head, **content, "about": about},
        {"experiment": _experiment(planned)},
        {EXPERIMENT: table(planned)},
    )


def _experiment(planned: Planned) -> pd.DataFrame:
    import pandas as pd

    loop, run = planned.loop, planned.design.run
    return pd.DataFrame(
        {
            "time": loop.settings.span * np.arange(len(run.command)),
            "reference": run.reference,
            "position": loop.position(run),
            "command": run.command,
        }
    )


def _rivals(rig: Rig, rivals: Any, own: list[Effect]) -> tuple[Effect, ...]:
    if isinstance(rivals, DiagnosisResult):
        import tempfile

        with tempfile.TemporaryDirectory() as place:
            return named(from_diagnosis(rivals.save(place)), rig, own, "--diagnosis")
    if isinstance(rivals, Path):
        return named(from_diagnosis(rivals), rig, own, "--diagnosis")
    names = [name.strip() for name in rivals.split(",")] if isinstance(rivals, str) else list(rivals)
    if not names:
        raise InputError("none is given", field="rivals", expected="names of effects, or a diagnosis")
    return named(names, rig, own)
