"""`optid.tune`: PID gains for an identified model."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optid.api.document import version
from optid.api.inputs import Progress, rig_of, silent
from optid.armax.files import ArmaxFile
from optid.armax.files import load as load_models
from optid.core.paths import digest_of
from optid.errors import SolveError
from optid.pid.controller import Notch
from optid.report.tuning_page import tuning_page
from optid.results.identification import IdentificationResult
from optid.results.tuning import TuningResult
from optid.rigs.rigfile import Rig
from optid.tuning.bench_search import Effort
from optid.tuning.compensation import compensated
from optid.tuning.criterion import Criterion
from optid.tuning.files import document
from optid.tuning.integral_criteria import Measure
from optid.tuning.margins import Required
from optid.tuning.optimise import Options
from optid.tuning.problem import build_problem
from optid.tuning.specification import TuningSpec
from optid.tuning.structures import free_gains, structure_of
from optid.tuning.tuning import Tuning
from optid.tuning.tuning import tune as optimise

if TYPE_CHECKING:
    import pandas as pd


def tune(
    model: str | Path | ArmaxFile | IdentificationResult,
    *,
    rig: str | Path | Rig | None = None,
    setpoints: Sequence[float] = (),
    limits: tuple[float, float] | None = None,
    rate: float | None = None,
    cost: str = "itae",
    sensitivity: float | None = None,
    structure: str | None = None,
    notch: tuple[float, float, float] | None = None,
    acceleration: float = 0.0,
    compensate: bool = False,
    free: Sequence[str] | None = None,
    starts: int = 4,
    seed: int = 0,
    progress: Progress = silent,
) -> TuningResult:
    """Find PID gains by optimising the closed loop itself, under the actuator's limits.

    Parameters
    ----------
    model : str | Path | ArmaxFile | IdentificationResult
        an armax.json, what `identify` returned, or what `from_control` made of a system.
    rig : str | Path | Rig | None
        rig file of the axis: its physical model is used for tuning and for the test.
    setpoints : Sequence[float]
        sizes of steps from rest, the output's SI unit; a size that suits the model when absent.
    limits : tuple[float, float] | None
        lower and upper limit of the command, its SI unit.
    rate : float | None
        largest change of the command per second.
    cost : str
        "itae", "iae", "itse" or "ise".
    sensitivity : float | None
        largest maximum sensitivity Ms; infinite for no bound; when absent, a usual value for the plant that judges the
        gains.
    structure : str | None
        "pid", "pid2", "pd", "pi", "p" or "p-pi"; chosen for the plant when absent.
    notch : tuple[float, float, float] | None
        of the command: frequency and width, Hz, and its gain at the frequency, 0 to 1.
    acceleration : float
        feed-forward: command per acceleration of the set-point, SI.
    compensate : bool
        let the controller compensate the dead band and the dry friction of the rig's model.
    free : Sequence[str] | None
        names of the gains to optimise; the structure's when absent.
    starts : int
        number of independent searches.
    seed : int
        seed of all random numbers.
    progress : Progress
        called with the share done and a few words.

    Returns
    -------
    TuningResult
        gains, costs, baselines and margins.

    Raises
    ------
    InputError
        the model or an option is wrong.
    SolveError
        no gains meet the requirements, or none stabilise the model.
    """
    contents, source = _contents(model)
    low, high = limits or (None, None)
    spec = TuningSpec(
        setpoints=tuple(setpoints),
        low=low,
        high=high,
        rate=rate,
        criterion=Criterion(Measure[cost.upper()]),
        required=Required(sensitivity if sensitivity is not None and math.isfinite(sensitivity) else None),
        notch=None if notch is None else Notch(2.0 * math.pi * notch[0], 2.0 * math.pi * notch[1], notch[2]),
        acceleration=acceleration,
        compensate=compensate,
        usual_sensitivity=sensitivity is None,
    )
    known = None if rig is None else rig_of(rig)
    rng = np.random.default_rng(seed)
    problem = build_problem(contents, source, spec, rng, known, known is not None)
    chosen = structure_of(structure or problem.structure)
    moved = free_gains(chosen, problem.task.bench_alone) if free is None else tuple(free)
    options = Options(moved, starts=starts, cascade=chosen.cascade, effort=Effort(progress))
    try:
        found = optimise(problem.task, rng, options, problem.bench)
    except SolveError:
        if sensitivity is not None:
            raise
        problem = problem.without_sensitivity()
        found = optimise(problem.task, rng, options, problem.bench)
    if compensate and known is not None:
        found = compensated(found, known, contents.output)
    content = {
        **document(found, problem.command_unit, problem.output_unit, problem.judged_on, chosen),
        "version": version(),
        "command": "tune",
        "inputs": {str(source): digest_of(source)},
    }
    tables = {"responses": _responses(found), "loop": _plant(found)}
    return TuningResult(content, tables, {"report.html": tuning_page(found, problem, source.name, chosen)})


def _contents(model: Any) -> tuple[ArmaxFile, Path]:
    if isinstance(model, IdentificationResult):
        return model.contents, Path(model.FILE)
    if isinstance(model, ArmaxFile):
        return model, Path("model")
    return load_models(Path(model)), Path(model)


def _responses(found: Tuning) -> pd.DataFrame:
    import pandas as pd

    dt = found.settings.sample_time
    parts = [
        pd.DataFrame(
            {
                "episode": run.episode.name,
                "time": dt * np.arange(len(run.output)),
                "reference": run.episode.reference,
                "output": run.output,
                "command": run.command,
            }
        )
        for run in found.found.responses
    ]
    return pd.concat(parts, ignore_index=True)


def _plant(found: Tuning) -> pd.DataFrame:
    import pandas as pd

    plant = found.task.plant
    return pd.DataFrame({"numerator": np.r_[0.0, plant.b], "denominator": np.r_[1.0, plant.a]})
