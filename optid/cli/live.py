"""`optid live`: a rig and its simulation side by side, sample by sample."""

from __future__ import annotations

import math
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from optid.cli import progress
from optid.cli.armax_options import FORGETTING
from optid.cli.common import OUT, deliver, results_folder, say_next, say_table, write_json
from optid.errors import InputError, JobError

if TYPE_CHECKING:
    import socket

    from optid.armax.identifier import Settings as Learning
    from optid.armax.structure import Orders
    from optid.live.excitation import Excitation
    from optid.live.page.access import Access
    from optid.live.plan import Plan
    from optid.live.session import Session
    from optid.live.settings import Settings
    from optid.rigs.rigfile import Rig

POLL = 0.05  # s between polls of a running session
POSITIVE = click.FloatRange(min=0, min_open=True)


@click.command()
@click.argument("rig")
@click.option(
    "--driver",
    default="simulated",
    metavar="NAME",
    show_default=True,
    help="simulated, replay, nidaqmx, opcua, or path/to/file.py:function.",
)
@OUT
@click.option(
    "--seconds", type=POSITIVE, metavar="S", help="Duration; without it the session runs until it is stopped."
)
@click.option("--rate", type=POSITIVE, metavar="HZ", help="Sampling rate; the rig file's by default.")
@click.option(
    "--reference",
    metavar="WHAT",
    help='"60 mm", "0:0 mm, 2:60 mm", "sine 20 mm 0.5 Hz", "tour", or a recording.',
)
@click.option(
    "--command",
    metavar="WHAT",
    help='Open-loop command: "impulse 2 V 40 ms", steps, a ramp, a multisine, or a recording with a command.',
)
@click.option(
    "--gains",
    metavar="WHAT",
    help='Controller gains: a pid.json, or "kp=40 ki=60"; cautious gains by default.',
)
@click.option(
    "--order",
    type=click.IntRange(1, 12),
    metavar="N",
    help="Order na = nb = nc of the ARMAX model; 4 by default.",
)
@click.option(
    "--na", type=click.IntRange(1, 12), metavar="N", help="Number of coefficients of A, instead of --order."
)
@click.option(
    "--nb", type=click.IntRange(1, 12), metavar="N", help="Number of coefficients of B; na by default."
)
@click.option(
    "--nc",
    type=click.IntRange(0, 12),
    metavar="N",
    help="Number of coefficients of C; na by default, 0 gives ARX.",
)
@click.option("--delay", default=1, type=click.IntRange(1, 1000), show_default=True, help="Delay in samples.")
@click.option(
    "--method",
    type=click.Choice(["rml", "rls"]),
    default="rml",
    show_default=True,
    help="Recursive estimator: maximum likelihood, or the paper's least squares.",
)
@FORGETTING
@click.option(
    "--dither",
    default=0.0,
    type=click.FloatRange(min=0),
    metavar="V",
    help="Amplitude of a random binary signal added to the command.",
)
@click.option(
    "--tune", "tune_after", type=POSITIVE, metavar="S", help="Tune after this time and apply the gains."
)
@click.option(
    "--sensitivity",
    default=1.2,
    type=click.FloatRange(min=1, min_open=True),
    show_default=True,
    metavar="MS",
    help="Upper limit of the maximum sensitivity of tuned gains; 2 is fast, 1.2 cautious.",
)
@click.option(
    "--since",
    metavar="FILE",
    help="live.json of an earlier session to compare with; the rig file by default.",
)
@click.option("--page", is_flag=True, help="Show and control the session in a browser on this machine.")
@click.option(
    "--host",
    default="127.0.0.1",
    metavar="NAME",
    show_default=True,
    help="Address at which the page is served.",
)
@click.option(
    "--port", default=0, type=click.IntRange(0, 65535), help="Port of the page; a free one by default."
)
@click.option("--token", metavar="TEXT", help="Token that opens the page; random by default.")
@click.option("--recording", metavar="FILE", help="Recording for the replay driver.")
@click.option("--fast", is_flag=True, help="Run faster than real time: simulated and replay drivers only.")
@click.option("--seed", default=0, type=click.IntRange(min=0), help="Seed of all random numbers.")
def live(rig: str, driver: str, out: str, **choices: Any) -> None:
    """Run a rig and its simulation in parallel: read, identify, simulate, control, log."""
    folder = results_folder(out)

    from optid.armax.files import to_json
    from optid.live.log import LOG
    from optid.live.results import identified, live_document
    from optid.live.session import Session

    if (folder / LOG).exists():
        raise InputError(f"{out} holds a {LOG} already", where="--out", expected="a folder without one")
    plan = _plan(Path(rig), driver, folder, choices)
    if not choices["page"]:
        _no_page()
    way_in = _way_in(choices) if choices["page"] else None
    folder.mkdir(parents=True, exist_ok=True)
    session = Session(plan)
    try:
        with _stopped_by_signals(session):
            _run(session, choices["tune_after"], way_in)
    finally:
        session.close()
    document, model = live_document(session), identified(session)
    page = _report(session, document, f"optid diagnose {rig} {out}/{LOG} --holdout OTHER --out out/diagnosis")

    def write(place: Path) -> None:
        write_json(place / "live.json", document)
        if model is not None:
            (place / "armax.json").write_text(to_json(model), encoding="utf-8")
        (place / "report.html").write_text(page, encoding="utf-8")

    deliver(folder, write)
    _say(document)
    names = [
        *([LOG] if (folder / LOG).exists() else []),
        "live.json",
        "report.html",
        *(["armax.json"] if model else []),
    ]
    click.echo(f"written to {out}: {', '.join(names)}")
    if document["followed"] is not None:
        click.echo(document["followed"]["words"])
    if document["parted"]:
        click.echo(f"rig and model disagree; to find what is missing, next: {document['diagnosis']}")
    else:
        say_next("fit", rig, f"{out}/{LOG}", "--out", "DIR")
    if document["outcome"] == "failed":
        raise JobError(f"{document['why']}; the recording up to that moment is in {out}")


def _plan(rig: Path, driver: str, folder: Path, choices: dict[str, Any]) -> Plan:
    from optid.live.driver import check_driver_name
    from optid.live.gains import gentle, read_gains
    from optid.live.loop import Choices
    from optid.live.plan import Plan
    from optid.live.reference import Reference, read_reference, tour
    from optid.live.settings import live_settings, wiring_of
    from optid.pid.controller import Gains
    from optid.rigs.rigfile import read_rig

    for name in ("seconds", "rate", "dither"):
        if choices[name] is not None and not math.isfinite(choices[name]):
            raise InputError("not finite", where=f"--{name}", expected="a number")
    check_driver_name(driver)
    if choices["fast"] and driver not in ("simulated", "replay"):
        raise InputError(
            f"it cannot run with --driver {driver}", where="--fast", expected="the driver simulated or replay"
        )
    understood = read_rig(rig)
    settings, wiring = live_settings(understood, choices["rate"]), wiring_of(understood)
    limits, wanted = settings.limits, choices["reference"]
    command = _command(choices, understood, settings)
    if command is not None:
        reference, gains, pid = Reference((0.0,), (math.nan,)), Gains(0.0), None
    else:
        unit = wiring.measured[0].recorded_unit
        reference = read_reference(wanted, understood, limits, unit) if wanted else tour(limits)
        gains, pid = read_gains(choices["gains"], settings) if choices["gains"] else (gentle(limits), None)
    recording = Path(choices["recording"]) if choices["recording"] else None
    return Plan(
        rig,
        driver,
        folder,
        reference,
        Choices(
            gains, _orders(choices), _learning(choices), choices["dither"], choices["seed"], pid, command
        ),
        choices["seconds"] or (command.seconds if command else None),
        choices["rate"],
        choices["fast"],
        recording,
        choices["seed"],
        choices["sensitivity"],
        choices["tune_after"] if choices["fast"] else None,
        Path(choices["since"]) if choices["since"] else None,
    )


def _command(choices: dict[str, Any], rig: Rig, settings: Settings) -> Excitation | None:
    """The open-loop experiment, if one is requested."""
    from optid.live.excitation import read_command
    from optid.live.settings import wiring_of

    if not choices["command"]:
        return None
    for name in ("reference", "gains", "tune_after", "dither"):
        if choices[name]:
            option = name.removesuffix("_after")
            raise InputError(
                f"it is given together with --{option}",
                where="--command",
                expected="only one of the two: in open loop nothing is controlled",
            )
    channel = wiring_of(rig).command
    return read_command(choices["command"], rig, settings, channel.role, channel.recorded_unit)


def _orders(choices: dict[str, Any]) -> Orders:
    """The orders of eq. 12, from the options."""
    from optid.armax.structure import Orders

    if choices["order"] is not None and choices["na"] is not None:
        raise InputError("it is given together with --order", where="--na", expected="only one of the two")
    na = choices["na"] or choices["order"] or 4
    nb, nc = (na if choices[name] is None else choices[name] for name in ("nb", "nc"))
    return Orders(na, (nb,), nc, (choices["delay"],))


def _learning(choices: dict[str, Any]) -> Learning:
    """The settings of the recursion, from the options."""
    from optid.armax.identifier import Method
    from optid.armax.identifier import Settings as Learning

    method = Method.EXTENDED_LEAST_SQUARES if choices["method"] == "rls" else Method.MAXIMUM_LIKELIHOOD
    given = {} if choices["forgetting"] is None else {"forgetting": choices["forgetting"]}
    return Learning(method, **given)


def _no_page() -> None:
    """Refuse options of the page without --page: they are a mistake, and one of them protects access."""
    context = click.get_current_context()
    for name in ("token", "host", "port"):
        if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE:
            raise InputError("it is given without --page", where=f"--{name}", expected="--page as well")


def _way_in(choices: dict[str, Any]) -> tuple[Access, socket.socket]:
    """Access to the page and its socket, which is opened before the session begins."""
    if choices["token"] == "":
        raise InputError("it is empty", where="--token", expected="a word that is hard to guess")
    try:
        from optid.live.page.access import Access
    except ImportError as error:
        raise InputError(f"{error}", where="--page", hint='pip install "optid[page]"') from None
    given = {"token": choices["token"]} if choices["token"] else {}
    access = Access(choices["host"], choices["port"], **given)
    try:
        return access, access.listen()
    except OSError as error:
        raise InputError(
            f"the page cannot be served at {access.host}:{access.port} ({error})", where="--port"
        ) from None


@contextmanager
def _stopped_by_signals(session: Session) -> Iterator[None]:
    """On Ctrl-C or SIGTERM the guard writes the safe command and ends the session."""

    def stop(number: int, _: object) -> None:
        session.stop("Ctrl-C" if number == signal.SIGINT else "SIGTERM")

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _run(session: Session, tune_after: float | None, way_in: tuple[Access, socket.socket] | None) -> None:
    """From the first sample to the last, with a page or without."""
    from optid.live.automatic_tuning import AutomaticTuning

    said, pilot = 0, AutomaticTuning(session, tune_after)

    def after_poll() -> None:
        nonlocal said
        pilot.look()
        for event in session.events.since(said):
            click.echo(f"{event.time:8.1f} s  {event.words}")
            share = None if session.plan.seconds is None else min(event.time / session.plan.seconds, 1.0)
            progress.event("live", share, event.words)
        said = session.events.number

    def begin(address: str | None = None) -> None:
        if address is not None:
            click.echo(f"the page: {address}")
        session.go()

    if way_in is not None:
        import asyncio

        from optid.live.page.server import watch

        asyncio.run(watch(session, way_in, begin, after_poll))
        return
    begin()
    while session.end is None:
        time.sleep(POLL)
        session.poll()
        after_poll()


def _report(session: Session, document: dict[str, Any], following: str) -> str:
    """The page on the last minute and its last step."""
    from optid.live.log import LOG
    from optid.live.results import last_stretch
    from optid.report.live_page import live_page

    path = session.plan.out / LOG
    minute = last_stretch(path, session.wiring, session.settings) if path.is_file() else None
    shown = []
    if minute is not None:
        shown.append((f"From {minute.time[0]:.0f} to {minute.time[-1]:.0f} s", minute))
        if minute.last_step is not None:
            shown.append((f"The step at {minute.last_step:.2f} s", minute.around(minute.last_step)))
    return live_page(document, f"{session.rig_name}: live", shown, session.tuning.review, following)


def _say(document: dict[str, Any]) -> None:
    click.echo(
        f"{document['samples']} samples, {document['missed']} deadlines missed, "
        f"{document['held_back']} commands held back by a limit"
    )
    rows = [
        (name, *(f"{timing[f'{column}_us']:.0f}" for column in ("mean", "p50", "p99", "max")))
        for name, timing in document["timing"].items()
        if timing is not None
    ]
    if rows:
        say_table(("microseconds", "mean", "median", "99 %", "largest"), tuple(rows))
    rows = [(name, "–" if fit is None else f"{fit:.2f} %") for name, fit in document["fit_percent"].items()]
    say_table(("position", "fit"), tuple(rows))
