"""`optid example`: a rig file and recordings to begin with."""

from __future__ import annotations

import click


@click.command()
@click.argument("folder", metavar="DIR")
def example(folder: str) -> None:
    """Write a sample rig file and recordings into DIR."""
    from optid.datasets import example as write

    files = write(folder)
    click.echo(f"written to {folder}: {', '.join(file.name for file in files)}")
    rig, train, holdout = f"{folder}/bench.toml", f"{folder}/worn.csv", f"{folder}/worn_holdout.csv"
    click.echo("bench.csv was recorded on the axis of bench.toml; worn.csv is the same axis with a fault.")
    click.echo(f"next: optid simulate {rig} {train} --out {folder}/simulation")
    click.echo("      how well does the model predict? about 20 s the first time, while code is compiled")
    click.echo("      which physics does it leave out? about a minute the first time, half of it later:")
    click.echo(f"then: optid diagnose {rig} {train} --holdout {holdout} --out {folder}/diagnosis")
