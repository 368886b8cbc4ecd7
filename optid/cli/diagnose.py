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

TIME_LIMIT = 800.0  # s: where much is missing, the second of two effects was found after 650 of a core


@click.command()
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.option("--holdout", multiple=True, required=True, metavar="REC", help="Judge on it; may be repeated.")
@click.option(
    "--validate",
    multiple=True,
    metavar="REC",
    help="Judge the search on it alone, not on each RECORDING in turn; may be repeated.",
)
@click.option(
    "--effects", multiple=True, metavar="FILE.py", help="Effects of your own, to take part in everything."
)
@click.option("--seed", default=0, type=click.IntRange(min=0), help="Of the resampling; 0 by default.")
@click.option(
    "--time-limit",
    default=TIME_LIMIT,
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Seconds of the process's own time, about: the search for effects ends with what it has.",
    show_default=True,
)
@click.option(
    "--deadline",
    default=math.inf,
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Seconds by the clock, about, after which it ends with what it has.",
)
@click.option(
    "--resume/--no-resume", default=True, help="Go on from a diagnosis of the same that was cut short."
)
@RATE
@OUT
def diagnose(
    rig: str,
    recordings: tuple[str, ...],
    holdout: tuple[str, ...],
    validate: tuple[str, ...],
    effects: tuple[str, ...],
    seed: int,
    time_limit: float,
    deadline: float,
    resume: bool,
    out: str,
) -> None:
    """Say what physics the rig's model leaves out, and prove it on recordings held out."""
    folder = results_folder(out, keeps=Path(rig))

    from optid.api.diagnosing import diagnose as run

    with progress("diagnosing") as show:
        result = run(
            rig,
            recordings,
            holdout,
            validation=validate,
            effects=effects,
            seed=seed,
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
