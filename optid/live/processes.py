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
from optid.live.driver import open_driver
from optid.live.guard import End, Guard, Stop
from optid.live.log import LOG, Layout, Log
from optid.live.loop import Loop
from optid.live.messages import pack_reply, unpack_sample
from optid.live.pipes import PipeLink, ready, refuse, tell, told
from optid.live.plan import SLOW, Plan, ring_sizes
from optid.live.ring import Ring
from optid.live.settings import live_settings, wiring_of
from optid.pid.controller import Gains
from optid.rigs.rigfile import read_rig

GUARD_FILE = "guard.json"  # how the guard saw the end: there even when nobody else is left
PRIORITY = 20  # among real-time processes, where the system lets us be one


def guard_process(plan: Plan, link: Connection, session: Connection) -> None:
    """Open the driver, wait for the word to go, run the samples, say how it ended."""
    stops = _deaf_but_for_terminate()
    try:
        rig = read_rig(plan.rig)
        wiring, settings = wiring_of(rig), live_settings(rig, plan.rate)
        order = {"wiring": wiring, "settings": settings, "recording": plan.recording, "seed": plan.seed}
        driver = open_driver(plan.driver, rig, order)
    except Exception as error:
        refuse(session, error)
        return
    try:
        log = Log(plan.out / LOG, Layout(wiring).columns)
    except OSError as error:
        driver.close()
        refuse(session, error)
        return
    clock = FastClock(settings.span) if plan.fast else RealClock(settings.span)
    guard = Guard(driver, PipeLink(link), clock, wiring, settings, log)
    tell(session, say="ready")

    def asked() -> None:
        if stops:
            raise Stop("SIGTERM")
        if ready([session], 0.0):
            _orders(session)

    end: End | None = None
    try:
        _orders(session)  # blocks until the word to go
        _steady(plan)
        samples = None if plan.seconds is None else max(1, round(plan.seconds * settings.rate))
        end = guard.run(samples, asked)
    except Stop as stop:  # before it began
        refuse(session, stop, guard.make_safe())
    finally:
        with contextlib.suppress(Exception):
            driver.close()
        log.close()
        if end is not None:
            document = {**dataclasses.asdict(end), "how": end.how.name.lower()}
            _whole(plan, document)
            tell(session, say="end", **document)


def _orders(session: Connection) -> None:
    """One word from the session; its death is an order to stop."""
    try:
        message = told(session)
    except (EOFError, OSError):
        raise Stop("the session that started it has gone") from None
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
    """No pauses of our own making: no collector, and a real-time priority where that is allowed."""
    gc.collect()
    gc.freeze()
    gc.disable()
    if hasattr(os, "sched_setscheduler") and not plan.fast:
        with contextlib.suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))


def _whole(plan: Plan, document: dict[str, Any]) -> None:
    beside = plan.out / f".{GUARD_FILE}.part"
    with contextlib.suppress(OSError):
        beside.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
        beside.replace(plan.out / GUARD_FILE)


def loop_process(plan: Plan, link: Connection, session: Connection, rings: tuple[str, str]) -> None:
    """Answer samples until the guard is gone; then hand over what was learnt."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        rig = read_rig(plan.rig)
        settings, wiring = live_settings(rig, plan.rate), wiring_of(rig)
        loop = Loop(rig, settings, wiring, plan.reference, plan.choices)
        signals, slow = (
            Ring(*size, name) for size, name in zip(ring_sizes(plan, settings.rate), rings, strict=True)
        )
    except Exception as error:
        refuse(session, error)
        return
    tell(session, say="ready")
    _steady(plan)
    every, due = max(1, round(settings.rate / SLOW)), 0
    try:
        with contextlib.suppress(EOFError, OSError):
            while True:
                sample = unpack_sample(link.recv_bytes())
                reply = loop.step(sample)
                link.send_bytes(pack_reply(reply))
                signals.add(
                    (sample.time, reply.reference, loop.measured, *reply[3:6], reply.command, loop.innovation)
                )
                if sample.number >= due:  # not "every so many": that very sample may have been missed
                    due = sample.number + every
                    _slow(loop, slow, sample.time)
                    if loop.taken_back is not None:
                        tell(session, say="taken back", gains=vars(loop.taken_back))
                        loop.taken_back = None
                    while session.poll():
                        _heed(loop, told(session), session)
    except Exception as error:
        tell(session, say="failed", why=f"{type(error).__name__}: {error}")
    link.close()  # the guard puts the safe command, if it has not done so
    tell(session, say="model", state=loop.identifier.state.tolist(), final=True)
    signals.close()
    slow.close()


def _slow(loop: Loop, ring: Ring, time: float) -> None:
    verdict, identifier = loop.alongside.parting.verdict, loop.identifier
    noise = max(identifier.noise_variance, 0.0) ** 0.5
    ring.add((time, verdict.fit_percent, float(verdict.parted), noise, *identifier.theta.tolist()))


def _heed(loop: Loop, message: dict[str, Any], session: Connection) -> None:
    if message["do"] == "gains":
        loop.change(Gains(**message["gains"]))
        tell(session, say="applied", gains=message["gains"])
    elif message["do"] == "model":
        tell(session, say="model", state=loop.identifier.state.tolist(), final=False)
