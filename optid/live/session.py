"""A session: starts guard and loop, receives their messages, stops them, tunes and applies gains."""

from __future__ import annotations

import contextlib
import math
import multiprocessing
import time
from multiprocessing.connection import Connection
from typing import Any

from optid.armax.identifier import Identifier
from optid.armax.model import Armax
from optid.core.model import Array
from optid.errors import InputError, JobError
from optid.live.events import Events
from optid.live.excerpt import offer_diagnosis
from optid.live.following import ParameterMonitor
from optid.live.ipc import ready, receive, send
from optid.live.log import LOG, sweep
from optid.live.plan import Plan, ring_sizes, session_settings
from optid.live.processes import guard_process, loop_process
from optid.live.reference import read_profile
from optid.live.rescue import rescue
from optid.live.review import case_of
from optid.live.ring_buffer import RingBuffer
from optid.live.settings import wiring_of
from optid.live.tuning import Tuning
from optid.pid.controller import Gains
from optid.rigs.rigfile import read_rig

START = 300.0  # s for both processes to be ready: the first run on a machine compiles, perhaps under load
GRACE = 5.0  # s for the processes to end by themselves
WORDS = 80  # characters of a reference in the list of events
HUNG = 2.0  # s without a sample, and ten watchdogs, after which the guard counts as hanging in its driver


class Session:
    """A running session; call `poll` a few times per second.

    Args:
        plan: of the session.

    Attributes:
        events: of the session.
        gains: the controller has now.
        model: identified at the last tuning; after the end the last one.
        tuning: in the background, and its review.
        following: parameters and effects in the background, and what may have changed.
        trials: verdicts on applied gains: "kept", "worse" or "undecided" (both taken back), ratio of ITAE, episodes.
        disagree, diagnosis: whether rig and model disagree, and the command that finds out why.
        holding: a fast session waits for `resume`.
        hides: differences of a simulated rig from the rig file, in words; "" for a real one.
        demanded: the reference in words, if it was changed during the session.
        end: how it ended (fields of `optid.live.guard.End`); ``None`` while it runs.
        signals, slow: rings that the loop fills, see `optid.live.plan`.

    Raises:
        InputError, JobError: as the guard or the loop refuse.
    """

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        rig = read_rig(plan.rig)
        self.settings, self.wiring = session_settings(plan, rig), wiring_of(rig)
        self.hides = self.demanded = ""
        self.events, self.gains, self.disagree = Events(self.now), plan.choices.gains, False
        self._begun, self.holding = math.inf, False
        self._first = not (plan.out / LOG).exists()
        self.diagnosis, self.trials = "", []
        self.rig_name, self.model = rig.name, None
        self.tuning, self._wants = Tuning(plan, self.events.note), False
        self.following = ParameterMonitor(plan, self.settings.rate, self.events.note)
        self.end: dict[str, Any] | None = None
        self._progress = (0, math.inf)  # samples received, and time of the last one
        choices = plan.choices
        self._blank = Identifier(choices.orders, self.settings.span, choices.learning)
        sizes = ring_sizes(plan, self.settings.rate)
        self.signals, self.slow = RingBuffer(*sizes[0]), RingBuffer(*sizes[1])
        self._processes: list[Any] = []
        self._pipes: list[Connection] = []
        try:
            self._start()
        except BaseException:
            self.close()
            raise

    model: Armax | None
    trials: list[dict[str, Any]]

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        guard_link, loop_link = context.Pipe()
        to_guard, guard_end = context.Pipe()
        to_loop, loop_end = context.Pipe()
        self._pipes = [to_guard, to_loop]
        names = (self.signals.name, self.slow.name)
        self._processes = [
            context.Process(target=guard_process, args=(self.plan, guard_link, guard_end), name="guard"),
            context.Process(target=loop_process, args=(self.plan, loop_link, loop_end, names), name="loop"),
        ]
        for process in self._processes:
            process.start()
        for end in (guard_link, loop_link, guard_end, loop_end):
            end.close()  # our copies only: the children's death must close the pipes
        for pipe, who in ((to_guard, "guard"), (to_loop, "loop")):
            ready = _await_ready(pipe, who)
            self.hides = ready.get("hides", "") or self.hides

    def go(self) -> None:
        """Sample 0 is due."""
        self._begun = time.monotonic()
        self._progress = (0, self._begun)
        send(self._pipes[0], do="go")
        self.events.note("the loop is running")
        if self.hides:
            self.events.note(f"the simulated rig differs from the rig file: {self.hides}")

    def now(self) -> float:
        """The session's time, s; 0 before it began."""
        if self.plan.fast:
            _, rows = self.signals.since(max(self.signals.count - 1, 0))
            return float(rows[-1][0]) if len(rows) else 0.0
        return max(time.monotonic() - self._begun, 0.0)

    def resume(self) -> None:
        """Resume a waiting session."""
        if self.holding:
            self.holding = False
            self._progress = (self.signals.count, time.monotonic())
            send(self._pipes[0], do="resume")

    def stop(self, why: str = "stopped") -> None:
        """Ask the guard to write the safe command and end; `poll` until `end` is set."""
        send(self._pipes[0], do="stop", why=why)

    def demand(self, text: str) -> None:
        """Change the loop's reference, in the notation of `read_profile`.

        Raises:
            InputError: it is not a reference, lies beyond the stroke limits, or nothing is controlled.
        """
        if self.plan.choices.command is not None:
            raise InputError("the loop is open", field="reference", expected="a session without --command")
        unit = self.wiring.measured[0].recorded_unit
        reference = read_profile(text, self.settings.limits, unit)
        send(self._pipes[1], do="reference", reference=vars(reference))
        self.demanded = text
        self.events.note(f"reference: {text if len(text) <= WORDS else text[:WORDS] + ' ...'}")

    def tune(self) -> None:
        """Search for better gains in the background, on the model identified so far; one search at a time."""
        if not self.busy and self.end is None:
            self._wants = True
            send(self._pipes[1], do="model")
            self.events.note("tuning on the model identified so far")

    @property
    def busy(self) -> bool:
        """Whether a tuning is running."""
        return self._wants or self.tuning.busy

    @property
    def applicable(self) -> bool:
        """Whether there are reviewed gains that the loop does not use yet."""
        review = self.tuning.review
        closed = self.plan.choices.command is None
        return self.end is None and closed and review is not None and review.new != self.gains

    def apply(self, confirmed: bool = False) -> None:
        """Apply the reviewed gains to the loop, without a jump of the command.

        Gains that the review finds worse are refused, with the reasons as an event, unless the user has confirmed them.
        """
        review = self.tuning.review
        if not self.applicable or review is None:
            return
        if review.worse and not confirmed:
            self.events.note(f"not applied: {'; '.join(review.worse)}")
            return
        if review.worse:
            self.events.note(f"confirmed by the user although {'; '.join(review.worse)}")
        send(self._pipes[1], do="gains", gains=vars(review.new))

    def poll(self) -> None:
        """Read the messages of guard and loop; never waits."""
        for pipe, heed in zip(self._pipes, (self._heed_guard, self._heed_loop), strict=True):
            with contextlib.suppress(EOFError, OSError):
                while ready([pipe], 0.0):
                    heed(receive(pipe))
        if self.end is None and not self._processes[0].is_alive():
            self._guard_died("the guard's process died")
        elif self.end is None:
            self._look_for_life()
        self.tuning.poll()
        if self.end is None:
            self.following.poll(self.now())
        self._look()

    def parameters(self) -> tuple[int, Array]:
        """Rows written to the ring of parameters, and the newest of them, shape (0 or 1, columns)."""
        return self.slow.since(max(self.slow.count - 1, 0))

    def close(self) -> None:
        """End everything that still runs and release the shared memory."""
        if self._pipes:
            self.stop("closed")
        for process in self._processes:
            if process.pid is not None:  # the guard may still be trying to write the safe command
                _end(process, GRACE + self.settings.safe_time * (process.name == "guard"))
        if self._pipes:
            self.poll()
        if self.disagree:  # the newest minutes
            self.diagnosis = offer_diagnosis(self.plan.rig, self.plan.out, self.settings.rate)
        self.tuning.close()
        self.following.close()
        for pipe in self._pipes:
            pipe.close()
        self._pipes = []
        self.signals.close()
        self.slow.close()
        if self._first:
            sweep(self.plan.out)

    def _heed_guard(self, message: dict[str, Any]) -> None:
        if message["say"] == "holding":
            self.holding = True
        elif message["say"] == "unsafe":
            self._progress = (self.signals.count, time.monotonic() + self.settings.safe_time)
            self.events.note("the driver does not accept the safe command; trying again")
        elif message["say"] == "end":
            self.end = message if message["safe"] else self._rescued(message)
        elif message["say"] == "refused":
            self.end = {"how": "failed", "why": message["why"], "safe": message["safe"]}
        if self.end is not None:
            self.events.note(f"ended: {self.end['why']}")

    def _rescued(self, end: dict[str, Any]) -> dict[str, Any]:
        """The guard could not write the safe command: try again through our own connection."""
        self._processes[0].join(GRACE)  # it holds the rig
        after, words = rescue(self.plan)
        return {**end, "safe": after is not None, "safe_after": None, "why": f"{end['why']}; {words}"}

    def _heed_loop(self, message: dict[str, Any]) -> None:
        if message["say"] == "model":
            learnt = self._blank.restored(message["state"])
            self.model = learnt.model if learnt.counts.learnt_from else None
            if self._wants and self.end is None:
                self._begin_tuning()
        elif message["say"] in ("applied", "taken back"):
            self.gains = Gains(**message["gains"])
            why = f"{message['why']}; back to " if message["say"] == "taken back" else "applied: "
            self.events.note(why + ", ".join(f"{k} {v:.4g}" for k, v in message["gains"].items()))
        elif message["say"] in ("kept", "worse", "undecided"):
            self.trials.append({"verdict": message.pop("say"), **message})
            self.events.note(f"gains on trial, {self.trials[-1]['verdict']}: {message['words']}")
        elif message["say"] == "failed":
            self.events.note(f"the loop failed: {message['why']}")

    def _begin_tuning(self) -> None:
        self._wants = False
        if self.model is None:
            self.events.note("not tuned: nothing has been identified yet")
        else:
            self.tuning.begin(
                case_of(self.model, (self.settings, self.wiring), self.plan.choices, self.gains)
            )

    def _look_for_life(self) -> None:
        """A driver that hangs blocks the guard, which cannot write the safe command: end it, then write it."""
        samples, since = self._progress
        if self.signals.count != samples:
            self._progress = (self.signals.count, time.monotonic())
        elif not self.holding and time.monotonic() - since > HUNG + 10 * self.settings.watchdog:
            self._processes[0].kill()
            self._processes[0].join()
            self._guard_died("the driver did not respond")

    def _guard_died(self, why: str) -> None:
        with contextlib.suppress(EOFError, OSError):
            while ready([self._pipes[0]], 0.0):
                self._heed_guard(receive(self._pipes[0]))
        if self.end is None:
            after, words = rescue(self.plan)
            self.end = {
                "how": "failed",
                "why": f"{why}; {words}",
                "safe": after is not None,
                "safe_after": after,
            }
            self.events.note(self.end["why"])

    def _look(self) -> None:
        """Report once when rig and model disagree, and when they agree again."""
        _, rows = self.parameters()
        if not len(rows) or bool(rows[0][2]) == self.disagree:
            return
        self.disagree = not self.disagree
        if self.disagree:
            self.events.note(f"rig and model disagree: the 0.5 s windows fit {rows[0][1]:.0f} %")
            self.diagnosis = offer_diagnosis(self.plan.rig, self.plan.out, self.settings.rate)
            self.events.note(f"to find what is missing: {self.diagnosis}")
        else:
            self.events.note("rig and model agree again")


def _await_ready(pipe: Connection, who: str) -> dict[str, Any]:
    try:
        if not pipe.poll(START):
            raise JobError(f"the {who} was not ready within {START:.0f} s")
        message = receive(pipe)
    except (EOFError, OSError):
        raise JobError(f"the {who}'s process died while it started") from None
    if message["say"] == "refused":
        raise (InputError if message["input"] else JobError)(message["why"])
    return message


def _end(process: Any, grace: float) -> None:
    """Wait for a process, then terminate it, then kill it; the guard also writes the safe command when terminated."""
    for insist in (None, process.terminate, process.kill):
        if insist is not None:
            insist()
        process.join(grace)
        if not process.is_alive():
            return
