"""`optid plan`: which experiment to run next."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import Any

import click

from optid.cli.common import OUT, deliver, placed, progress, results_folder
from optid.errors import InputError

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
    for name in ("seconds", "rate"):
        if choices[name] is not None and not math.isfinite(choices[name]):
            raise InputError("not finite", where=f"--{name}", expected="a number")
    wanted = _rivals(choices)

    from optid.api.planning import plan as run

    with progress("planning") as show:
        result = run(
            rig,
            wanted,
            seconds=choices["seconds"],
            rate=choices["rate"],
            gains=choices["gains"],
            effects=choices["effects"],
            seed=choices["seed"],
            progress=show,
        )
    deliver(folder, placed(result, out).write)
    click.echo(result.summary())
    click.echo(f"written to {out}: {', '.join(result.written)}")
    click.echo(f"run it: {_call(rig, Path(out), result.document['seconds'], choices)}")


def _call(rig: str, out: Path, seconds: float, choices: dict[str, Any]) -> str:
    """The session that follows the plan."""
    call = [
        "optid",
        "live",
        rig,
        "--reference",
        str(out / "experiment.csv"),
        "--seconds",
        f"{seconds:g}",
    ]
    for name in ("rate", "gains"):
        if choices[name] is not None:
            call += [f"--{name}", str(choices[name])]
    return shlex.join([*call, "--out", str(out / "run")])


def _rivals(choices: dict[str, Any]) -> str | Path:
    """Names, or where a diagnosis lies."""
    if (choices["rivals"] is None) == (choices["diagnosis"] is None):
        found = "neither is given" if choices["rivals"] is None else "both are given"
        raise InputError(found, where="--rivals, --diagnosis", expected="one of them")
    return Path(choices["diagnosis"]) if choices["rivals"] is None else str(choices["rivals"])
