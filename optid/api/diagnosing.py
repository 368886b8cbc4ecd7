"""`optid.diagnose`: what physics a model leaves out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from optid.api.document import stamp
from optid.api.inputs import Progress, at_their_rate, given, is_nothing, of_each, refuse_unfit, rig_of, silent
from optid.core.budget import Budget
from optid.core.recording_set import Experiments
from optid.diagnosis.pipeline import diagnose as find
from optid.effects.effect import Effect
from optid.effects.library import from_file
from optid.report.diagnosis_result import diagnosis_result
from optid.results.diagnosis import DiagnosisResult
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    from optid.api.inputs import Given, Recordings
    from optid.diagnosis.result import Diagnosis

TIME_LIMIT = 800.0  # s: with much missing, the second of two effects was found after 650 s on one core


def diagnose(
    rig: str | Path | Rig,
    recordings: Recordings,
    holdout: Recordings,
    *,
    validation: Recordings = (),
    effects: Sequence[str | Path | Effect] = (),
    time_limit: float = TIME_LIMIT,
    deadline: float = math.inf,
    rate: float | None = None,
    progress: Progress = silent,
    checkpoint: Path | None = None,
) -> DiagnosisResult:
    """Find the physics that a rig's model leaves out, and prove it on held-out recordings.

    Parameters
    ----------
    rig : str | Path | Rig
        a rig file, or what `read_rig` made of one; its [fit] table says what may be fitted.
    recordings : Recordings
        to fit to: a path, a DataFrame, a Recording, or a list of them.
    holdout : Recordings
        to judge on; the fits never see them.
    validation : Recordings
        further training recordings, on which alone the search judges whether an effect is needed; when absent it
        judges on blocks of all training recordings, predicted with parameters fitted to the other blocks.
    effects : Sequence[str | Path | Effect]
        your own effects, in addition to the catalogue: objects, or files that define them.
    time_limit : float
        s of the process's own time, approximately; the search for effects then stops and keeps its best model.
    deadline : float
        s of wall-clock time, likewise.
    rate : float | None
        Hz to which faster recordings are decimated; by default as fast as the axis's fastest pole needs.
    progress : Progress
        called with the share done and a few words.
    checkpoint : Path | None
        a file that keeps finished stages, so that an interrupted call can continue; none when absent.

    Returns
    -------
    DiagnosisResult
        Verdict, findings, the improved rig file and a report.

    Raises
    ------
    InputError
        an input is wrong, no parameter is to be fitted, or no recording is held out.
    NotIdentifiable
        a recording is unfit for identification.
    SolveError
        the model cannot be simulated at the rig file's values.
    """
    understood = rig_of(rig)
    train, held = given(understood, recordings, holdout, rate)
    judging = [] if is_nothing(validation) else given(understood, validation, rate=rate)[0]
    refuse_unfit([*train, *judging, *held])
    understood = at_their_rate(understood, train)
    Experiments.of([one.recording for one in (*train, *judging, *held)])
    understood, (train, judging, held) = of_each(understood, train, judging, held)
    own: list[Effect] = []
    for effect in effects:
        own += from_file(Path(effect)) if isinstance(effect, (str, Path)) else [effect]
    found = find(
        understood,
        [one.recording for one in (*train, *judging)],
        [one.recording for one in held],
        own=own,
        validation=[one.recording.name for one in judging],
        progress=progress,
        budget=Budget(time_limit, deadline),
        checkpoint=checkpoint,
    )
    return _result(understood, [*train, *judging], held, found)


def _result(rig: Rig, train: Sequence[Given], held: Sequence[Given], found: Diagnosis) -> DiagnosisResult:
    result = diagnosis_result(found)
    paths = {"training": [_path(one) for one in train], "held_out": [_path(one) for one in held]}
    head = stamp(DiagnosisResult.SCHEMA, "diagnose", rig, [one.recording for one in (*train, *held)])
    document = {**head, **result.document, "about": {**result.document["about"], **paths}}
    return DiagnosisResult(document, result.tables, result.files)


def _path(one: Given) -> str:
    source = one.recording.provenance
    return str(source.path) if source else one.recording.name
