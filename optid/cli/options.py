"""Options that every command takes: `--progress`, `--threads`, `--outside-files`."""

from __future__ import annotations

import os

import click

from optid.cli import progress
from optid.core.cache import first_compile
from optid.core.loading import OUTSIDE, outside_allowed

# Libraries that start threads of their own read these when they are imported, which the commands do later.
_THREADS = (
    "OPTID_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
    "BLIS_NUM_THREADS",
)


def everywhere(command: click.Command) -> click.Command:
    """Add the options that every command has."""
    command.params += [
        click.Option(
            ["--progress"],
            type=click.Choice(progress.CHOICES),
            default="auto",
            expose_value=False,
            callback=_progress,
            help="A bar where stderr is a terminal (auto), nothing (none), or JSON lines on stderr (json).",
        ),
        click.Option(
            ["--threads"],
            type=click.IntRange(1, 4096),
            metavar="N",
            envvar="OPTID_THREADS",
            expose_value=False,
            is_eager=True,
            callback=_threads,
            help="Largest number of cores; all by default (OPTID_THREADS).",
        ),
        click.Option(
            [OUTSIDE],
            is_flag=True,
            expose_value=False,
            callback=_outside,
            help="Allow a rig file to run Python files from outside its folder.",
        ),
    ]
    return command


def _progress(context: click.Context, _: click.Parameter, value: str) -> str:
    context.call_on_close(lambda: progress.choose("auto"))
    progress.choose(value)
    first_compile(lambda: progress.tell_first_compile(value))
    return value


def _threads(context: click.Context, _: click.Parameter, value: int | None) -> int | None:
    if value is not None:
        from optid.core.threads import limit

        before = {name: os.environ.get(name) for name in _THREADS}
        os.environ.update(dict.fromkeys(_THREADS, str(value)))
        limit(value)
        context.call_on_close(lambda: _restore(before))
    return value


def _restore(before: dict[str, str | None]) -> None:
    from optid.core.threads import limit

    for name, value in before.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value
    limit(None)


def _outside(context: click.Context, _: click.Parameter, value: bool) -> bool:
    if value:
        context.with_resource(outside_allowed())
    return value
