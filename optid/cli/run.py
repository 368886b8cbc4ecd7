"""Facts of the run itself: its command line, its inputs with their digests, and whether a signal asked it to stop."""

from __future__ import annotations

import contextlib
import importlib.metadata
import logging
import os
import shlex
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

import click

from optid.core.loading import Loaded, loaded
from optid.core.paths import digest_of


@dataclass
class Run:
    """One call of the command line.

    Attributes:
        command: as it was called.
        inputs: path as named -> SHA-256 of the files that it names, read before the work began.
        delivered: the folder that holds its results, once it does.
        held: whether a request to stop must wait.
        stopped: the signal that arrived meanwhile.
        before: a user's Python files that were run before this run.
    """

    command: str
    inputs: dict[str, str] = field(default_factory=dict)
    delivered: Path | None = None
    held: bool = False
    stopped: str | None = None
    before: tuple[Loaded, ...] = ()

    @property
    def facts(self) -> dict[str, Any]:
        """The origin that every document states."""
        own = {
            str(one.path): one.digest for one in loaded() if all(one is not other for other in self.before)
        }
        version = importlib.metadata.version("optid")
        return {"version": version, "command": self.command, "inputs": {**self.inputs, **own}}


_RUN: ContextVar[Run | None] = ContextVar("run", default=None)


def this_run() -> Run:
    """The present run; one without a command line where optid is used as a library."""
    return _RUN.get() or Run("")


@contextmanager
def begun(arguments: Sequence[str]) -> Iterator[Run]:
    """The context of a run; SIGINT, SIGTERM and a closed terminal end it in the same way."""
    logging.getLogger("matplotlib").setLevel(
        logging.ERROR
    )  # the user need not know where it caches its fonts
    run = Run(shlex.join(["optid", *map(str, arguments)]), before=loaded())
    token = _RUN.set(run)
    before = _listen(run)
    try:
        yield run
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        _RUN.reset(token)


class Stopped(KeyboardInterrupt):
    """A signal asked the run to end; its argument is the signal's name."""


@contextmanager
def undisturbed() -> Iterator[None]:
    """Postpone a request to stop until the file operations inside are done."""
    run = this_run()
    before, run.held = run.held, True
    try:
        yield
    finally:
        run.held = before
    if run.stopped and not run.held:
        raise Stopped(run.stopped)


def note_inputs(context: click.Context) -> None:
    """Digest the files that a command names, except where its results go."""
    run = this_run()
    for name, value in context.params.items():
        for text in value if isinstance(value, tuple) else (value,):
            if name != "out" and isinstance(text, str) and text:
                _note(run, text)


def _note(run: Run, text: str) -> None:
    digest = digest_of(text)
    if digest is not None:  # otherwise the reader of the file reports what is wrong
        run.inputs[text] = digest


def _listen(run: Run) -> dict[int, Any]:
    """Handlers for the signals that end a run; those that were there before."""

    def stop(number: int, _: FrameType | None) -> None:
        name = signal.Signals(number).name
        if run.held and run.stopped is None:  # a second one does not wait
            run.stopped = name
            return
        raise Stopped(name)

    if threading.current_thread() is not threading.main_thread():
        return {}
    names = ("SIGINT", "SIGTERM", "SIGHUP")  # the last one where a terminal can be closed
    wanted = [getattr(signal, name) for name in names if hasattr(signal, name)]
    return {
        number: signal.signal(number, stop)
        for number in wanted
        if signal.getsignal(number) not in (signal.SIG_IGN, None)
    }


@contextmanager
def ended_at_once() -> Iterator[None]:
    """Once a run was asked to stop, do not wait for its threads."""
    try:
        yield
    except SystemExit as end:
        if isinstance(end.__context__, KeyboardInterrupt | click.Abort):
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(Exception):
                    stream.flush()
            os._exit(end.code if isinstance(end.code, int) else 1)
        raise
