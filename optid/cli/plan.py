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
    "--rivals",
    metavar="NAMES",
    help="Effects to distinguish, as in valve_lag,input_delay; or one effect to detect.",
)
@click.option(
    "--diagnosis",
    metavar="DIR",
    help="Folder of a diagnosis (or diagnosis.json): distinguish the effects that it left open.",
)
@click.option(
    "--seconds",
    type=POSITIVE,
    default=12.0,
    show_default=True,
    metavar="S",
    help="Duration of the experiment.",
)
@click.option("--rate", type=POSITIVE, metavar="HZ", help="Sampling rate; the rig file's by default.")
@click.option(
    "--gains",
    metavar="WHAT",
    help='Controller gains: a pid.json, or "kp=40 ki=60"; cautious gains by default.',
)
@click.option(
    "--effects",
    multiple=True,
    metavar="FILE.py",
    help="Python file with effects of your own; may be repeated.",
)
@click.option(
    "--seed", default=0, type=click.IntRange(min=0), help="Seed of all random numbers; 0 by default."
)
@OUT
def plan(rig: str, out: str, **choices: Any) -> None:
    """Write the experiment that best distinguishes rival effects: a reference within stroke and limits."""
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
    click.echo(f"next: {_call(rig, Path(out), result.document['seconds'], choices)}")


def _call(rig: str, out: Path, seconds: float, choices: dict[str, Any]) -> str:
    """The command that runs the plan."""
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
    """Names of effects, or the path of a diagnosis."""
    if (choices["rivals"] is None) == (choices["diagnosis"] is None):
        found = "neither is given" if choices["rivals"] is None else "both are given"
        raise InputError(found, where="--rivals, --diagnosis", expected="one of the two")
    return Path(choices["diagnosis"]) if choices["rivals"] is None else str(choices["rivals"])
