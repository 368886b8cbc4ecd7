"""What a session does when its driver fails: kinds of faults, whether the rig ends at the safe command, and how soon.

    python studies/live_faults.py [--quick] [--only WORDS] [--out DIR]

A rig on loopback takes commands and answers readings over TCP, one line each, and notes when it got what. Its driver is
what a user would write. A session runs in its processes until a fault begins; then the rig is asked what it holds.
`--quick` runs the guard alone, in this process, on the faults that need no more. Rows are kept in DIR/live_faults.json,
and a run that was cut goes on from there.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import os
import signal
import socket
import sys
import tempfile
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from optid.live.clock import RealClock  # noqa: E402
from optid.live.driver import open_driver  # noqa: E402
from optid.live.failsafe import Failsafe  # noqa: E402
from optid.live.guard import Guard  # noqa: E402
from optid.live.log import Layout, Log  # noqa: E402
from optid.live.loop import Choices  # noqa: E402
from optid.live.messages import Reply, Sample  # noqa: E402
from optid.live.plan import Plan  # noqa: E402
from optid.live.reference import Reference  # noqa: E402
from optid.live.session import Session  # noqa: E402
from optid.live.settings import live_settings, wiring_of  # noqa: E402
from optid.pid.controller import Gains  # noqa: E402
from optid.rigs.rigfile import read_rig  # noqa: E402

SAFE, WISH = 0.25, 1.5  # V
BEGIN = 15  # readings before the fault
PATIENCE = 1.0  # s that the driver waits for an answer
RIG = """name = "axis"
model = "emps"
[parameters]
mass = "95 kg"
drive_gain = "35 N/V"
viscous_friction = "200 N s/m"
coulomb_friction = "20 N"
force_offset = "0 N"
[channels]
time = {{ column = "t", unit = "s" }}
command = {{ column = "u", unit = "V", full_scale = "5 V" }}
position = {{ column = "x", unit = "mm" }}
[live]
rate = "50 Hz"
watchdog = "0.5 s"
safe_command = "{safe} V"
stroke_limits = ["-100 mm", "100 mm"]
[live.file]
port = {port}
"""


@dataclass(frozen=True)
class Fault:
    """What goes wrong.

    Attributes:
        name: in words.
        where: "link": the server goes away; "read", "write": the answer to that is another one.
        answer: of the server, or what the driver does then: "silence", "hang", "exit", "kill", "quit", "refuse".
        seconds: for how long.
        old: only on connections that are open when it begins.
    """

    name: str
    where: str
    answer: str = ""
    seconds: float = math.inf
    old: bool = False

    @property
    def needs_processes(self) -> bool:
        """The guard alone would not come back."""
        return self.answer in ("hang", "exit", "kill", "quit")


FAULTS = (
    *(
        Fault(f"server away for {seconds:g} s", "link", seconds=seconds)
        for seconds in (0.1, 0.5, 2.0, 5.0, 10.0)
    ),
    Fault("connection reset", "link", seconds=0.0),
    Fault("no answer to a reading for 0.3 s", "read", "silence", 0.3),
    Fault("no answer to a reading for 3 s", "read", "silence", 3.0),
    Fault("no answer to a command for 3 s", "write", "silence", 3.0),
    Fault("command refused for 1 s", "write", "refuse", 1.0),
    Fault("command refused on this connection", "write", "refuse", old=True),
    Fault("reading refused", "read", "refuse"),
    Fault("reading NaN", "read", "nan"),
    Fault("reading infinite", "read", "inf"),
    Fault("reading 1e30", "read", "1e30"),
    Fault("reading no number", "read", "#VALUE!"),
    Fault("two readings in the place of one", "read", "1.0 2.0"),
    Fault("confirmation no number for 1 s", "write", "#VALUE!", 1.0),
    Fault("driver hangs in a reading", "read", "hang", old=True),
    Fault("driver hangs in a command", "write", "hang", old=True),
    Fault("driver ends its process", "read", "exit", old=True),
    Fault("driver's process is killed", "read", "kill", old=True),
    Fault("driver raises SystemExit", "read", "quit", old=True),
)


class Axis:
    """The rig: a server on loopback with a fault.

    Attributes:
        port: it listens at.
        commands: (monotonic time, V) as they came.
        begun, over: of the fault, monotonic; None before.
    """

    def __init__(self, fault: Fault) -> None:
        self.fault, self.commands, self._reads = fault, [], 0
        self.begun: float | None = None
        self._links: list[socket.socket] = []
        self._old: list[socket.socket] = []
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self._lock, self._closed = threading.Lock(), False
        threading.Thread(target=self._accept, args=(self._listening,), daemon=True).start()

    commands: list[tuple[float, float]]

    @property
    def over(self) -> float:
        """When the fault ends."""
        return math.inf if self.begun is None else self.begun + self.fault.seconds

    def close(self) -> None:
        """Away for good."""
        self._closed = True
        self._leave()

    def _leave(self) -> None:
        with self._lock:
            for link in (self._listening, *self._links):
                with contextlib.suppress(OSError):
                    link.shutdown(socket.SHUT_RDWR)  # wakes whoever waits on it
                link.close()
            self._links.clear()

    def _away(self) -> None:
        self._leave()
        time.sleep(self.fault.seconds)
        if not self._closed:
            self._listening = socket.create_server(("127.0.0.1", self.port))
            self._accept(self._listening)

    def _accept(self, listening: socket.socket) -> None:
        while True:
            try:
                link, _ = listening.accept()
            except OSError:
                return
            with self._lock:
                self._links.append(link)
            threading.Thread(target=self._serve, args=(link,), daemon=True).start()

    def _serve(self, link: socket.socket) -> None:
        try:
            with link, link.makefile("rw") as lines:
                for line in lines:
                    lines.write(self._answer(line.split(), link) + "\n")
                    lines.flush()
        except (OSError, ValueError):
            return

    def _answer(self, words: list[str], link: socket.socket) -> str:
        now, fault, kind = time.monotonic(), self.fault, "read" if words[0] == "r" else "write"
        self._reads += kind == "read"
        if self._reads == BEGIN and self.begun is None:
            self.begun, self._old = now, list(self._links)
            if fault.where == "link":
                threading.Thread(target=self._away, daemon=True).start()
        wrong = self.begun is not None and now < self.over and kind == fault.where
        if wrong and (not fault.old or link in self._old):
            if fault.answer == "silence":
                time.sleep(max(self.over - now, 0.0))
            else:
                return fault.answer
        if kind == "write":
            self.commands.append((time.monotonic(), float(words[1])))
            return words[1]
        return "1.0"


class Link:
    """The driver: `read` and `write` over TCP."""

    def __init__(self, port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
        self._lines = self._socket.makefile("rw")

    def read(self, time_: float) -> list[float]:
        """mm."""
        return [float(word) for word in self._ask("r").split()]

    def write(self, command: float, time_: float) -> float:
        """V."""
        return float(self._ask(f"w {command!r}"))

    def close(self) -> None:
        """Hang up."""
        try:
            self._lines.close()
        finally:  # what was not sent is lost with the link
            self._socket.close()

    def _ask(self, words: str) -> str:
        self._lines.write(words + "\n")
        self._lines.flush()
        answer = self._lines.readline().strip()
        if answer == "refuse":
            raise PermissionError("refused")
        if answer == "hang":
            time.sleep(1e6)
        if answer == "exit":
            os._exit(3)
        if answer == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if answer == "quit":
            raise SystemExit("a driver that thinks it is a script")
        if not answer:
            raise ConnectionResetError("hung up")
        return answer


def connect(order: Any) -> Link:
    """The driver of `optid live`."""
    return Link(int(order.options["port"]))


@dataclass(frozen=True)
class Row:
    """A fault's outcome: seconds from its begin, and from when the rig could be reached again, to the safe command."""

    fault: str
    safe: bool
    said_safe: bool
    after: float | None
    after_return: float | None
    why: str


class Wishing:
    """A loop that always wishes the same."""

    def send(self, sample: Sample) -> None:
        """Nothing to learn."""

    def receive(self, number: int, timeout: float | None) -> Reply:
        """The wish."""
        return Reply(number, WISH, *(0.0,) * 5)


def guarded(rig: Path, folder: Path) -> dict[str, Any]:
    """The guard alone, in this process."""
    understood = read_rig(rig)
    wiring, settings = wiring_of(understood), live_settings(understood)
    order = {"wiring": wiring, "settings": settings}
    name = f"{__file__}:connect"
    failsafe = Failsafe(settings.safe_time, lambda: open_driver(name, understood, order))
    log = Log(folder / "recording.csv", Layout(wiring).columns)
    clock = RealClock(settings.span)
    guard = Guard(open_driver(name, understood, order), Wishing(), clock, wiring, settings, log, failsafe)
    end = guard.run(round(4.0 * settings.rate))
    if guard.driver is not None:
        guard.driver.close()
    log.close()
    return {"safe": end.safe, "why": end.why}


def in_processes(rig: Path, folder: Path) -> dict[str, Any]:
    """A whole session."""
    choices = Choices(Gains(40.0))
    plan = Plan(rig, f"{__file__}:connect", folder, Reference((0.0,), (0.05,)), choices, 4.0)
    session = Session(plan)
    try:
        session.go()
        while session.end is None:
            time.sleep(0.02)
            session.poll()
    finally:
        session.close()
    return dict(session.end)


def tried(fault: Fault, quick: bool) -> Row:
    """One fault, and what the rig holds at the end."""
    axis = Axis(fault)
    try:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            rig = folder / "rig.toml"
            rig.write_text(RIG.format(safe=SAFE, port=axis.port), encoding="utf-8")
            end = (guarded if quick else in_processes)(rig, folder)
    finally:
        axis.close()
    if axis.begun is None:
        raise RuntimeError(f"{fault.name}: the session ended before it began: {end['why']}")
    last = next((k for k in reversed(range(len(axis.commands))) if axis.commands[k][1] != SAFE), -1)
    safe = last + 1 < len(axis.commands)
    at = axis.commands[last + 1][0] if safe else math.nan
    back = axis.over if math.isfinite(axis.over) else axis.begun
    after = max(at - axis.begun, 0.0)
    return Row(
        fault.name,
        safe,
        bool(end["safe"]),
        round(after, 3) if safe else None,
        round(max(at - max(back, axis.begun), 0.0), 3) if safe else None,
        str(end["why"]),
    )


def main() -> None:
    """Try them all."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="the guard alone")
    parser.add_argument("--only", default="", help="faults with these words in their name")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "live_faults")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    path = arguments.out / ("quick.json" if arguments.quick else "live_faults.json")
    rows: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    faults = [fault for fault in FAULTS if arguments.only in fault.name]
    faults = [fault for fault in faults if not (arguments.quick and fault.needs_processes)]
    print(f"{'fault':40s} {'safe':>5s} {'s after':>8s} {'s after return':>15s}")
    for fault in faults:
        if fault.name not in rows:
            rows[fault.name] = asdict(tried(fault, arguments.quick))
            path.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
        row = rows[fault.name]
        times = ["–" if row[key] is None else f"{row[key]:.2f}" for key in ("after", "after_return")]
        print(
            f"{fault.name:40s} {'yes' if row['safe'] else 'NO':>5s} {times[0]:>8s} {times[1]:>15s}",
            flush=True,
        )
    safe = sum(rows[fault.name]["safe"] for fault in faults)
    honest = sum(rows[fault.name]["safe"] == rows[fault.name]["said_safe"] for fault in faults)
    print(
        f"{safe} of {len(faults)} end at the safe command; {honest} of {len(faults)} sessions say what is so"
    )


if __name__ == "__main__":
    main()
