"""What the commands share: reading inputs, writing results whole or not at all, and saying things on a terminal."""

from __future__ import annotations

import json
import math
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from optid.errors import InputError, JobError, NotIdentifiable

if TYPE_CHECKING:
    from optid.core.recording import Recording
    from optid.quality.remark import Remark
    from optid.rigs.rigfile import Rig

OUT = click.option("--out", required=True, metavar="DIR", help="Folder for the results; made if absent.")

_RATE = "optid.rate"  # under which a call keeps the rate asked for


def _keep_rate(context: click.Context, option: click.Parameter, value: float | None) -> None:
    context.meta[_RATE] = value


RATE = click.option(
    "--rate", type=click.FloatRange(min=0, min_open=True), metavar="HZ", callback=_keep_rate, expose_value=False,
    help="Bring faster recordings down to it; by default what the fastest pole that shows asks for.",
)  # fmt: skip

Read = list[tuple["Recording", tuple["Remark", ...]]]


def read_all(rig: str, recordings: Sequence[str], holdout: Sequence[str] = ()) -> tuple[Rig, Read, Read]:
    """The rig, and the recordings with their remarks: the first ones, and those held out.

    Remarks are on what the files hold; recordings faster than the axis needs are then brought down, and that is said.
    """
    from optid.core.readers import read_recording
    from optid.core.recording import Experiments
    from optid.quality.quality import quality
    from optid.rigs.rigfile import read_rig

    understood = read_rig(rig)
    every = Experiments.of(read_recording(path, understood) for path in (*recordings, *holdout))
    remarked = [
        (_brought_down(understood, recording), quality(recording, understood.model, understood.parameters))
        for recording in every
    ]
    return understood, remarked[: len(recordings)], remarked[len(recordings) :]


def _brought_down(rig: Rig, recording: Recording) -> Recording:
    """A recording at the rate asked for, or at the one its fastest pole needs."""
    from optid.core.thinning import brought_down

    context = click.get_current_context(silent=True)
    asked = None if context is None else context.meta.get(_RATE)
    if asked is not None and not math.isfinite(asked):
        raise InputError("not finite", where="--rate", expected="samples a second")
    return brought_down(rig.model, rig.parameters, recording, asked)


def refuse_unfit(read: Read) -> None:
    """Data that the check calls unfit are not worked on.

    Raises:
        NotIdentifiable: names the recording and the gravest remark.
    """
    for recording, remarks in read:
        if any(remark.severity == "error" for remark in remarks):
            grave = next(remark.message for remark in remarks if remark.severity == "error")
            raise NotIdentifiable(f"{recording.name}: {grave} (nothing was fitted or written)")


def results_folder(out: str, keeps: Path | None = None) -> Path:
    """Where results go, looked at before any work starts; nothing is made yet."""
    folder = Path(out).resolve()
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{out} is a file", where="--out", expected="a folder")
    standing = next(place for place in (folder, *folder.parents) if place.exists())
    if not standing.is_dir() or not os.access(standing, os.W_OK):
        raise InputError(f"nothing can be written in {standing}", where="--out", expected="a writable folder")
    if keeps is not None and keeps.resolve() == folder / "rig.toml":
        raise InputError(f"the fitted rig would overwrite {keeps}", where="--out", expected="another folder")
    return folder


def deliver(folder: Path, write: Callable[[Path], None]) -> None:
    """Write all files in a folder beside the target, then move each into place."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        place = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".part", dir=folder.parent))
        try:
            write(place)
            folder.mkdir(exist_ok=True)
            for file in sorted(place.iterdir()):
                file.replace(folder / file.name)
        finally:
            shutil.rmtree(place, ignore_errors=True)
    except OSError as error:
        raise JobError(f"the results could not be written: {error}") from error


def checkpoint(folder: Path, resume: bool) -> Path:
    """A file in the user's cache for fits into this folder."""
    import hashlib

    import platformdirs

    cache = Path(platformdirs.user_cache_dir("optid")) / "fits"
    path = cache / f"{hashlib.sha256(str(folder).encode()).hexdigest()[:24]}.json"
    try:
        cache.mkdir(parents=True, exist_ok=True)
        if not resume:
            path.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"the cache {cache} cannot be written ({error})", hint="set XDG_CACHE_HOME"
        ) from None
    return path


def write_json(path: Path, content: object) -> None:
    """Indented, without NaN."""
    path.write_text(
        json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )


@contextmanager
def waiting(what: str) -> Iterator[None]:
    """A spinner on a terminal, silence elsewhere."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield


@contextmanager
def progress(what: str) -> Iterator[Callable[[float, str], None]]:
    """A bar on a terminal, silence elsewhere; what it yields takes the share done and a few words."""
    if not sys.stderr.isatty():
        yield lambda share, words: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[now]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(what, total=1.0, now="")
        yield lambda share, words: bars.update(task, completed=share, now=words)


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


def say_table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    """Columns as wide as their widest cell."""
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    for row in (head, *rows):
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())
