"""`optid fit`: fit the [fit] parameters to recordings."""

from __future__ import annotations

import contextlib
import math
from pathlib import Path
from typing import Any

import click

from optid.cli.common import OUT, RATE, checkpoint, deliver, progress, rate_asked, results_folder, say_next
from optid.errors import InputError, JobError


@click.command()
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.option(
    "--holdout", multiple=True, metavar="REC", help="Recording held out to judge the fit; may be repeated."
)
@RATE
@OUT
@click.option("--starts", default=1, type=click.IntRange(min=1), help="Number of start points; 1 by default.")
@click.option(
    "--time-limit",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Processor time after which the best point so far is kept.",
)
@click.option("--robust", is_flag=True, help="Weigh outliers by their size, not by its square.")
@click.option("--resume/--no-resume", default=True, help="Continue an interrupted fit of the same inputs.")
@click.option(
    "--profile",
    multiple=True,
    metavar="NAME",
    help="Compute the profile likelihood of this parameter; may be repeated.",
)
def fit(rig: str, recordings: tuple[str, ...], holdout: tuple[str, ...], out: str, **choices: Any) -> None:
    """Fit the parameters of the rig file's [fit] table to recordings."""
    folder = results_folder(out, keeps=Path(rig))
    if choices["time_limit"] is not None and not math.isfinite(choices["time_limit"]):
        raise InputError("not finite", where="--time-limit", expected="a number of seconds")

    from optid.api.fitting import fit as run
    from optid.estimation.result import Outcome

    kept = checkpoint(folder, choices["resume"])
    with progress("fitting") as show:
        result = run(
            rig,
            recordings,
            holdout,
            starts=choices["starts"],
            time_limit=choices["time_limit"],
            robust=choices["robust"],
            profiles=choices["profile"],
            rate=rate_asked(),
            checkpoint=kept,
            progress=show,
        )
    deliver(folder, result.write)
    if kept is not None and result.outcome is not Outcome.TIME_LIMIT:
        with contextlib.suppress(OSError):
            kept.unlink(missing_ok=True)
    click.echo(result.summary())
    for why in result.document["refused_profiles"]:
        click.echo(why)
    click.echo(f"written to {out}: {', '.join(result.written)}")
    if result.document["missed"]:
        held = [word for one in holdout or ("OTHER",) for word in ("--holdout", one)]
        say_next("diagnose", rig, *recordings, *held, "--out", "DIR")
    else:
        say_next("simulate", rig, (holdout or recordings)[0], "--fit", out, "--out", "DIR")
    if result.outcome.failed:
        raise JobError(f"{result.outcome.value} The best point found is in {out}.")
    if result.refuted:
        raise JobError(f"{result.refuted}. The fit is in {out}.")
