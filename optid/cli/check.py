"""`optid check`: read a rig file and recordings; report on the quality of the data and what they can be used for."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

import click

from optid.cli.common import RATE, deliver, read_all, results_folder, say_remarks, waiting

if TYPE_CHECKING:
    from optid.core.recording import Recording
    from optid.rigs.rigfile import Rig


@click.command()
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.option("--out", metavar="DIR", help="Folder for check.json and report.html; made if absent.")
@click.option(
    "--detectability",
    is_flag=True,
    help="Also list the smallest size of each effect that these recordings would show and distinguish from others.",
)
@RATE
@click.pass_context
def check(
    context: click.Context, rig: str, recordings: tuple[str, ...], out: str | None, detectability: bool
) -> None:
    """Read a rig file and recordings; report on the quality of the data and on the identifiability of the parameters.

    Exit status 0 with or without remarks, 1 when a recording cannot be fitted or a parameter to fit has no influence
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
    seen = None
    if detectability and not grave:
        from optid.api.checking import what_they_could_show

        with waiting("sensitivity to each effect"):
            seen = what_they_could_show(understood, [r for r, _ in read])
    if folder is not None or seen is not None:
        from optid.api.checking import result_of

        result = result_of(understood, read, found, told, seen)
        for line in result.detectability:
            click.echo(line)
    if folder is not None:
        deliver(folder, result.write)
        click.echo(f"written to {out}: {', '.join(result.written)}")
    click.echo(found.sentence)
    if grave or idle:
        context.exit(1)


def _say_lags(rig: Rig, recording: Recording) -> None:
    """The lag of each measured signal behind each input, where they are correlated."""
    from optid.quality.quality import lags

    for what, cause, lag in lags(recording, rig.model):
        how = f"{1e3 * lag.seconds:.3g} ms, correlation {lag.sign * lag.correlation:.2f}"
        click.echo(f"  {'lag':8}{what} against {cause}: {how}")


def _identifiability(rig: Rig, recordings: list[Recording]) -> dict[str, Any]:
    """Identifiability of the parameters to fit: printed, and returned as a document."""
    from optid.api.checking import what_they_tell

    with waiting("checking identifiability"):
        told = what_they_tell(rig, recordings)
    free, condition = told["parameters"], told["condition"]
    size = "inf" if condition is None else f"{condition:.2g}"
    click.echo(f"identifiability of {free} parameters at the rig file's values, before any fit:")
    click.echo(f"  rank {told['rank']} of {free}, condition number of the sensitivities {size}")
    if told["without_influence"]:
        click.echo(
            f"  no influence on the data: {', '.join(told['without_influence'])}; a fit would be refused"
        )
    for sentence in told["sentences"]:
        click.echo(f"  {sentence}")
    return told
