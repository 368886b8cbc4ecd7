"""The computations of one sample: identify, simulate in parallel, control. Clock and driver belong to the guard."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field, replace

import numpy as np

from optid.armax.identifier import Identifier
from optid.armax.identifier import Settings as Learning
from optid.armax.structure import Orders
from optid.errors import InputError
from optid.live.excitation import Excitation
from optid.live.gains import controller_settings
from optid.live.messages import Reply, Sample
from optid.live.one_step_prediction import predict_next
from optid.live.oscillation_detector import OscillationDetector
from optid.live.parallel_model import ParallelModel
from optid.live.reference import Reference
from optid.live.settings import Settings, Wiring
from optid.live.trial import SMALLEST, Trial, Verdict
from optid.pid.controller import Controller, Gains
from optid.pid.controller import Settings as PidSettings
from optid.pid.pid_step import INTEGRAL
from optid.rigs.rigfile import Rig

SAME = 1e-9  # of the command's range: less is no other command than the one that was asked for
ORDERS = Orders(4, (4,), 4, (1,))  # of eq. 12, by default
DITHER_HOLD = 0.01  # s for which the dither keeps its sign at least


@dataclass(frozen=True)
class Choices:
    """What a session can choose.

    Attributes:
        gains: the controller starts with.
        orders: of the ARMAX model, one input, whose delay is at least one sample.
        learning: how it is identified.
        dither: amplitude, V, of the random signs added to the command so that the loop's data can be identified.
        seed: of these.
        pid: all of the controller but its gains, where a pid.json said more than gains.
        command: of an experiment in open loop, in the controller's place.
    """

    gains: Gains
    orders: Orders = ORDERS
    learning: Learning = field(default_factory=Learning)
    dither: float = 0.0
    seed: int = 0
    pid: PidSettings | None = None
    command: Excitation | None = None

    def __post_init__(self) -> None:
        if self.orders.inputs != 1 or self.orders.nk[0] < 1:
            raise InputError(
                f"{self.orders}",
                field="orders",
                expected="one input with a delay of at least 1: a command acts on later samples only",
            )


class Loop:
    """Everything that is computed between a measurement and its command.

    Args:
        rig: whose model runs in parallel.
        settings, wiring: of the session.
        reference: demanded position.
        choices: gains, orders, dither.

    Attributes:
        measured, innovation: of the last sample, m: what the page shows beside a reply.
        taken_back: the gains that are in use again since the newer ones made the loop oscillate or were worse.
        trial: of new gains against the ones before.
        verdict: of the last trial, until somebody sets it to ``None``; ``None`` for an oscillation.
    """

    def __init__(
        self, rig: Rig, settings: Settings, wiring: Wiring, reference: Reference, choices: Choices
    ) -> None:
        limits, pid = settings.limits, controller_settings(settings, choices.pid)
        self.reference, self.settings, self.wiring = reference, settings, wiring
        self.controller = Controller(choices.gains, pid)
        self.parallel = ParallelModel(rig, settings, wiring, choices.gains, pid)
        low, high = limits.stroke
        scale = (high - low) / 4 if math.isfinite(high - low) else 1.0
        scales = (scale, (limits.high - limits.low) / 4)
        about = (choices.orders, settings.span, choices.learning, scales)
        self.identifier = Identifier(*about)
        self._open = choices.command
        self._dither, self._rng = choices.dither, np.random.default_rng(choices.seed)
        self._sign, self._hold = 0.0, max(1, round(DITHER_HOLD * settings.rate))
        self._time = self._position = self._asked = math.nan  # of the last sample; asked: its command
        self._integral = 0.0  # of the controller before the last sample, V
        self._small = SAME * (limits.high - limits.low)
        self.measured = self.innovation = math.nan
        self._oscillation, self._before = (
            OscillationDetector(settings.span, limits.high - limits.low),
            choices.gains,
        )
        self.taken_back: Gains | None = None
        self._demanded: Reference | None = None
        self.trial = Trial(settings.span, SMALLEST * 4 * scale)
        self.verdict: Verdict | None = None
        # Compile or load now what a first sample calls: on a new machine each of these takes longer than a watchdog.
        predict_next(self.identifier.state)
        Identifier(*about).step(0.0, 0.0)
        rehearsed = Controller(choices.gains, pid)
        rehearsed.reset(0.0, 0.0, 0.0)
        rehearsed.change(choices.gains)
        rehearsed.restore(rehearsed.state)
        rehearsed.step(0.0, 0.0)

    def step(self, sample: Sample) -> Reply:
        """One sample: its command, and what the models say of it."""
        begun = time.perf_counter()
        y, predicted = self.parallel.measured(sample.values), math.nan
        first = self._time != self._time
        if not first:
            # Taught with the command as it was put: a limit or a missed deadline may have changed it.
            self.identifier.step(self._position, sample.standing)
            predicted = predict_next(self.identifier.state)
            self.parallel.advance(sample.standing, sample.time - self._time)
        windowed, simulated = self.parallel.positions(sample.time, sample.standing, self.controller)
        if self._demanded is not None:
            self.reference, self._demanded = replace(self._demanded, start=sample.time), None
        r = self.reference.at(sample.time)
        if self._dither and sample.number % self._hold == 0:
            self._sign = 1.0 if self._rng.random() < 0.5 else -1.0
        dither = self._dither * self._sign
        if self._open is None:
            command = self._control(sample.accepted, r, y, dither)
            self.parallel.control(r, dither, simulated)
        else:
            command = self._open.at(sample.time)
            self.parallel.follow(command)
        self._supervise(sample.time, r, y, command)
        self.measured, self.innovation = y, y - predicted
        self._time, self._position = sample.time, y
        self._asked = command if y - y == 0.0 else math.nan  # after a missing measurement it begins anew
        return Reply(sample.number, command, r, predicted, simulated, windowed, time.perf_counter() - begun)

    def demand(self, reference: Reference) -> None:
        """Follow another reference, whose times count from the next sample on."""
        self._demanded = reference

    def change(self, gains: Gains) -> None:
        """Take new gains without a jump of the command, in the rig's loop and in the simulated one.

        If the loop oscillates with them, or responds worse than before (`optid.live.trial`), it takes the old ones
        back by itself. Gains that replace others on trial are compared with those before the trial.
        """
        if not self.trial.running:
            self._before = self.controller.gains
        self._switch(gains)
        if gains == self._before:
            self.trial.withdraw()
        else:
            self.verdict = self.trial.begin()

    def end_trial(self) -> None:
        """Gains still on trial go: they have not been shown to be as good as those before."""
        if self.trial.running:
            self.verdict = self.trial.standing
            self.trial.withdraw()
            self.taken_back = self._before
            self._switch(self._before)

    def _switch(self, gains: Gains) -> None:
        self._oscillation.forget()
        self.controller.change(gains)
        self.parallel.controller.change(gains)

    def _supervise(self, time: float, r: float, y: float, command: float) -> None:
        """Take the old gains back where the newer ones oscillate or have lost their trial."""
        verdict = self.trial.add(time, r, y)
        self.verdict = verdict or self.verdict
        oscillates = self._oscillation.add(command) and self.controller.gains != self._before
        if oscillates or (verdict is not None and not verdict.kept):
            self.verdict = None if oscillates else verdict
            self.trial.withdraw()
            self.taken_back = self._before
            self._switch(self._before)

    def _control(self, accepted: float, r: float, y: float, dither: float) -> float:
        limits, known = self.settings.limits, y - y == 0.0
        if (
            known and not abs(accepted - self._asked) <= self._small
        ):  # the first sample, or the guard put another one
            self._resume(r, y, accepted)
        self._integral = float(self.controller.state[INTEGRAL])
        wish = self.controller.step(r, y) + dither
        command = limits.allowed(wish, accepted, y, self.settings.span)
        if known and command == limits.safe != wish:  # at the stroke's limits
            self._resume(r, y, command)
        return command

    def _resume(self, r: float, y: float, command: float) -> None:
        """Go on from a command that was not the controller's, with the integral from before: it does not wind up.

        A bumpless start would have the integral cancel what the error asks for. A deadline missed in the middle of a
        move would leave the axis where it happened to be until the integral is back.
        """
        self.controller.reset(r, y, command)
        state = self.controller.state
        state[INTEGRAL] = self._integral
        self.controller.restore(state)
