"""The rig's own model in closed loop along a reference: it simulates the recording of an experiment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array
from optid.core.recording import Channel, Recording
from optid.errors import InputError
from optid.live.settings import Settings, wiring_of
from optid.live.twin import Twin
from optid.pid.controller import Gains
from optid.pid.controller import Settings as PidSettings
from optid.rigs.channels import REFERENCE
from optid.rigs.rigfile import Rig
from optid.tuning.bench import PhysicalBench
from optid.tuning.scenarios import Episode

POSITION = "position"
NOISE = 1e-4  # sd of the position as a share of the way between the stroke limits, where none is stated
# sd of any other output as a share of the usual size of its unit's state, where none is stated.
NOISE_OTHER = 1e-3
TOUCH = 1e-6  # of the range between the limits: a smaller excess counts as on the limit


@dataclass(frozen=True, eq=False)
class Run:
    """One simulated run.

    Attributes:
        reference: m, (samples,).
        command: as sent to the rig (V), (samples,).
        outputs: of the model, SI, (samples, outputs).
    """

    reference: Array
    command: Array
    outputs: Array


class Loop:
    """A rig's model under a controller.

    Args:
        rig: with one command, an output "position" and limits of its stroke.
        settings: of a live session.
        gains, pid: of the controller.

    Attributes:
        rig: as given, with the noise of every mapped output stated.
        settings: as given.
        start: position at which a run begins, m.

    Raises:
        InputError: the rig has no position, no stroke, no reference channel or not one command.
    """

    def __init__(self, rig: Rig, settings: Settings, gains: Gains, pid: PidSettings) -> None:
        roles = [port.role for port in rig.model.outputs]
        self.settings, self.gains, self._pid = settings, gains, pid
        self._command = wiring_of(rig).command
        self._twin = Twin(rig.model, rig.model.vector(rig.parameters))
        self._column = roles.index(POSITION)
        self.start = float(self._twin.outputs()[self._column])
        low, high = settings.limits.stroke
        if not low - TOUCH * (high - low) <= self.start <= high + TOUCH * (high - low):
            raise InputError(
                f"{low:g} to {high:g} m, and the model starts at {self.start:g} m",
                where=rig.path,
                field="live.stroke_limits",
                expected="limits around the model's start",
            )
        self.rig = _with_noise(rig, high - low)
        self.measured = tuple(role for role in roles if role in rig.channels)

    def runs(self, references: Sequence[Array]) -> list[Run]:
        """One run for each reference, from the model's start; NaN from where the simulation diverges."""
        episodes = tuple(_episode(reference - self.start, f"{k}") for k, reference in enumerate(references))
        responses = PhysicalBench(self.rig, episodes, POSITION)(self.gains, self._pid)
        return [
            Run(reference, response.command, self._driven(response.command))
            for reference, response in zip(references, responses, strict=True)
        ]

    def position(self, run: Run) -> Array:
        """m, (samples,)."""
        return run.outputs[:, self._column]

    def beyond(self, run: Run) -> int | None:
        """The first sample at which the position is beyond the stroke limits or NaN; None for none."""
        low, high = self.settings.limits.stroke
        touch, x = TOUCH * (high - low), self.position(run)
        inside = (x >= low - touch) & (x <= high + touch)
        return None if inside.all() else int(np.argmin(inside))

    def recording(self, run: Run, generator: np.random.Generator, name: str) -> Recording:
        """The recording of a run, with sensors' noise."""
        n, command = len(run.command), self._command
        roles = [port.role for port in self.rig.model.outputs]
        channels = {command.role: self._channel(command.role, run.command / command.per_unit)}
        for role in self.measured:
            sd = self.rig.channels[role].sd or 0.0
            noisy = run.outputs[:, roles.index(role)] + sd * generator.standard_normal(n)
            channels[role] = self._channel(role, noisy)
        return Recording(name, self.settings.span * np.arange(float(n)), channels)

    def _channel(self, role: str, values: Array) -> Channel:
        c = self.rig.channels[role]
        return Channel(role, c.column, c.model_unit, values, c.sd, c.full_scale, c.per_unit, c.recorded_unit)

    def _driven(self, command: Array) -> Array:
        """All outputs along a command."""
        twin = Twin(self.rig.model, self.rig.model.vector(self.rig.parameters))
        outputs = np.full((len(command), len(self.rig.model.outputs)), np.nan)
        for n, u in enumerate((command / self._command.per_unit).tolist()):
            outputs[n] = twin.outputs()
            if not (math.isfinite(u) and twin.advance(u, self.settings.span)):
                break
        return outputs


def _episode(path: Array, name: str) -> Episode:
    """An episode with a set-point profile, without scores."""
    zeros = np.zeros(path.size)
    return Episode(name, path, zeros, zeros, zeros)


def refuse_unfit(rig: Rig) -> None:
    """Refuse a rig that cannot follow a reference.

    Raises:
        InputError: no position, or no channel for it or for the reference.
    """
    roles = [port.role for port in rig.model.outputs]
    if POSITION not in roles:
        raise InputError(
            f'no output "{POSITION}" among {", ".join(roles)}',
            where=rig.path,
            field="model",
            expected="a plant with a position: a plan is a reference for it",
        )
    for role in (POSITION, REFERENCE):
        if role not in rig.channels:
            raise InputError(
                "this channel is missing, and a plan needs it",
                where=rig.path,
                field=f"channels.{role}",
                expected=f'{role} = {{ column = "{role[0]}", unit = "mm" }}',
            )


def refuse_endless(rig: Rig, settings: Settings) -> None:
    """Refuse a rig without limits for the reference.

    Raises:
        InputError: the stroke is not known.
    """
    low, high = settings.limits.stroke
    if not math.isfinite(high - low):
        raise InputError(
            "the rig file states no stroke",
            where=rig.path,
            field="live.stroke_limits",
            expected='stroke_limits = ["-50 mm", "50 mm"] in [live]',
        )


def _with_noise(rig: Rig, stroke: float) -> Rig:
    """Every mapped output with an sd: the file's, or a usual one."""
    usual = {state.unit: state.scale for state in rig.model.states}
    channels = dict(rig.channels)
    for port in rig.model.outputs:
        if port.role in channels and not channels[port.role].sd:
            size = NOISE * stroke if port.role == POSITION else NOISE_OTHER * usual.get(port.unit, 1.0)
            channels[port.role] = replace(channels[port.role], sd=size)
    return replace(rig, channels=channels)
