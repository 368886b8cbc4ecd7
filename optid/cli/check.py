"""`optid check`: read a rig file and recordings, and remark on the data."""

from __future__ import annotations

import click

from optid.cli.common import read_all, say_remarks


@click.command()
@click.argument("rig")
@click.argument("recordings", metavar="RECORDING...", nargs=-1, required=True)
@click.pass_context
def check(context: click.Context, rig: str, recordings: tuple[str, ...]) -> None:
    """Read a rig file and recordings, and remark on the data.

    Exit status 1 when a recording cannot serve a fit.
    """
    _, read, _ = read_all(rig, recordings)
    worst = False
    for recording, remarks in read:
        worst |= say_remarks(recording, remarks)
    if worst:
        context.exit(1)
