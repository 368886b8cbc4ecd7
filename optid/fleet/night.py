"""The test of a night: one-step estimates of a fitted model's parameters, and of effects it lacks."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optid.api.document import stamp
from optid.api.inputs import Progress, given, refuse_unfit, rig_of, silent
from optid.effects.library import built_in
from optid.errors import InputError, nearest
from optid.monitoring.one_step import quantities
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    from optid.api.inputs import Recordings

SCHEMA = "optid.test/1"
FILE = "test.json"


def night_test(
    rig: str | Path | Rig,
    recordings: Recordings,
    *,
    watch: Sequence[str],
    rate: float | None = None,
    progress: Progress = silent,
) -> dict[str, Any]:
    """Estimate what may have changed of a fitted rig, from one night's recordings, in a second.

    Parameters
    ----------
    rig : str | Path | Rig
        fitted: the file that `optid fit` writes; its [fit] table says which parameters are followed.
    recordings : Recordings
        of one night.
    watch : Sequence[str]
        names of effects whose sizes are followed as well; those that the plant does not admit are left out.
    rate : float | None
        Hz to which faster recordings are decimated.
    progress : Progress
        called with the share done and a few words.

    Returns
    -------
    dict[str, Any]
        Content of `test.json`: `quantities`, by name, value, sd, 95 % interval and unit.

    Raises
    ------
    InputError
        an input is wrong, or an effect is unknown.
    NotIdentifiable
        a recording is unfit.
    SolveError
        the model cannot be simulated.
    """
    began = time.process_time()
    if unknown := [name for name in watch if name not in built_in()]:
        raise InputError(f'no effect "{unknown[0]}"', field="watch", hint=nearest(unknown[0], built_in()))
    understood = rig_of(rig)
    data, _ = given(understood, recordings, rate=rate)
    refuse_unfit(data)
    found = quantities(understood, [one.recording for one in data], watch, progress)
    half = 1.96
    return {
        **stamp(SCHEMA, "test", understood, [one.recording for one in data]),
        "rig": understood.name,
        "quantities": {
            name: {
                "value": one.value,
                "sd": one.sd if math.isfinite(one.sd) else None,
                "unit": one.unit,
                "ci95": [one.value - half * one.sd, one.value + half * one.sd]
                if math.isfinite(one.sd)
                else None,
            }
            for name, one in found.items()
        },
        "seconds": round(time.process_time() - began, 3),
    }
