"""`optid.identify`: ARMAX models of a recording."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optid.api.document import stamp
from optid.api.inputs import Progress, given, rig_of, silent
from optid.armax.files import from_survey, to_json
from optid.armax.plan import Plan
from optid.armax.resample import Sampled, resample
from optid.armax.sliding import axis_shown
from optid.armax.survey import survey
from optid.core.recording import Recording
from optid.errors import NotIdentifiable
from optid.report.armax_page import Source, armax_page
from optid.results.identification import TABLE2, IdentificationResult
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    from optid.api.inputs import Data


def identify(
    recording: Data,
    rig: str | Path | Rig,
    *,
    orders: Sequence[int] = (3, 4, 5),
    steps: Sequence[int] = (1, 5, 10),
    delay: int | tuple[int, ...] | None = None,
    inputs: Sequence[str] = (),
    output: str | None = None,
    rate: float | None = None,
    progress: Progress = silent,
) -> IdentificationResult:
    """Identify ARMAX models, check them, and tabulate their prediction errors as in the paper's Table 2.

    Parameters
    ----------
    recording : Data
        a path, a DataFrame, or a Recording.
    rig : str | Path | Rig
        a rig file, or what `read_rig` made of one: says which column is what.
    orders : Sequence[int]
        na = nb = nc of each model.
    steps : Sequence[int]
        horizons of the predictions, samples.
    delay : int | tuple[int, ...] | None
        samples, one for all inputs or one for each; chosen when absent.
    inputs : Sequence[str]
        roles of the inputs; the plant's when absent.
    output : str | None
        role of the output; the plant's first measured one when absent.
    rate : float | None
        Hz to which a faster recording is decimated; by default as fast as the axis's fastest pole needs.
    progress : Progress
        called with the share done and a few words.

    Returns
    -------
    IdentificationResult
        models, their audit and the table.

    Raises
    ------
    InputError
        an input is wrong; names file, field and what was expected.
    NotIdentifiable
        a signal never changes.
    """
    understood = rig_of(rig)
    [one], _ = given(understood, recording, rate=rate)
    sampled = sampled_of(understood, one.recording, inputs, output)
    wanted = Plan(
        orders=tuple(orders),
        steps=tuple(steps),
        delay=delay,
        unit=sampled.output_unit,
        output=sampled.output,
        input=", ".join(sampled.inputs),
        input_unit=", ".join(sampled.input_units),
    )
    found = survey(sampled.signals.y, sampled.signals.u, sampled.sample_time, wanted, progress)
    page = armax_page(found, sampled, Source(understood, one.recording, one.remarks))
    document = {
        **json.loads(to_json(from_survey(found, axis_shown(sampled.signals, found.chosen.model)))),
        **stamp(IdentificationResult.SCHEMA, "identify", understood, [one.recording]),
    }
    return IdentificationResult(document, {}, {TABLE2: found.table2.csv(), "report.html": page})


def sampled_of(rig: Rig, recording: Recording, inputs: Sequence[str], output: str | None) -> Sampled:
    """The input and output channels on an even grid, if they vary at all."""
    outputs = [port.role for port in rig.model.outputs if port.role in recording]
    sampled = resample(
        recording, output or outputs[0], tuple(inputs) or tuple(port.role for port in rig.model.recorded)
    )
    columns = np.column_stack([sampled.signals.y, sampled.signals.u])
    still = [
        role
        for role, column in zip((sampled.output, *sampled.inputs), columns.T, strict=True)
        if not np.isfinite(column).any() or np.ptp(column[np.isfinite(column)]) == 0.0
    ]
    for role in still:
        # A constant one among several inputs is reported in the audit; without any that varies there is no model.
        if role == sampled.output or len(still) == len(sampled.inputs):
            raise NotIdentifiable(
                f"{recording.name}: {role} never changes: nothing can be identified from it (nothing was written)"
            )
    return sampled
