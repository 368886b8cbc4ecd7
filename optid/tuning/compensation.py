"""Compensation of a valve's dead band and of dry friction from the rig's model, as fitted or diagnosed.

A dead band is a parameter of the valve's effect. Dry friction is a force, and the command that overcomes it depends on
the drive: a motor needs one while it moves, a cylinder, whose valve admits air until the force suffices, needs none.
So the model is simulated: with the tuned gains it follows ramps of two speeds in both directions, and the command,
which is linear in the speed, is extrapolated to zero speed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from optid.errors import InputError
from optid.pid.controller import Gains, Settings
from optid.rigs.rigfile import Rig
from optid.tuning.bench import PhysicalBench
from optid.tuning.scenarios import profile

if TYPE_CHECKING:
    from optid.tuning.tuning import Tuning

DEAD_BAND = "valve_deadband"
ONSET = 0.1  # of the dead band: commands over which the jump is blended in
SECONDS = 2.0  # of the slower ramp over the largest step; the faster one takes half of that
FOLLOWED = 0.3  # share of the distance by which a ramp may be missed
LEAST = 5e-3  # of half the command's range: a smaller one counts as zero


def dead_band_of(settings: Settings, rig: Rig | None, where: str | Path = "--compensate") -> Settings:
    """Settings that jump over the dead band of a rig's valve, where its model has one.

    Raises:
        InputError: no rig.
    """
    if rig is None:
        raise InputError(
            "no rig file is given",
            where=where,
            expected="--rig RIG, whose model gives the friction and the dead band",
        )
    if all(effect.name != DEAD_BAND for effect in rig.effects):
        return settings
    full = min(-settings.low, settings.high)
    width = rig.parameters.get(f"{DEAD_BAND}.width", 0.0) * (full if math.isfinite(full) else 1.0)
    return replace(
        settings, deadband_low=-width, deadband_high=width, deadband_onset=ONSET * width if width else 0.0
    )


def compensated(tuning: Tuning, rig: Rig, output: str) -> Tuning:
    """The tuning with compensation of the rig's friction, and a remark on all that is compensated.

    Args:
        tuning: its gains follow the ramps; its dead band is compensated already.
        rig: its model is simulated.
        output: role of the controlled output.
    """
    size = max((episode.size for episode in tuning.task.episodes), default=0.0)
    s = friction_of(rig, output, tuning.gains, tuning.settings, size)
    said = [
        f"dead band {s.deadband_low:.3g} to {s.deadband_high:.3g}" if s.deadband_high else "",
        f"dry friction {s.friction:.3g} along the set-point's motion" if s.friction else "",
    ]
    words = " and ".join(filter(None, said)) or "nothing: the largest command does not overcome its friction"
    remark = f"Compensated according to the rig's model: {words}."
    return replace(tuning, settings=s, remarks=(*tuning.remarks, remark))


def friction_of(rig: Rig, output: str, gains: Gains, settings: Settings, size: float) -> Settings:
    """Settings that overcome the dry friction of a rig's model in the direction in which the set-point moves.

    Args:
        rig: its model is simulated.
        output: role of the controlled output.
        gains: used for the ramps.
        settings: of the controller, without friction compensation.
        size: distance of the ramps, output's unit.

    Returns:
        The settings; unchanged where no command is needed against friction, or the model does not follow.
    """
    speed = abs(size) / SECONDS
    if speed == 0.0:
        return settings
    found = [
        [
            _command(rig, output, gains, settings, (way * factor * speed, SECONDS / factor))
            for factor in (1.0, 2.0)
        ]
        for way in (1.0, -1.0)
    ]
    rest = [2.0 * one - two for one, two in found if one is not None and two is not None]
    if len(rest) < 2:
        return settings
    friction = 0.5 * (rest[0] - rest[1])
    # The command against friction has the sign of the plant, as the gains have.
    if friction * math.copysign(1.0, gains.kp) < LEAST * min(-settings.low, settings.high, 1e3):
        return settings
    return replace(settings, friction=friction, friction_speed=0.1 * speed)


def _command(
    rig: Rig, output: str, gains: Gains, settings: Settings, ramp: tuple[float, float]
) -> float | None:
    """Mean command, dead band taken off, in the second half of a ramp; None where the model does not follow."""
    speed, seconds = ramp
    T = settings.sample_time
    path = speed * T * np.arange(round(seconds / T))
    [run] = PhysicalBench(rig, (profile(path, T),), output)(gains, settings)
    if not run.bounded or abs(run.output[-1] - path[-1]) > FOLLOWED * abs(path[-1]):
        return None
    command = run.command[path.size // 2 :]
    dead = max(-settings.deadband_low, settings.deadband_high)
    return float(np.mean(np.sign(command) * np.maximum(np.abs(command) - dead, 0.0)))
