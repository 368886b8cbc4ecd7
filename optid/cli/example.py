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
    click.echo("bench.toml and bench.csv belong together; worn.csv is the same axis with a fault. Try")
    click.echo(f"  optid simulate {rig} {train} --out {folder}/simulation")
    click.echo("      how far the model carries: 25 s at first, as code is compiled, then 5 s")
    click.echo(f"  optid diagnose {rig} {train} --holdout {holdout} --out {folder}/diagnosis")
    click.echo("      what it leaves out: about two minutes at first, then one")
