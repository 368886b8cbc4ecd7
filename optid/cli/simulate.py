"""`optid simulate`: run the model along a recording."""

from __future__ import annotations

import click

from optid.cli.common import OUT, RATE, deliver, progress, rate_asked, results_folder


@click.command()
@click.argument("rig")
@click.argument("recording")
@click.option(
    "--fit", "fitted", metavar="DIR", help="Use this fit's values, and draw the 95 % band they give."
)
@RATE
@OUT
def simulate(rig: str, recording: str, fitted: str | None, out: str) -> None:
    """Run the model along a recording, with the rig file's numbers."""
    folder = results_folder(out)

    from optid.api.simulating import simulate as run
    from optid.errors import InputError
    from optid.results.fit import FitResult
    from optid.results.loading import load

    values = None if fitted is None else load(fitted)
    if values is not None and not isinstance(values, FitResult):
        raise InputError(
            f"{fitted} holds a {type(values).__name__}", where="--fit", expected="results of optid fit"
        )
    with progress("simulating") as show:
        result = run(rig, recording, fit=values, rate=rate_asked(), progress=show)
    deliver(folder, result.write)
    click.echo(result.summary())
    click.echo(f"written to {out}: {', '.join(result.written)}")
