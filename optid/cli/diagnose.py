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
    progress,
    read_all,
    refuse_unfit,
    results_folder,
    say_table,
    waiting,
    write_json,
)

TIME_LIMIT = 800.0  # s: where much is missing, the second of two effects was found after 650 of a core


@click.command()
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.option("--holdout", multiple=True, required=True, metavar="REC", help="Judge on it; may be repeated.")
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
    effects: tuple[str, ...],
    seed: int,
    time_limit: float,
    deadline: float,
    resume: bool,
    out: str,
) -> None:
    """Say what physics the rig's model leaves out, and prove it on recordings held out."""
    folder = results_folder(out, keeps=Path(rig))
    understood, train, held_out = read_all(rig, recordings, holdout)
    refuse_unfit([*train, *held_out])

    import numpy as np

    from optid.core.budget import Budget
    from optid.diagnosis.pipeline import diagnose as ask
    from optid.effects.library import from_file
    from optid.report.diagnosis_document import diagnosis_document
    from optid.report.diagnosis_page import diagnosis_page
    from optid.report.scores import score_rows
    from optid.rigs.rigfile import write_rig

    own = [effect for file in effects for effect in from_file(Path(file))]
    with progress("diagnosing") as show:
        found = ask(
            understood, [r for r, _ in train], [r for r, _ in held_out], own=own,
            generator=np.random.default_rng(seed), progress=show, budget=Budget(time_limit, deadline),
            checkpoint=checkpoint(folder, resume),
        )  # fmt: skip
    with waiting("writing the report"):
        page, document = diagnosis_page(found), diagnosis_document(found)

    def write(place: Path) -> None:
        write_json(place / "diagnosis.json", document)
        values = {p.name: p.value for p in found.best_parameters}
        write_rig(found.best.rig, place / "rig.toml", values)
        (place / "report.html").write_text(page, encoding="utf-8")

    deliver(folder, write)
    click.echo(f"{found.verdict.value}: {found.summary}")
    for title, part in (("held out, before", "baseline"), ("held out, after", "improved")):
        say_table((title, "fit", "rmse"), score_rows(document[part]["holdout"]))
    click.echo(f"written to {out}: diagnosis.json, rig.toml, report.html")
