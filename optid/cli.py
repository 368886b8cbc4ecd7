"""The command line: reads arguments, calls one job, prints a short summary and an exit status.

0 done; 1 the job failed, and why; 2 the call or an input file is wrong.
Slow imports stay inside the commands, so that help is there at once.
"""

from __future__ import annotations

import importlib.metadata
import json
import math
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import click

from optid.errors import InputError, JobError, NotIdentifiable

if TYPE_CHECKING:
    from optid.check.remark import Remark
    from optid.core.recording import Recording
    from optid.fit.batch import Progress
    from optid.fit.result import Fit
    from optid.rigs.rigfile import Rig

HUBER = 1.345  # sd: 95 % as efficient as least squares on normal noise (Huber, Robust Statistics, 1981)
HELP = """From recordings of a servo-pneumatic axis to a model you can trust.

\b
  optid check bench.toml run1.csv
      Are the files right, and are the data fit for identification?
  optid simulate bench.toml run1.csv --out out/sim
      How far do the rig file's numbers carry?
  optid fit bench.toml run1.csv run2.csv --holdout run3.csv --out out/fit
      Fit the parameters of the [fit] table, and judge them on what they have not seen.

A rig file (TOML) names the plant, its parameters with units, what a fit may move, and which column is what.
Recordings are CSV, Parquet, MATLAB .mat or NI TDMS.

Exit status: 0 done, 1 the job failed (and why), 2 the call or an input file is wrong (which, where, and what
was expected).
"""


class OneLine(click.Group):
    """A group whose every failure is one line on stderr and an exit status."""

    def main(self, *args: Any, **kwargs: Any) -> NoReturn:
        """Run a command and leave with its exit status; `OPTID_TRACEBACK=1` lets exceptions through."""
        kwargs["standalone_mode"] = False
        try:
            status = super().main(*args, **kwargs)
        except click.ClickException as error:
            _leave(f"{error.format_message()} (optid --help shows how to call it)", 2)
        except (click.Abort, KeyboardInterrupt):
            _leave("interrupted; nothing was written", 1)
        except BrokenPipeError:
            sys.stdout = None  # whoever read has gone; nothing is left to say
            sys.exit(1)
        except Exception as error:
            if os.environ.get("OPTID_TRACEBACK") == "1":
                raise
            _leave(*_in_words(error))
        sys.exit(status if isinstance(status, int) else 0)


def _in_words(error: Exception) -> tuple[str, int]:
    if isinstance(error, InputError):
        return str(error), 2
    if isinstance(error, JobError):
        return str(error), 1
    what = f"{type(error).__name__}: {error}"
    return f"this is a bug in optid, please report it: {what} (OPTID_TRACEBACK=1 shows where)", 1


def _leave(message: str, status: int) -> NoReturn:
    click.echo("optid: " + " ".join(message.split()), err=True)
    sys.exit(status)


@click.group(
    cls=OneLine,
    invoke_without_command=True,
    help=HELP,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
)
@click.version_option(importlib.metadata.version("optid"), prog_name="optid")
@click.pass_context
def cli(context: click.Context) -> None:
    """See HELP."""
    if context.invoked_subcommand is None:
        click.echo(context.get_help())


OUT = click.option("--out", required=True, metavar="DIR", help="Folder for the results; made if absent.")


@cli.command()
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.pass_context
def check(context: click.Context, rig: str, recordings: tuple[str, ...]) -> None:
    """Read a rig file and recordings, and remark on the data.

    Exit status 1 when a recording cannot serve a fit.
    """
    _, read, _ = _read(rig, recordings)
    worst = False
    for recording, remarks in read:
        worst |= _say_remarks(recording, remarks)
    if worst:
        context.exit(1)


@cli.command()
@click.argument("rig")
@click.argument("recording")
@OUT
def simulate(rig: str, recording: str, out: str) -> None:
    """Run the model along a recording, with the rig file's numbers."""
    folder = _folder(out)
    understood, [(read, remarks)], _ = _read(rig, (recording,))

    from optid.fit.prediction import predict
    from optid.report.page import Exhibit, simulation_page
    from optid.report.scores import metrics_document

    with _waiting("simulating"):
        prediction = predict(understood, read, understood.parameters)
        page = simulation_page(understood, Exhibit("simulated", read, prediction, remarks))
    metrics = metrics_document(prediction)

    def write(place: Path) -> None:
        prediction.frame.to_csv(place / "prediction.csv", index=False)
        _write_json(place / "metrics.json", metrics)
        (place / "report.html").write_text(page, encoding="utf-8")

    _deliver(folder, write)
    for kind, words in (("window", "0.5 s windows"), ("free_run", "free run")):
        _say_scores(words, {role: kinds[kind] for role, kinds in metrics.items()})
    click.echo(f"written to {out}: prediction.csv, metrics.json, report.html")


@cli.command()
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.option("--holdout", multiple=True, metavar="REC", help="Judge the fit on it; may be repeated.")
@OUT
@click.option("--starts", default=1, type=click.IntRange(min=1), help="Number of start points; 1 by default.")
@click.option("--time-limit", type=click.FloatRange(min=0, min_open=True), metavar="S", help="Seconds.")
@click.option("--robust", is_flag=True, help="Let outliers count linearly, not squared.")
@click.option("--resume/--no-resume", default=True, help="Go on from a fit of the same that was cut short.")
def fit(rig: str, recordings: tuple[str, ...], holdout: tuple[str, ...], out: str, **choices: Any) -> None:
    """Fit the parameters of the rig file's [fit] table to recordings."""
    folder = _folder(out, keeps=Path(rig))
    if choices["time_limit"] is not None and not math.isfinite(choices["time_limit"]):
        raise InputError("not finite", where="--time-limit", expected="a number of seconds")
    understood, train, held_out = _read(rig, recordings, holdout)
    for recording, remarks in train:
        if any(remark.severity == "error" for remark in remarks):
            grave = next(remark.message for remark in remarks if remark.severity == "error")
            raise NotIdentifiable(f"{recording.name}: {grave} (nothing was fitted or written)")

    from optid.fit.batch import FitOptions
    from optid.fit.batch import fit as fit_rig
    from optid.fit.prediction import predict
    from optid.fit.result import Outcome
    from optid.report.page import Exhibit, fit_page
    from optid.report.scores import fit_document
    from optid.rigs.rigfile import write_rig

    checkpoint = _checkpoint(folder, choices["resume"])
    options = FitOptions(
        starts=choices["starts"], time_limit=choices["time_limit"], checkpoint=checkpoint,
        huber=HUBER if choices["robust"] else math.inf,
    )  # fmt: skip
    with _progress() as report:
        result = fit_rig(understood, [recording for recording, _ in train], options, report)
    exhibits = []
    with _waiting("predicting"):
        for use, group in (("training", train), ("held out", held_out)):
            for recording, remarks in group:
                prediction = predict(understood, recording, result.values, result.process_noise)
                exhibits.append(Exhibit(use, recording, prediction, remarks))
        page = fit_page(understood, result, exhibits)
    used = {use: [e.prediction for e in exhibits if e.use == use] for use in ("training", "held out")}
    document = fit_document(result, used["training"], used["held out"])

    def write(place: Path) -> None:
        _write_json(place / "fit.json", document)
        write_rig(understood, place / "rig.toml", {p.name: p.value for p in result.parameters})
        (place / "report.html").write_text(page, encoding="utf-8")

    _deliver(folder, write)
    if result.outcome is Outcome.CONVERGED:
        checkpoint.unlink(missing_ok=True)
    _say_fit(result)
    _say_scores("training, 0.5 s windows", document["train"])
    _say_scores("held out, 0.5 s windows", document["holdout"])
    click.echo(f"written to {out}: fit.json, rig.toml, report.html")
    if result.outcome is Outcome.NOT_CONVERGED:
        raise JobError(f"{result.outcome.value} The best found is in {out}.")


Read = list[tuple["Recording", tuple["Remark", ...]]]


def _read(rig: str, recordings: Sequence[str], holdout: Sequence[str] = ()) -> tuple[Rig, Read, Read]:
    """The rig, and the recordings with their remarks: the first ones, and those held out."""
    from optid.check.quality import quality
    from optid.core.readers import read_recording
    from optid.core.recording import Experiments
    from optid.rigs.rigfile import read_rig

    understood = read_rig(rig)
    every = Experiments.of(read_recording(path, understood) for path in (*recordings, *holdout))
    remarked = [(recording, quality(recording, understood.model)) for recording in every]
    return understood, remarked[: len(recordings)], remarked[len(recordings) :]


def _folder(out: str, keeps: Path | None = None) -> Path:
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


def _deliver(folder: Path, write: Callable[[Path], None]) -> None:
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


def _checkpoint(folder: Path, resume: bool) -> Path:
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


def _write_json(path: Path, content: object) -> None:
    path.write_text(
        json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )


@contextmanager
def _waiting(what: str) -> Iterator[None]:
    """A spinner on a terminal, silence elsewhere."""
    if not sys.stderr.isatty():
        yield
        return
    from rich.console import Console

    with Console(stderr=True).status(what):
        yield


@contextmanager
def _progress() -> Iterator[Callable[[Progress], None] | None]:
    """A bar on a terminal, silence elsewhere."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bars

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[cost]}"))
    with Bars(*columns, TimeElapsedColumn(), console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task("fitting", total=1.0, cost="")

        def report(now: Progress) -> None:
            bars.update(task, completed=now.fraction, description=now.stage, cost=f"cost {now.cost:.5g}")

        yield report


def _say_remarks(recording: Recording, remarks: tuple[Remark, ...]) -> bool:
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


def _say_fit(result: Fit) -> None:
    click.echo(f"{result.outcome.value} ({result.seconds:.1f} s)")
    rows = []
    for p in result.parameters:
        unit = "" if p.unit == "1" else p.unit
        mark = "not identifiable" if not p.identifiable else "at its bound" if p.at_bound else ""
        rows.append((p.name, f"{p.value:.5g}", f"[{p.low:.5g}, {p.high:.5g}]", unit, mark))
    _say_table(("parameter", "value", "95 % interval", "unit", ""), rows)
    for tie in result.ties:
        click.echo(f"  {tie}")


def _say_scores(title: str, scores: dict[str, dict[str, Any]]) -> None:
    from optid.report.scores import score_rows

    if scores:
        _say_table((title, "fit", "rmse"), score_rows(scores))


def _say_table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> None:
    widths = [max(len(row[i]) for row in (head, *rows)) for i in range(len(head))]
    for row in (head, *rows):
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def main() -> None:
    """Entry point of the `optid` script."""
    cli()


if __name__ == "__main__":
    main()
