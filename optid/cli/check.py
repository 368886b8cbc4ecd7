"""`optid check`: read a rig file and recordings; remark on the data, and say what they are fit for."""

from __future__ import annotations

import math
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from optid.cli.common import RATE, deliver, read_all, results_folder, say_remarks, waiting, write_json

if TYPE_CHECKING:
    from optid.core.recording import Recording
    from optid.rigs.rigfile import Rig


@click.command()
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.option("--out", metavar="DIR", help="Write check.json and report.html there; made if absent.")
@RATE
@click.pass_context
def check(context: click.Context, rig: str, recordings: tuple[str, ...], out: str | None) -> None:
    """Read a rig file and recordings; remark on the data and on what they can tell of the parameters.

    Exit status 0 with or without remarks, 1 when a recording cannot serve a fit or a parameter to fit has no influence
    on any, 2 when a file cannot be read.
    """
    folder = results_folder(out) if out is not None else None
    understood, read, _ = read_all(rig, recordings)

    from optid.quality.verdict import verdict

    grave = False
    for recording, remarks in read:
        bad = say_remarks(recording, remarks)
        grave |= bad
        if not bad:
            _say_lags(understood, recording)
    told = _identifiability(understood, [r for r, _ in read]) if understood.freed and not grave else None
    idle = told["without_influence"] if told else []
    found = verdict(read, idle, [p.name for p in understood.freed], shlex.join([rig, *recordings]))
    if folder is not None:
        _write(folder, understood, read, found, told)
        click.echo(f"written to {out}: check.json, report.html")
    click.echo(found.sentence)
    if grave or idle:
        context.exit(1)


def _write(folder: Path, rig: Rig, read: Any, found: Any, told: dict[str, Any] | None) -> None:
    from optid.report.check_page import check_document, check_page

    document = check_document(rig, read, found, told)
    page = check_page(rig, read, found, told)

    def write(place: Path) -> None:
        write_json(place / "check.json", document)
        (place / "report.html").write_text(page, encoding="utf-8")

    deliver(folder, write)


def _say_lags(rig: Rig, recording: Recording) -> None:
    """By how much what is measured follows each input, where they resemble each other at all."""
    from optid.quality.motion import answer

    for cause in dict.fromkeys(port.role for port in rig.model.inputs if port.role in recording):
        for role in (port.role for port in rig.model.outputs if port.role in recording):
            answered = answer(recording, cause, role)
            if answered is not None and answered[1].correlation > max(answered[1].chance, 0.3):
                what, lag = answered
                how = f"{1e3 * lag.seconds:.3g} ms, correlation {lag.sign * lag.correlation:.2f}"
                click.echo(f"  {'lag':8}{what} against {cause}: {how}")


def _identifiability(rig: Rig, recordings: list[Recording]) -> dict[str, Any]:
    """What the data tell of the parameters to fit, said and as a document."""
    from optid.estimation.identifiability import identifiability

    with waiting("examining what the data can tell"):
        ties = identifiability(rig, recordings)
    freed = {parameter.name for parameter in rig.freed}
    idle = [name for name in ties.idle if name in freed]
    free = len(ties.mute)
    sd, leader = ties.weakest
    sentences = list(ties.sentences) or [
        f"each has an effect of its own; the weakest direction is {leader}, known to {sd:.1%}"
    ]
    click.echo(f"what these data tell of {free} parameters, at the rig file's values and before any fit:")
    click.echo(f"  rank {ties.rank} of {free}, condition number of the sensitivities {ties.condition:.2g}")
    if idle:
        click.echo(f"  without influence: {', '.join(idle)}; a fit would be refused")
    for sentence in sentences:
        click.echo(f"  {sentence}")
    return {
        "parameters": free,
        "rank": int(ties.rank),
        "condition": float(ties.condition) if math.isfinite(ties.condition) else None,
        "without_influence": idle,
        "sentences": sentences,
    }
