"""`optid check`: read a rig file and recordings; remark on the data, and say what they can tell of the parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from optid.cli.common import read_all, say_remarks, waiting

if TYPE_CHECKING:
    from optid.core.recording import Recording
    from optid.rigs.rigfile import Rig


@click.command()
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.pass_context
def check(context: click.Context, rig: str, recordings: tuple[str, ...]) -> None:
    """Read a rig file and recordings; remark on the data and on what they can tell of the parameters.

    Exit status 1 when a recording cannot serve a fit, or a parameter to fit has no influence on any.
    """
    understood, read, _ = read_all(rig, recordings)
    worst = False
    for recording, remarks in read:
        grave = say_remarks(recording, remarks)
        worst |= grave
        if not grave:
            _say_lags(understood, recording)
    if understood.freed and not worst:
        worst = _say_identifiability(understood, [recording for recording, _ in read])
    if worst:
        context.exit(1)


def _say_lags(rig: Rig, recording: Recording) -> None:
    """By how much what is measured follows each input, where they resemble each other at all."""
    from optid.quality.motion import answer

    for cause in dict.fromkeys(port.role for port in rig.model.inputs if port.role in recording):
        for role in (port.role for port in rig.model.outputs if port.role in recording):
            answered = answer(recording, cause, role)
            if answered is not None and answered[1].correlation > max(answered[1].chance, 0.3):
                what, lag = answered
                how = f"{1e3 * lag.seconds:.3g} ms, correlation {lag.correlation:.2f}"
                click.echo(f"  {'lag':8}{what} against {cause}: {how}")


def _say_identifiability(rig: Rig, recordings: list[Recording]) -> bool:
    """What the data tell of the parameters to fit; is one without influence?"""
    from optid.estimation.identifiability import identifiability

    with waiting("examining what the data can tell"):
        ties = identifiability(rig, recordings)
    freed = {parameter.name for parameter in rig.freed}
    idle = [name for name in ties.idle if name in freed]
    free = len(ties.mute)
    click.echo(f"what these data tell of {free} parameters, at the rig file's values and before any fit:")
    sd, leader = ties.weakest
    click.echo(f"  rank {ties.rank} of {free}, condition number of the sensitivities {ties.condition:.2g}")
    if idle:
        click.echo(f"  without influence: {', '.join(idle)}; a fit would be refused")
    for sentence in ties.sentences:
        click.echo(f"  {sentence}")
    if not ties.sentences:
        click.echo(f"  each has an effect of its own; the weakest direction is {leader}, known to {sd:.1%}")
    return bool(idle)
