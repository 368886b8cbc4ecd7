"""The content of check.json: recordings, remarks, and what the data can be used for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from optid.core.recording import Recording
from optid.quality.remark import Remark
from optid.quality.verdict import Verdict
from optid.rigs.rigfile import Rig

SCHEMA = "optid.check/1"
Read = Sequence[tuple[Recording, Sequence[Remark]]]


def check_document(
    rig: Rig,
    read: Read,
    verdict: Verdict,
    identifiability: Mapping[str, Any] | None,
    detectability: Sequence[Mapping[str, Any]] | None = None,
) -> dict[str, Any]:
    """Content of check.json.

    Args:
        rig: as read.
        read: recordings with their remarks.
        verdict: on them.
        identifiability: of the parameters; None where it was not computed.
        detectability: of effects; None where it was not computed.
    """
    return {
        "schema": SCHEMA,
        "rig": str(rig.path),
        "fit_for": list(verdict.fit_for),
        "not_fit_for": verdict.why_not,
        "next": verdict.next,
        "summary": verdict.sentence,
        "recordings": [_recording(recording, remarks) for recording, remarks in read],
        "identifiability": dict(identifiability) if identifiability is not None else None,
        "detectability": [dict(one) for one in detectability] if detectability is not None else None,
    }


def _recording(recording: Recording, remarks: Sequence[Remark]) -> dict[str, Any]:
    source = recording.provenance
    return {
        "name": recording.name,
        "sha256": source.sha256 if source else None,
        "format": source.reader if source else None,
        "samples": len(recording),
        "duration": recording.duration,
        "rate": recording.rate,
        "channels": {
            role: {"column": channel.column, "unit": channel.unit, "missing": channel.missing}
            for role, channel in recording.channels.items()
        },
        "remarks": [
            {
                "kind": remark.kind,
                "severity": remark.severity,
                "channel": remark.channel,
                "message": remark.message,
                "interval": list(remark.interval) if remark.interval else None,
            }
            for remark in remarks
        ],
        "notes": list(source.notes) if source else [],
    }
