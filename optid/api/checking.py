"""`optid.check`: are the data fit for identification, and what can they tell?"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optid.api.document import place_of, stamp
from optid.api.inputs import Progress, given, rig_of, silent
from optid.core.recording import Array, Recording
from optid.estimation.identifiability import identifiability
from optid.quality.verdict import Verdict, verdict
from optid.report.check_document import Read, check_document
from optid.report.scores import number
from optid.results.check import CheckResult
from optid.rigs.rigfile import Rig

_DRAWN = 1 << 17  # rows that are enough for a picture of a recording
# Samples that are enough to judge identifiability, in parts of a long recording.
_EXAMINED, _STRETCHES = 1 << 17, 8

if TYPE_CHECKING:
    import pandas as pd

    from optid.api.inputs import Recordings


def check(
    rig: str | Path | Rig,
    recordings: Recordings,
    *,
    rate: float | None = None,
    detectability: bool = False,
    progress: Progress = silent,
) -> CheckResult:
    """Look at recordings before any fit.

    Parameters
    ----------
    rig : str | Path | Rig
        a rig file, or what `read_rig` made of one.
    recordings : Recordings
        a path, a DataFrame, a Recording, or a list of them.
    rate : float | None
        Hz to which faster recordings are decimated; by default as fast as the axis's fastest pole needs.
    detectability : bool
        also compute the size from which each effect of the catalogue is visible and distinguishable from others.
    progress : Progress
        called with the share done and a few words.

    Returns
    -------
    CheckResult
        Remarks on each recording, and the identifiability of the parameters to fit.

    Raises
    ------
    InputError
        an input is wrong; names file, field and what was expected.
    """
    understood = rig_of(rig)
    data, _ = given(understood, recordings, rate=rate)
    read = [(one.recording, one.remarks) for one in data]
    grave = any(remark.severity == "error" for one in data for remark in one.remarks)
    told = None
    if understood.freed and not grave:
        progress(0.2, "checking identifiability")
        told = what_they_tell(understood, [one.recording for one in data])
    seen = None
    if detectability and not grave:
        progress(0.4, "sensitivity to each effect")
        seen = what_they_could_show(understood, [one.recording for one in data])
    paths = [place_of(one.recording) for one in data]
    found = verdict(
        read,
        told["without_influence"] if told else [],
        [parameter.name for parameter in understood.freed],
        shlex.join([str(understood.path), *paths]),
    )
    return result_of(understood, read, found, told, seen)


def result_of(
    rig: Rig,
    read: Read,
    found: Verdict,
    told: Mapping[str, Any] | None,
    seen: Sequence[Mapping[str, Any]] | None = None,
) -> CheckResult:
    """A check as a result.

    Parameters
    ----------
    rig : Rig
        as read.
    read : Read
        recordings with their remarks.
    found : Verdict
        the verdict on them.
    told : Mapping[str, Any] | None
        identifiability of the parameters; ``None`` where it was not computed.
    seen : Sequence[Mapping[str, Any]] | None
        smallest detectable sizes of effects; ``None`` where they were not computed.
    """
    data = [recording for recording, _ in read]
    document = {
        **stamp(CheckResult.SCHEMA, "check", rig, data),
        **check_document(rig, read, found, told, seen),
        "about": {
            "rig": rig.name,
            "rig_file": str(rig.path),
            "plant": rig.model_name,
            "units": _units(data),
        },
    }
    return CheckResult(document, {"signals": _signals(data)})


def what_they_tell(rig: Rig, recordings: list[Recording]) -> dict[str, Any]:
    """Identifiability of the parameters to fit, at the rig file's values and before any fit."""
    examined, seconds = _excerpts(recordings)
    ties = identifiability(rig, examined)
    freed = {parameter.name for parameter in rig.freed}
    sd, leader = ties.weakest
    alone = f"each has an effect of its own; the weakest direction is {leader}, known to {100 * sd:.1f} %"
    return {
        "parameters": len(ties.mute),
        "rank": int(ties.rank),
        "condition": number(float(ties.condition)),
        "without_influence": [name for name in ties.idle if name in freed],
        "sentences": [*(list(ties.sentences) or [alone]), *seconds],
    }


def _excerpts(recordings: list[Recording]) -> tuple[list[Recording], list[str]]:
    """Parts spread over long recordings, and a sentence that states it."""
    total = sum(len(one) for one in recordings)
    if total <= 2 * _EXAMINED:
        return recordings, []
    parts: list[Recording] = []
    for one in recordings:
        share = max(len(one) * _EXAMINED // total // _STRETCHES, 2)
        if len(one) <= _STRETCHES * share:
            parts.append(one)
            continue
        starts = np.linspace(0, len(one) - share, _STRETCHES).astype(int)
        parts += [one.part(int(a), int(a) + share) for a in starts]
    seen, whole = (sum(one.duration for one in some) for some in (parts, recordings))
    return parts, [
        f"examined on {seen:.4g} s of {whole:.4g} s, in parts spread over the recordings: the whole data determine "
        "the parameters at least as well"
    ]


def what_they_could_show(rig: Rig, recordings: list[Recording]) -> list[dict[str, Any]]:
    """The smallest detectable size of each effect of the catalogue, as in check.json; the most visible first."""
    from optid.effects.library import admitted
    from optid.experiments.detectability import detectability

    def sizes(values: Mapping[str, float], units: Mapping[str, str]) -> dict[str, Any]:
        return {name: {"value": value, "unit": units[name]} for name, value in values.items()}

    found = detectability(rig, recordings, admitted(rig.model))
    return [
        {
            "effect": one.effect,
            "separation": number(one.separation),
            "apart": number(one.apart),
            "shows_from": sizes(one.shows_from, one.units),
            "told_from": sizes(one.told_from, one.units),
            "alike": list(one.alike),
        }
        for one in sorted(found, key=lambda one: -one.separation)
    ]


def _units(data: list[Recording]) -> dict[str, str]:
    return {role: channel.recorded_unit for one in data for role, channel in one.channels.items()}


def _signals(recordings: list[Recording]) -> pd.DataFrame:
    import pandas as pd

    return pd.concat([_drawn(one) for one in recordings], ignore_index=True)


def _drawn(recording: Recording) -> pd.DataFrame:
    """A recording reduced for a plot: of a long one the lowest and the highest value in each of many blocks."""
    import pandas as pd

    count = len(recording) // _DRAWN
    columns = {"time": recording.time, **{role: one.values for role, one in recording.channels.items()}}
    if count >= 4:
        columns = {
            role: values[::count] if role == "time" else _extremes(values, count)
            for role, values in columns.items()
        }
        columns["time"] = np.repeat(columns["time"], 2)
    shown = {role: one * recording.channels[role].per_unit for role, one in columns.items() if role != "time"}
    return pd.DataFrame({"recording": recording.name, "time": columns["time"], **shown})


def _extremes(values: Array, count: int) -> Array:
    """Lowest and highest of every `count` samples in turn, (2 blocks,); NaN where a block holds none."""
    starts = np.arange(0, len(values), count)
    found = np.column_stack([np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)])
    return np.asarray(found.ravel())
