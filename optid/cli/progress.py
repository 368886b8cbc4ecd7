"""How a command shows the progress of a job: a bar on a terminal, JSON lines for a program, or nothing."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

import click

CHOICES = ("auto", "none", "json")
_CHOSEN: ContextVar[str] = ContextVar("progress", default="auto")


def choose(how: str) -> None:
    """One of `CHOICES`: "auto" shows a bar on a terminal and nothing elsewhere, "json" writes lines to stderr."""
    _CHOSEN.set(how)


def _shown() -> bool:
    return _CHOSEN.get() == "auto" and sys.stderr.isatty()


def _line(what: str, share: float | None, words: str) -> None:
    """One JSON line: `stage`, `share` done from 0 to 1 or null, `words`."""
    content = {"stage": what, "share": None if share is None else round(share, 4), "words": words}
    click.echo(json.dumps(content, ensure_ascii=False), err=True)


def event(what: str, share: float | None, words: str) -> None:
    """A JSON line for an event that is also printed on stdout."""
    if _CHOSEN.get() == "json":
        _line(what, share, words)


@contextmanager
def waiting(what: str) -> Iterator[None]:
    """For a short step: a spinner, or one line at its start and one at its end."""
    if _shown():
        from rich.console import Console

        with Console(stderr=True).status(what):
            yield
        return
    if _CHOSEN.get() == "json":
        _line(what, 0.0, "")
    yield
    if _CHOSEN.get() == "json":
        _line(what, 1.0, "done")


@contextmanager
def progress(what: str) -> Iterator[Callable[[float, str], None]]:
    """For a longer job; yields a function of the share done and a few words."""
    if _CHOSEN.get() == "json":
        yield _each_new(what)
        _line(what, 1.0, "done")
        return
    if not _shown():
        yield lambda share, words: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.fields[now]}"),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        task = bars.add_task(what, total=1.0, now="")
        yield lambda share, words: bars.update(task, completed=share, now=words)


def _each_new(what: str) -> Callable[[float, str], None]:
    """Print a line when the share changed by a hundredth, or the words changed."""
    last: tuple[float, str] | None = None

    def show(share: float, words: str) -> None:
        nonlocal last
        if last is None or abs(share - last[0]) >= 0.01 or words != last[1]:
            last = (share, words)
            _line(what, share, words)

    return show


def tell_first_compile(how: str) -> None:
    """Report, in one of the ways of `CHOICES`, that functions are being compiled, which takes a minute."""
    words = "compiling optid's functions for this machine: about a minute, once per version"
    if how == "json":
        _line("compiling", None, words)
    elif how == "auto" and sys.stderr.isatty():
        click.echo(words, err=True)
