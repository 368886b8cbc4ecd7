"""The report of `optid check` and its document: what was recorded, and what was remarked on, marked in pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import matplotlib as mpl
from markupsafe import Markup
from matplotlib.figure import Figure

from optid.core.recording import Recording
from optid.quality.remark import Remark
from optid.quality.verdict import Verdict
from optid.report import figures
from optid.report.scores import friendly
from optid.rigs.rigfile import Rig

SCHEMA = "optid.check/1"
Read = Sequence[tuple[Recording, Sequence[Remark]]]


def check_document(
    rig: Rig, read: Read, verdict: Verdict, identifiability: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Content of check.json.

    Args:
        rig: as read.
        read: recordings with their remarks.
        verdict: on them.
        identifiability: what the data tell of the parameters; None where it was not asked.
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
                "kind": remark.kind, "severity": remark.severity, "channel": remark.channel,
                "message": remark.message, "interval": list(remark.interval) if remark.interval else None,
            }
            for remark in remarks
        ],
        "notes": list(source.notes) if source else [],
    }  # fmt: skip


def check_page(rig: Rig, read: Read, verdict: Verdict, identifiability: Mapping[str, Any] | None) -> str:
    """The page; see `check_document` for its arguments."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    shown = [
        {
            **_recording(recording, remarks),
            "picture": Markup(_picture(recording, remarks)),
        }
        for recording, remarks in read
    ]
    return environment.get_template("check.html.j2").render(
        title=f"{rig.name}: check",
        rig=rig,
        lead=verdict.sentence,
        recordings=shown,
        identifiability=identifiability,
    )


def _picture(recording: Recording, remarks: Sequence[Remark]) -> str:
    """Every channel over time; stretches and instants that a remark names are shaded."""
    roles = list(recording.channels)
    with mpl.rc_context(figures.STYLE):
        figure = Figure(figsize=(9.2, 0.5 + 1.25 * len(roles)), layout="constrained")
        axes = figure.subplots(len(roles), 1, sharex=True, squeeze=False)[:, 0]
        for axis, role in zip(axes, roles, strict=True):
            channel = recording[role]
            factor, unit = friendly(channel.recorded_unit)
            axis.plot(*figures.thin(recording.time, factor * channel.recorded), color=figures.INK, lw=0.9)
            axis.set_ylabel(figures.axis_name(role, unit))
            least = 0.002 * recording.duration
            for remark in remarks:
                if remark.interval and remark.channel in (role, "time"):
                    start, stop = remark.interval
                    colour = figures.ALARM if remark.severity != "note" else figures.QUIET
                    axis.axvspan(start, max(stop, start + least), color=colour, alpha=0.18, lw=0)
        axes[-1].set_xlabel("time (s)")
        figure.align_ylabels()
        return figures.svg(figure)
