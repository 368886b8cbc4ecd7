"""`optid fit`: fit the [fit] parameters to recordings."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from optid.cli.common import (
    OUT,
    RATE,
    Read,
    checkpoint,
    deliver,
    progress,
    read_all,
    refuse_unfit,
    results_folder,
    say_scores,
    say_table,
    waiting,
    write_json,
)
from optid.errors import InputError, JobError, NotIdentifiable

if TYPE_CHECKING:
    from optid.core.recording import Recording
    from optid.estimation.batch import FitOptions
    from optid.estimation.profile import Profile
    from optid.estimation.result import Fit
    from optid.report.page import Exhibit
    from optid.rigs.rigfile import Rig

HUBER = 1.345  # sd: 95 % as efficient as least squares on normal noise (Huber, Robust Statistics, 1981)


@click.command()
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.option("--holdout", multiple=True, metavar="REC", help="Judge the fit on it; may be repeated.")
@RATE
@OUT
@click.option("--starts", default=1, type=click.IntRange(min=1), help="Number of start points; 1 by default.")
@click.option("--time-limit", type=click.FloatRange(min=0, min_open=True), metavar="S", help="Seconds.")
@click.option("--robust", is_flag=True, help="Let outliers count linearly, not squared.")
@click.option("--resume/--no-resume", default=True, help="Go on from a fit of the same that was cut short.")
@click.option("--profile", multiple=True, metavar="NAME", help="Follow its likelihood; may be repeated.")
def fit(rig: str, recordings: tuple[str, ...], holdout: tuple[str, ...], out: str, **choices: Any) -> None:
    """Fit the parameters of the rig file's [fit] table to recordings."""
    folder = results_folder(out, keeps=Path(rig))
    if choices["time_limit"] is not None and not math.isfinite(choices["time_limit"]):
        raise InputError("not finite", where="--time-limit", expected="a number of seconds")
    understood, train, held_out = read_all(rig, recordings, holdout)
    refuse_unfit(train)

    from optid.estimation.batch import FitOptions
    from optid.estimation.batch import fit as fit_rig
    from optid.estimation.profile import fitted
    from optid.report.page import fit_page
    from optid.report.scores import fit_document, misses
    from optid.rigs.constraints import broken
    from optid.rigs.rigfile import write_rig

    for name in choices["profile"]:
        fitted(understood, name)
    kept, data = checkpoint(folder, choices["resume"]), [recording for recording, _ in train]
    options = FitOptions(
        starts=choices["starts"], time_limit=choices["time_limit"], checkpoint=kept,
        huber=HUBER if choices["robust"] else math.inf,
    )  # fmt: skip
    with progress("fitting") as show:
        result = fit_rig(
            understood, data, options, lambda now: show(now.fraction, f"{now.stage}, cost {now.cost:.5g}")
        )
    profiles = _profiles(understood, data, result, options, choices["profile"])
    with waiting("predicting"):
        exhibits = _exhibits(understood, result, train, held_out)
        used = {use: [e.prediction for e in exhibits if e.use == use] for use in ("training", "held out")}
        missed = misses(used["training"], data)
        result = result.judged(
            [freed.name for freed in understood.freed],
            [one.fit_percent for one in missed],
            sound=not broken(understood.model, result.values),
        )
        page = fit_page(understood, result, exhibits, profiles)
    document = fit_document(result, used["training"], used["held out"], profiles, missed)

    def write(place: Path) -> None:
        write_json(place / "fit.json", document)
        write_rig(understood, place / "rig.toml", {p.name: p.value for p in result.parameters})
        (place / "report.html").write_text(page, encoding="utf-8")

    deliver(folder, write)
    if kept is not None and document["outcome"] != "time_limit":
        with contextlib.suppress(OSError):
            kept.unlink(missing_ok=True)
    _say_fit(result)
    for one in profiles:
        click.echo(f"  {one.sentence}")
    for use, scores in (("training", "train"), ("held out", "holdout")):
        span = max((one.horizon for one in used[use]), default=0.0)
        say_scores(f"{use}, {span:g} s windows", document[scores])
    for miss in () if result.outcome.failed else missed:
        click.echo(miss.sentence)
    click.echo(f"written to {out}: fit.json, rig.toml, report.html")
    if result.outcome.failed:
        raise JobError(f"{result.outcome.value} The best found is in {out}.")


def _exhibits(rig: Rig, result: Fit, train: Read, held_out: Read) -> list[Exhibit]:
    from optid.estimation.prediction import predict
    from optid.report.page import Exhibit

    return [
        Exhibit(use, recording, predict(rig, recording, result.values, result.process_noise), remarks)
        for use, group in (("training", train), ("held out", held_out))
        for recording, remarks in group
    ]


def _profiles(
    rig: Rig, recordings: list[Recording], result: Fit, options: FitOptions, names: tuple[str, ...]
) -> list[Profile]:
    """Those asked for; one that cannot be is said on the terminal, and the fit stands."""
    from optid.estimation.profile import profile

    found = []
    for name in dict.fromkeys(names):
        try:
            with progress(f"profile of {name}") as show:
                found.append(profile(rig, recordings, result, name, options, lambda share: show(share, "")))
        except NotIdentifiable as error:
            click.echo(f"no profile: {error}")
    return found


def _say_fit(result: Fit) -> None:
    click.echo(f"{result.outcome.value} ({result.seconds:.1f} s)")
    rows = []
    for p in result.parameters:
        unit = "" if p.unit == "1" else p.unit
        mark = "not identifiable" if not p.identifiable else "at its bound" if p.at_bound else ""
        low, high = (f"{end:.5g}" if math.isfinite(end) else "open" for end in (p.low, p.high))
        rows.append((p.name, f"{p.value:.5g}", f"[{low}, {high}]", unit, mark))
    say_table(("parameter", "value", "95 % interval", "unit", ""), rows)
    for tie in result.ties:
        click.echo(f"  {tie}")
