"""What the commands share: reading inputs and printing; results and progress come from the modules beside it."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from optid.cli.checkpoint import checkpoint
from optid.cli.progress import progress, waiting
from optid.cli.results import OUT, deliver, placed, results_folder, write_json
from optid.errors import InputError, NotIdentifiable

if TYPE_CHECKING:
    from optid.api.inputs import Given
    from optid.core.recording import Recording
    from optid.quality.remark import Remark
    from optid.rigs.rigfile import Rig

__all__ = [
    "OUT",
    "Read",
    "checkpoint",
    "deliver",
    "placed",
    "progress",
    "rate_asked",
    "read_all",
    "refuse_unfit",
    "results_folder",
    "say_next",
    "say_remarks",
    "say_scores",
    "say_table",
    "waiting",
    "write_json",
]

_RATE = "optid.rate"  # key under which a call keeps the requested rate


def _keep_rate(context: click.Context, option: click.Parameter, value: float | None) -> None:
    context.meta[_RATE] = value


RATE = click.option(
    "--rate",
    type=click.FloatRange(min=0, min_open=True),
    metavar="HZ",
    callback=_keep_rate,
    expose_value=False,
    help="Decimate faster recordings to this rate; by default as fast as the fastest visible pole needs.",
)

Read = list[tuple["Recording", tuple["Remark", ...]]]


def read_all(rig: str, recordings: Sequence[str], holdout: Sequence[str] = ()) -> tuple[Rig, Read, Read]:
    """The rig, and the recordings with their remarks: the first ones, and those held out.

    Remarks are on what the files hold; recordings faster than the axis needs are then decimated, with a note.
    """
    from optid.api.inputs import at_their_rate, given, rig_of

    understood = rig_of(rig)
    first, held = given(understood, recordings, holdout, rate_asked())
    return at_their_rate(understood, first), _pairs(first), _pairs(held)


def _pairs(data: Sequence[Given]) -> Read:
    return [(one.recording, one.remarks) for one in data]


def rate_asked() -> float | None:
    """The rate to which the call decimates recordings, Hz."""
    context = click.get_current_context(silent=True)
    asked: float | None = None if context is None else context.meta.get(_RATE)
    if asked is not None and not math.isfinite(asked):
        raise InputError("not finite", where="--rate", expected="a number of samples per second")
    return asked


def refuse_unfit(read: Read) -> None:
    """Refuse data that the check calls unfit.

    Raises:
        NotIdentifiable: names the recording and the gravest remark.
    """
    for recording, remarks in read:
        if any(remark.severity == "error" for remark in remarks):
            grave = next(remark.message for remark in remarks if remark.severity == "error")
            raise NotIdentifiable(f"{recording.name}: {grave} (nothing was fitted or written)")


def say_remarks(recording: Recording, remarks: tuple[Remark, ...]) -> bool:
    """Print them; is one an error?"""
    size = f"{len(recording)} samples, {recording.duration:.4g} s at {recording.rate:.5g} Hz"
    click.echo(f"{recording.name}: {size}, {', '.join(recording.channels)}")
    for remark in remarks:
        click.echo(f"  {remark.severity:8}{remark.message}")
    for note in recording.provenance.notes if recording.provenance else ():
        click.echo(f"  {'note':8}{note}")
    if not remarks:
        click.echo("  no remarks: the data are fit for identification")
    return any(remark.severity == "error" for remark in remarks)


def say_scores(title: str, scores: dict[str, dict[str, Any]]) -> None:
    """A table of fit and rmse per channel; nothing where there are no scores."""
    from optid.report.scores import score_rows

    if scores:
        say_table((title, "fit", "rmse"), score_rows(scores))


def say_next(*call: str) -> None:
    """End a summary with the next command; capitals stand for what only the user can name."""
    click.echo(f"next: {shlex.join(['optid', *call])}")


def say_table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    """Columns as wide as their widest cell."""
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    for row in (head, *rows):
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
