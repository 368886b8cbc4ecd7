"""The physical model in parallel with the rig: on the rig's command in 0.5 s windows, and in its own control loop."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from optid.estimation.problem import HORIZON
from optid.live.mismatch_monitor import MismatchMonitor
from optid.live.observer import Observer
from optid.live.settings import Settings, Wiring
from optid.live.twin import Twin
from optid.pid.controller import Controller, Gains
from optid.pid.controller import Settings as PidSettings
from optid.rigs.rigfile import Rig

SETTLED = 2  # windows after which the observer has converged


class ParallelModel:
    """The model's predictions of the rig, and the monitor of their mismatch.

    Args:
        rig: whose model.
        settings, wiring: of the session.
        gains, pid: of the controller, also used in the simulated loop.
    """

    def __init__(self, rig: Rig, settings: Settings, wiring: Wiring, gains: Gains, pid: PidSettings) -> None:
        model, names = rig.model, [port.role for port in rig.model.outputs]
        places = [names.index(channel.role) for channel in wiring.measured]
        self._channels = [(k, c.factor, c.shift) for k, c in zip(places, wiring.measured, strict=True)]
        noise = np.full(len(names), np.nan)
        for k, channel in zip(places, wiring.measured, strict=True):
            noise[k] = math.nan if channel.sd is None else channel.sd
        p = model.vector(rig.parameters)
        self._observer, self._windowed, self._twin = Observer(model, p, noise), Twin(model, p), Twin(model, p)
        self._y, self._out = np.full(len(names), np.nan), places[0]
        self._settings, self._per_unit = settings, wiring.command.per_unit
        self.controller = Controller(gains, pid)
        self.monitor = MismatchMonitor(settings.span)
        self._command, self._next, self._windows = settings.limits.safe, 0.0, 0

    def measured(self, values: Sequence[float]) -> float:
        """Process a sample's values in the units of their columns; returns the position, m."""
        for (k, factor, shift), value in zip(self._channels, values, strict=True):
            self._y[k] = factor * value + shift
        return float(self._y[self._out])

    def advance(self, standing: float, span: float) -> None:
        """Advance from the last sample to this one, with the applied command (V) and the simulated loop's own."""
        rigs = standing / self._per_unit
        self._observer.advance(rigs, span)
        if not self._windowed.advance(rigs, span):
            self._windowed.copy(self._observer)
        if not self._twin.advance(self._command / self._per_unit, span):
            self._twin.copy(self._observer)

    def positions(self, time: float, standing: float, controller: Controller) -> tuple[float, float]:
        """The position by windows and by the simulated loop at this sample, without using its measurement.

        Args:
            time: of the sample, s.
            standing: command, V.
            controller: of the rig; the simulated loop starts from its state.
        """
        if time >= self._next:
            # A window starts from past data only: the observer has not used this sample yet.
            self._windowed.copy(self._observer)
            self._next = time + HORIZON
            self._windows += 1
            if self._windows == SETTLED:
                self._twin.copy(self._observer)
                self.controller.restore(controller.state)
                self._command = standing
        windowed, simulated = self._windowed.outputs()[self._out], self._twin.outputs()[self._out]
        self._observer.correct(self._y)
        if self._windows > SETTLED:
            self.monitor.add(
                float(self._y[self._out]), float(windowed), float(self._observer.noise[self._out])
            )
        return float(windowed), float(simulated)

    def follow(self, command: float) -> None:
        """Apply the command (V) of an open-loop experiment to the simulated rig."""
        self._command = command

    def control(self, reference: float, dither: float, simulated: float) -> None:
        """The command of the simulated loop, under the same limits."""
        wish = self.controller.step(reference, simulated) + dither
        self._command = self._settings.limits.allowed(wish, self._command, simulated, self._settings.span)
