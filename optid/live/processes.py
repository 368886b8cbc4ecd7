"""The guard and the loop as processes of their own, with what they say to the session that started them."""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import json
import os
import signal
from multiprocessing.connection import Connection
from types import FrameType
from typing import Any

from optid.live.clock import FastClock, RealClock
from optid.live.driver import VIRTUAL, Driver, open_driver
from optid.live.failsafe import Failsafe
from optid.live.guard import End, Guard, Stop
from optid.live.ipc import PipeLink, ready, receive, refuse, send
from optid.live.log import LOG, Layout, Log
from optid.live.loop import Loop
from optid.live.messages import pack_reply, unpack_sample
from optid.live.plan import SLOW, Plan, ring_sizes, session_settings
from optid.live.reference import Reference
from optid.live.ring_buffer import RingBuffer
from optid.live.settings import wiring_of
from optid.pid.controller import Gains
from optid.rigs.rigfile import read_rig

GUARD_SCHEMA = "optid.guard/1"
GUARD_FILE = "guard.json"  # how the session ended, by the guard: written even where the other processes died
# Why new gains went, by the verdict on them.
BACK = {"worse": "they were worse", "undecided": "they were not shown to be as good"}
PRIORITY = 20  # among real-time processes, where the system lets us be one


def guard_process(plan: Plan, link: Connection, session: Connection) -> None:
    """Open the driver, wait for the word to go, run the samples, say how it ended."""
    stops = _deaf_but_for_terminate()
    try:
        guard, log, rate = _prepared(plan, link, session)
    except Exception as error:
        refuse(session, error)
        return
    _steady(plan)
    send(session, say="ready", hides=str(getattr(guard.driver, "hides", "")))
    hold = None if plan.hold is None else round(plan.hold * rate)

    def asked() -> None:
        nonlocal hold
        if stops:
            raise Stop("SIGTERM")
        if hold is not None and guard.tally.samples >= hold:
            hold = None
            send(session, say="holding")
            _orders(session)  # blocks until the word to go on
        if ready([session], 0.0):
            _orders(session)

    end: End | None = None
    try:
        _orders(session)  # blocks until the word to go
        samples = None if plan.seconds is None else max(1, round(plan.seconds * rate))
        end = guard.run(samples, asked)
    except Stop as stop:  # before it began
        refuse(session, stop, guard.make_safe() is not None)
    finally:
        with contextlib.suppress(Exception):
            if guard.driver is not None:
                guard.driver.close()
        log.close()
        if end is not None:
            document = {**dataclasses.asdict(end), "how": end.how.name.lower()}
            _whole(plan, document)
            send(session, say="end", **document)


def _prepared(plan: Plan, link: Connection, session: Connection) -> tuple[Guard, Log, float]:
    """The guard with its driver open, its log, and the rate, Hz."""
    rig = read_rig(plan.rig)
    wiring, settings = wiring_of(rig), session_settings(plan, rig)
    order = {"wiring": wiring, "settings": settings, "recording": plan.recording, "seed": plan.seed}

    def opened() -> Driver:
        return open_driver(plan.driver, rig, order)

    def unsafe() -> None:
        send(session, say="unsafe")

    driver = opened()
    try:
        log = Log(plan.out / LOG, Layout(wiring).columns)
    except OSError:
        driver.close()
        raise
    clock = FastClock(settings.span) if plan.fast else RealClock(settings.span)
    virtual = plan.driver in VIRTUAL
    failsafe = Failsafe(0.0 if virtual else settings.safe_time, None if virtual else opened, unsafe)
    guard = Guard(driver, PipeLink(link), clock, wiring, settings, log, failsafe)
    return guard, log, settings.rate


def _orders(session: Connection) -> None:
    """One word from the session; its death is an order to stop."""
    try:
        message = receive(session)
    except (EOFError, OSError):
        raise Stop("the session that started it has ended") from None
    if message["do"] == "stop":
        raise Stop(str(message["why"]))


def _deaf_but_for_terminate() -> list[int]:
    """Ctrl-C is for the session, which passes it on; SIGTERM ends the samples in good order."""
    stops: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        stops.append(number)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, note)
    if hasattr(os, "setsid"):  # a signal to the terminal's whole group must not reach it
        with contextlib.suppress(OSError):
            os.setsid()
    return stops


def _steady(plan: Plan) -> None:
    """Avoid pauses: no garbage collection, and a real-time priority where that is allowed."""
    gc.collect()
    gc.freeze()
    gc.disable()
    if hasattr(os, "sched_setscheduler") and not plan.fast:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


def _whole(plan: Plan, document: dict[str, Any]) -> None:
    beside = plan.out / f".{GUARD_FILE}.part"
    with contextlib.suppress(OSError):
        beside.write_text(json.dumps({"schema": GUARD_SCHEMA, **document}, indent=1) + "\n", encoding="utf-8")
        beside.replace(plan.out / GUARD_FILE)


def loop_process(plan: Plan, link: Connection, session: Connection, rings: tuple[str, str]) -> None:
    """Answer samples until the guard is gone; then hand over what was learnt."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        rig = read_rig(plan.rig)
        settings, wiring = session_settings(plan, rig), wiring_of(rig)
        loop = Loop(rig, settings, wiring, plan.reference, plan.choices)
        signals, slow = (
            RingBuffer(*size, name) for size, name in zip(ring_sizes(plan, settings.rate), rings, strict=True)
        )
    except Exception as error:
        refuse(session, error)
        return
    _steady(plan)
    send(session, say="ready")
    every, due = max(1, round(settings.rate / SLOW)), 0
    try:
        with contextlib.suppress(EOFError, OSError):
            heard = [link, session]
            while True:
                if session in ready(heard, None):
                    if not _heed(loop, session):
                        heard = [link]  # the guard ends the samples
                    continue
                sample = unpack_sample(link.recv_bytes())
                reply = loop.step(sample)
                link.send_bytes(pack_reply(reply))
                signals.add(
                    (sample.time, reply.reference, loop.measured, *reply[3:6], reply.command, loop.innovation)
                )
                if sample.number >= due:  # not "every so many": that very sample may have been missed
                    due = sample.number + every
                    _slow(loop, slow, sample.time)
                    _supervision(loop, session)
    except Exception as error:
        send(session, say="failed", why=f"{type(error).__name__}: {error}")
    loop.end_trial()
    _supervision(loop, session)
    link.close()  # the guard puts the safe command, if it has not done so
    send(session, say="model", state=loop.identifier.state.tolist(), final=True)
    signals.close()
    slow.close()


def _slow(loop: Loop, ring: RingBuffer, time: float) -> None:
    verdict, identifier = loop.parallel.monitor.verdict, loop.identifier
    noise = max(identifier.noise_variance, 0.0) ** 0.5
    ring.add((time, verdict.fit_percent, float(verdict.disagree), noise, *identifier.theta.tolist()))


def _supervision(loop: Loop, session: Connection) -> None:
    """Tell once what became of new gains."""
    verdict, loop.verdict = loop.verdict, None
    if verdict is not None:
        ratio = verdict.ratio if verdict.episodes else None
        send(session, say=verdict.word, words=verdict.words, ratio=ratio, episodes=verdict.episodes)
    if loop.taken_back is not None:
        why = "the loop oscillated" if verdict is None else BACK[verdict.word]
        send(session, say="taken back", why=why, gains=vars(loop.taken_back))
        loop.taken_back = None


def _heed(loop: Loop, session: Connection) -> bool:
    """Carry out one order; False once the session has gone."""
    try:
        message = receive(session)
    except (EOFError, OSError):
        return False
    if message["do"] == "gains":
        loop.change(Gains(**message["gains"]))
        send(session, say="applied", gains=message["gains"])
    elif message["do"] == "reference":
        given = message["reference"]
        loop.demand(Reference(**{**given, "times": tuple(given["times"]), "values": tuple(given["values"])}))
    elif message["do"] == "model":
        send(session, say="model", state=loop.identifier.state.tolist(), final=False)
    return True
