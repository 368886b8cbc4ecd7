"""`optid.check`: are the data fit for identification, and what can they tell?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from optid.api.document import stamp
from optid.api.inputs import Given, Progress, given, rig_of, silent
from optid.core.recording import Recording
from optid.estimation.identifiability import identifiability
from optid.quality.motion import answer
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
    said: list[str] = []
    if understood.freed and not grave:
        progress(0.2, "examining what the data can tell")
        said, grave = _identifiability(understood, [one.recording for one in data])
    document = {
        **stamp(CheckResult.SCHEMA, "check", understood, [one.recording for one in data]),
        "fit_for_identification": not grave,
        "recordings": [_entry(understood, one) for one in data],
        "identifiability": said,
        "about": {
            "rig": understood.name,
            "rig_file": str(understood.path),
            "units": _units(understood, data),
        },
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
        "channels": list(recording.channels),
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


def _identifiability(rig: Rig, recordings: list[Recording]) -> tuple[list[str], bool]:
    """What the data tell of the parameters to fit, in sentences; and is one without influence?"""
    ties = identifiability(rig, recordings)
    freed = {parameter.name for parameter in rig.freed}
    idle = [name for name in ties.idle if name in freed]
    free = len(ties.mute)
    said = [f"what these data tell of {free} parameters, at the rig file's values and before any fit:"]
    sd, leader = ties.weakest
    said.append(f"  rank {ties.rank} of {free}, condition number of the sensitivities {ties.condition:.2g}")
    if idle:
        said.append(f"  without influence: {', '.join(idle)}; a fit would be refused")
    said += [f"  {sentence}" for sentence in ties.sentences]
    if not ties.sentences:
        said.append(f"  each has an effect of its own; the weakest direction is {leader}, known to {sd:.1%}")
    return said, bool(idle)


def _units(rig: Rig, data: list[Given]) -> dict[str, str]:
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
