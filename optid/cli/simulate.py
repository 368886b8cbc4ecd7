"""`optid simulate`: run the model along a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from optid.cli.common import OUT, RATE, deliver, progress, rate_asked, results_folder, say_next

if TYPE_CHECKING:
    from optid.results.fit import FitResult


@click.command()
@click.argument("rig")
@click.argument("recording")
@click.option(
    "--fit",
    "fitted",
    metavar="DIR",
    help="Folder of a fit: use its values and draw the 95 % band of its parameters.",
)
@RATE
@OUT
def simulate(rig: str, recording: str, fitted: str | None, out: str) -> None:
    """Simulate the model along a recording with the rig file's values."""
    folder = results_folder(out)

    from optid.api.simulating import simulate as run

    values = None if fitted is None else _fit_in(fitted)
    with progress("simulating") as show:
        result = run(rig, recording, fit=values, rate=rate_asked(), progress=show)
    deliver(folder, result.write)
    click.echo(result.summary())
    click.echo(f"written to {out}: {', '.join(result.written)}")
    job = "fit" if fitted is None else "diagnose"
    say_next(job, rig, recording, "--holdout", "OTHER", "--out", "DIR")


def _fit_in(folder: str) -> FitResult:
    from optid.errors import InputError
    from optid.results.fit import FitResult
    from optid.results.loading import load

    values = load(folder)
    if not isinstance(values, FitResult):
        raise InputError(
            f"{folder} holds a {type(values).__name__}",
            where="--fit",
            expected="a folder with the results of optid fit",
        )
    try:
        found = values.parameters, values.values, values.process_noise, values.covariance
        complete = len(found[3]) == len(found[0])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise InputError(
            f"the fit in this folder is incomplete ({type(error).__name__}: {error})",
            where=folder,
            hint="run optid fit again",
        ) from None
    if not complete:
        raise InputError(
            "the covariance and the parameters of this fit do not match",
            where=folder,
            hint="run optid fit again",
        )
    return values
