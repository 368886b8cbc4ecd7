"""The numbers of one sample: identify, simulate alongside, control. No clock, no door: those are the guard's."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from optid.armax.identifier import Identifier
from optid.armax.structure import Orders
from optid.fit.prediction import HORIZON
from optid.live.ahead import one_ahead
from optid.live.gains import controller_settings
from optid.live.messages import Reply, Sample
from optid.live.observer import Observer
from optid.live.parting import Parting
from optid.live.reference import Reference
from optid.live.settings import Settings, Wiring
from optid.live.twin import Twin
from optid.pid.controller import Controller, Gains
from optid.pid.controller import Settings as PidSettings
from optid.rigs.rigfile import Rig

DITHER_HOLD = 0.01  # s for which the dither keeps its sign at least


@dataclass(frozen=True)
class Choices:
    """What a session can choose.

    Attributes:
        gains: the controller starts with.
        order: of the ARMAX model, na = nb = nc.
        dither: amplitude, V, of the random signs added to the command so that the loop's data can be identified.
        seed: of these.
        pid: all of the controller but its gains, where a pid.json said more than gains.
    """

    gains: Gains
    order: int = 4
    dither: float = 0.0
    seed: int = 0
    pid: PidSettings | None = None


@dataclass(frozen=True)
class Signals:
    """What the page shows of the last sample beside its reply, SI."""

    measured: float = math.nan
    innovation: float = math.nan


class Loop:
    """Everything that is computed between a measurement and its command.

    Args:
        rig: whose model runs alongside.
        settings, wiring: of the session.
        reference: demanded position.
        choices: gains, orders, dither.
    """

    def __init__(
        self, rig: Rig, settings: Settings, wiring: Wiring, reference: Reference, choices: Choices
    ) -> None:
        limits = settings.limits
        self.reference, self.settings, self.wiring = reference, settings, wiring
        pid = controller_settings(settings, choices.pid)
        self.controller, self._twins = Controller(choices.gains, pid), Controller(choices.gains, pid)
        low, high = limits.stroke
        scale = (high - low) / 4 if math.isfinite(high - low) else 1.0
        orders = Orders(choices.order, (choices.order,), choices.order, (1,))
        self.identifier = Identifier(orders, settings.span, scales=(scale, (limits.high - limits.low) / 4))
        one_ahead(self.identifier.state)
        self._physics(rig)
        self._dither, self._rng = choices.dither, np.random.default_rng(choices.seed)
        self._sign, self._hold = 0.0, max(1, round(DITHER_HOLD * settings.rate))
        self.parting, self.shown = Parting(settings.span), Signals()
        self._last: tuple[float, float, float] | None = None  # time, position, what was asked for
        self._twin_command, self._next_window, self._windows = limits.safe, 0.0, 0
        self.controller.reset(0.0, 0.0)  # both compile or load now
        self.controller.step(0.0, 0.0)
        self._noise = math.nan

    def _physics(self, rig: Rig) -> None:
        model, names = rig.model, [port.role for port in rig.model.outputs]
        self._pick = [names.index(c.role) for c in self.wiring.measured]
        noise = np.full(len(names), np.nan)
        for k, channel in zip(self._pick, self.wiring.measured, strict=True):
            noise[k] = math.nan if channel.sd is None else channel.sd
        p = model.vector(rig.parameters)
        self._observer = Observer(model, p, noise)
        self._windowed, self._twin = Twin(model, p), Twin(model, p)
        self._y = np.full(len(names), np.nan)
        self._per_unit, self._out = self.wiring.command.per_unit, self._pick[0]

    def step(self, sample: Sample) -> Reply:
        """One sample: its command, and what the models say of it."""
        begun = time.perf_counter()
        for k, channel, value in zip(self._pick, self.wiring.measured, sample.values, strict=True):
            self._y[k] = channel.factor * value + channel.shift
        y = float(self._y[self._out])
        predicted = self._learn(sample)
        windowed, simulated = self._simulate(sample, y)
        r = self.reference.at(sample.time)
        command = self._control(sample, r, y)
        self._twin_control(r, simulated)
        self.shown = Signals(y, y - predicted)
        self._last = (sample.time, y, command)
        return Reply(sample.number, command, r, predicted, simulated, windowed, time.perf_counter() - begun)

    def change(self, gains: Gains) -> None:
        """Take new gains without a jump of the command, in the rig's loop and in the simulated one."""
        self.controller.change(gains)
        self._twins.change(gains)

    def _learn(self, sample: Sample) -> float:
        """Teach the last sample, whose command is known only now; the prediction of this one."""
        if self._last is None:
            return math.nan
        # A command that a limit or a missed deadline changed is taught as it was put.
        self.identifier.step(self._last[1], sample.standing)
        return one_ahead(self.identifier.state)

    def _simulate(self, sample: Sample, y: float) -> tuple[float, float]:
        """The position by windows on the rig's own command, and by the model in a loop of its own."""
        if self._last is not None:
            span, scale = sample.time - self._last[0], self._per_unit
            self._observer.advance(sample.standing / scale, span)
            if not self._windowed.advance(sample.standing / scale, span):
                self._windowed.copy(self._observer)
            if not self._twin.advance(self._twin_command / scale, span):
                self._twin.copy(self._observer)
        if sample.time >= self._next_window:
            # A window's start knows the data before it only: the observer has not seen this sample yet.
            self._windowed.copy(self._observer)
            self._next_window = sample.time + HORIZON
            self._windows += 1
            if self._windows == 2:  # by now the observer knows where the rig stands
                self._twin.copy(self._observer)
                self._twins.restore(self.controller.state)
                self._twin_command = sample.standing
        windowed = float(self._windowed.outputs()[self._out])
        simulated = float(self._twin.outputs()[self._out])
        self._observer.correct(self._y)
        if self._windows > 2:
            self.parting.add(y, windowed, float(self._observer.noise[self._out]))
        return windowed, simulated

    def _control(self, sample: Sample, r: float, y: float) -> float:
        limits, span = self.settings.limits, self.settings.span
        if self._last is None:
            if y - y == 0.0:
                self.controller.reset(r, y, sample.standing)
                self._twins.reset(r, y, sample.standing)
        elif abs(sample.standing - self._last[2]) > 1e-6 * (limits.high - limits.low) and y - y == 0.0:
            self.controller.reset(r, y, sample.standing)  # the guard put something else: go on from there
        if self._dither and sample.number % self._hold == 0:
            self._sign = 1.0 if self._rng.random() < 0.5 else -1.0
        wish = self.controller.step(r, y) + self._dither * self._sign
        command = limits.allowed(wish, sample.standing, y, span)
        if command == limits.safe != wish and y - y == 0.0:  # at the stroke's limits: no wind-up against them
            self.controller.reset(r, y, command)
        return command

    def _twin_control(self, r: float, simulated: float) -> None:
        limits = self.settings.limits
        wish = self._twins.step(r, simulated) + self._dither * self._sign
        self._twin_command = limits.allowed(wish, self._twin_command, simulated, self.settings.span)
