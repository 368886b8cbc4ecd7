"""`optid plan`: which experiment to run next."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from optid.cli.common import OUT, deliver, progress, results_folder, say_table, write_json
from optid.errors import InputError

if TYPE_CHECKING:
    from optid.effects.effect import Effect
    from optid.experiments.files import Planned
    from optid.experiments.loop import Loop
    from optid.rigs.rigfile import Rig

POSITIVE = click.FloatRange(min=0, min_open=True)


@click.command()
@click.argument("rig")
@click.option(
    "--rivals", metavar="NAMES", help="Effects to tell apart: valve_lag,input_delay; one to show it."
)
@click.option(
    "--diagnosis", metavar="DIR", help="Instead: what this diagnosis (or diagnosis.json) left open."
)
@click.option(
    "--seconds", type=POSITIVE, default=12.0, show_default=True, metavar="S", help="Of the experiment."
)
@click.option("--rate", type=POSITIVE, metavar="HZ", help="Samples a second; the rig file's where absent.")
@click.option("--gains", metavar="WHAT", help='A pid.json, or "kp=40 ki=60"; gentle ones where absent.')
@click.option("--effects", multiple=True, metavar="FILE.py", help="Effects of your own.")
@click.option("--seed", default=0, type=click.IntRange(min=0), help="Of everything random; 0 by default.")
@OUT
def plan(rig: str, out: str, **choices: Any) -> None:
    """Write the experiment that tells rival effects apart best: a reference within stroke and limits."""
    folder = results_folder(out)

    import numpy as np

    from optid.experiments.design import design
    from optid.experiments.files import Planned, document, table
    from optid.report.plan_page import plan_page
    from optid.rigs.rigfile import read_rig

    for name in ("seconds", "rate"):
        if choices[name] is not None and not math.isfinite(choices[name]):
            raise InputError("not finite", where=f"--{name}", expected="a number")
    understood = read_rig(rig)
    loop, rivals = _loop(understood, choices), _rivals(understood, choices)
    with progress("planning") as show:
        found = design(loop, rivals, choices["seconds"], np.random.default_rng(choices["seed"]), show)
    planned = Planned(loop, found, choices["seed"])
    files = {"experiment.csv": table(planned), "report.html": plan_page(planned)}
    content = document(planned)

    def write(place: Path) -> None:
        write_json(place / "plan.json", content)
        for name, text in files.items():
            (place / name).write_text(text, encoding="utf-8")

    deliver(folder, write)
    _say(planned)
    click.echo(f"written to {out}: experiment.csv, plan.json, report.html")
    click.echo(f"run it: {_call(rig, Path(out), planned, choices)}")


def _call(rig: str, out: Path, planned: Planned, choices: dict[str, Any]) -> str:
    """The session that follows the plan."""
    call = [
        "optid",
        "live",
        rig,
        "--reference",
        str(out / "experiment.csv"),
        "--seconds",
        f"{planned.seconds:g}",
    ]
    for name in ("rate", "gains"):
        if choices[name] is not None:
            call += [f"--{name}", str(choices[name])]
    return shlex.join([*call, "--out", str(out / "run")])


def _loop(rig: Rig, choices: dict[str, Any]) -> Loop:
    from optid.experiments.loop import Loop, refuse_endless, refuse_unfit
    from optid.live.gains import controller_settings, gentle, read_gains
    from optid.live.settings import live_settings

    refuse_unfit(rig)
    settings = live_settings(rig, choices["rate"])
    refuse_endless(rig, settings)
    gains, pid = (
        read_gains(choices["gains"], settings) if choices["gains"] else (gentle(settings.limits), None)
    )
    return Loop(rig, settings, gains, controller_settings(settings, pid))


def _rivals(rig: Rig, choices: dict[str, Any]) -> tuple[Effect, ...]:
    from optid.effects.library import from_file
    from optid.experiments.rivals import from_diagnosis, named

    if (choices["rivals"] is None) == (choices["diagnosis"] is None):
        found = "neither is given" if choices["rivals"] is None else "both are given"
        raise InputError(found, where="--rivals, --diagnosis", expected="one of them")
    own = [effect for file in choices["effects"] for effect in from_file(Path(file))]
    if choices["rivals"] is None:
        return named(from_diagnosis(Path(choices["diagnosis"])), rig, own, "--diagnosis")
    return named([name.strip() for name in choices["rivals"].split(",")], rig, own)


def _say(planned: Planned) -> None:
    from optid.experiments.separation import NEEDED

    rows = planned.design.separations
    click.echo(
        f"{planned.seconds:g} s at {planned.loop.settings.rate:g} Hz: {'; '.join(planned.design.names)}"
    )
    say_table(
        ("there", "mistaken for", "sd", "by plain steps", "seconds needed"),
        tuple(
            (row.there, row.instead or "nothing", f"{row.planned:.2f}", f"{row.plain:.2f}",
             f"{row.seconds:.3g}" if math.isfinite(row.seconds) else "no length")
            for row in rows
        ),
    )  # fmt: skip
    click.echo(
        f"sd: between the two, the first at the smallest size worth a name; {NEEDED:g} err once in a hundred"
    )
