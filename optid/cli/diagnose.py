"""`optid diagnose`: find, name, model and prove what a rig's model leaves out."""

from __future__ import annotations

import math
from pathlib import Path

import click

from optid.cli.common import (
    OUT,
    RATE,
    checkpoint,
    deliver,
    placed,
    progress,
    rate_asked,
    results_folder,
    say_next,
    waiting,
)

TIME_LIMIT = 800.0  # s: with much missing, the second of two effects was found after 650 s on one core


@click.command()
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.option(
    "--holdout",
    multiple=True,
    required=True,
    metavar="REC",
    help="Recording held out for the final test; may be repeated.",
)
@click.option(
    "--validate",
    multiple=True,
    metavar="REC",
    help="Recording that judges the search, instead of blocks of each RECORDING; may be repeated.",
)
@click.option(
    "--effects",
    multiple=True,
    metavar="FILE.py",
    help="Python file with effects of your own; may be repeated.",
)
@click.option(
    "--time-limit",
    default=TIME_LIMIT,
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Processor time, approximately, after which the search for effects stops and keeps its best model.",
    show_default=True,
)
@click.option(
    "--deadline",
    default=math.inf,
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Wall-clock time, approximately, after which the diagnosis stops and keeps its best model.",
)
@click.option(
    "--resume/--no-resume", default=True, help="Continue an interrupted diagnosis of the same inputs."
)
@RATE
@OUT
def diagnose(
    rig: str,
    recordings: tuple[str, ...],
    holdout: tuple[str, ...],
    validate: tuple[str, ...],
    effects: tuple[str, ...],
    time_limit: float,
    deadline: float,
    resume: bool,
    out: str,
) -> None:
    """Find the physics that the rig's model leaves out, and prove it on held-out recordings."""
    folder = results_folder(out, keeps=Path(rig))

    from optid.api.diagnosing import diagnose as run

    with progress("diagnosing") as show:
        result = run(
            rig,
            recordings,
            holdout,
            validation=validate,
            effects=effects,
            time_limit=time_limit,
            deadline=deadline,
            rate=rate_asked(),
            progress=show,
            checkpoint=checkpoint(folder, resume),
        )
    with waiting("writing the report"):
        deliver(folder, placed(result, out).write)
    click.echo(result.summary())
    click.echo(f"written to {out}: {', '.join(result.written)}")
    if any(finding.effect is None or finding.indistinguishable_from for finding in result.findings):
        say_next("plan", rig, "--diagnosis", out, "--out", "DIR")
    else:
        say_next("simulate", f"{out}/rig.toml", holdout[0], "--out", "DIR")
