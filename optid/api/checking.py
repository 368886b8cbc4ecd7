"""`optid.check`: are the data fit for identification, and what can they tell?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from optid.api.document import stamp
from optid.api.inputs import Given, Progress, given, rig_of, silent
from optid.core.recording import Recording
from optid.estimation.identifiability import identifiability
from optid.quality.motion import answer
from optid.report.scores import number
from optid.results.check import CheckResult
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    import pandas as pd

    from optid.api.inputs import Recordings

ALIKE = 0.3  # correlation from which an answer to an input is worth telling


def check(rig: str | Path | Rig, recordings: Recordings, *, progress: Progress = silent) -> CheckResult:
    """Look at recordings before any fit.

    Args:
        rig: a rig file, or what `read_rig` made of one.
        recordings: a path, a DataFrame, a Recording, or a list of them.
        progress: called with the share done and a few words.

    Returns:
        Remarks on each recording, and what the data tell of the parameters to fit.

    Raises:
        InputError: an input is wrong; names file, field and what was expected.
    """
    understood = rig_of(rig)
    data, _ = given(understood, recordings)
    grave = any(remark.severity == "error" for one in data for remark in one.remarks)
    told = None
    if understood.freed and not grave:
        progress(0.2, "examining what the data can tell")
        told = _identifiability(understood, [one.recording for one in data])
    fit_for = [] if grave or (told and told["without_influence"]) else ["fit"]
    document = {
        **stamp(CheckResult.SCHEMA, "check", understood, [one.recording for one in data]),
        "fit_for": fit_for,
        "summary": "fit for identification" if fit_for else "unfit for identification",
        "recordings": [_entry(understood, one) for one in data],
        "identifiability": told,
        "about": {"rig": understood.name, "rig_file": str(understood.path), "units": _units(data)},
    }
    return CheckResult(document, {"signals": _signals([one.recording for one in data])})


def _entry(rig: Rig, one: Given) -> dict[str, Any]:
    recording, source = one.recording, one.recording.provenance
    grave = any(remark.severity == "error" for remark in one.remarks)
    return {
        "name": recording.name,
        "path": str(source.path) if source else recording.name,
        "samples": len(recording),
        "duration": recording.duration,
        "rate": recording.rate,
        "channels": {
            role: {"column": channel.column, "unit": channel.unit, "missing": channel.missing}
            for role, channel in recording.channels.items()
        },
        "remarks": [
            {
                "kind": r.kind,
                "severity": r.severity,
                "channel": r.channel,
                "message": r.message,
                "interval": None if r.interval is None else list(r.interval),
            }
            for r in one.remarks
        ],
        "notes": list(source.notes) if source else [],
        "lags": [] if grave else _lags(rig, recording),
    }


def _lags(rig: Rig, recording: Recording) -> list[dict[str, Any]]:
    """By how much what is measured follows each input, where they resemble each other at all."""
    found = []
    for cause in dict.fromkeys(port.role for port in rig.model.inputs if port.role in recording):
        for role in (port.role for port in rig.model.outputs if port.role in recording):
            answered = answer(recording, cause, role)
            if answered is not None and answered[1].correlation > max(answered[1].chance, ALIKE):
                what, lag = answered
                how = f"{1e3 * lag.seconds:.3g} ms, correlation {lag.correlation:.2f}"
                entry = {
                    "input": cause,
                    "output": what,
                    "seconds": lag.seconds,
                    "correlation": lag.correlation,
                }
                found.append({**entry, "words": f"{what} against {cause}: {how}"})
    return found


def _identifiability(rig: Rig, recordings: list[Recording]) -> dict[str, Any]:
    """What the data tell of the parameters to fit, at the rig file's values and before any fit."""
    ties = identifiability(rig, recordings)
    freed = {parameter.name for parameter in rig.freed}
    sd, leader = ties.weakest
    alone = f"each has an effect of its own; the weakest direction is {leader}, known to {sd:.1%}"
    return {
        "parameters": len(ties.mute),
        "rank": int(ties.rank),
        "condition": number(float(ties.condition)),
        "without_influence": [name for name in ties.idle if name in freed],
        "sentences": list(ties.sentences) or [alone],
    }


def _units(data: list[Given]) -> dict[str, str]:
    return {role: channel.recorded_unit for one in data for role, channel in one.recording.channels.items()}


def _signals(recordings: list[Recording]) -> pd.DataFrame:
    import pandas as pd

    parts = [
        pd.DataFrame(
            {
                "recording": one.name,
                "time": one.time,
                **{role: channel.recorded for role, channel in one.channels.items()},
            }
        )
        for one in recordings
    ]
    return pd.concat(parts, ignore_index=True)
