"""Defaults of a tuning: limits, steps, horizon; and set-points that no command can hold."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from optid.errors import InputError
from optid.pid.controller import AntiWindup, Settings
from optid.rigs.rigfile import Rig
from optid.tuning.plant import Plant
from optid.tuning.reaction_curve import reaction
from optid.tuning.specification import TuningSpec
from optid.tuning.ultimate import ultimate

STEP = 0.06  # m: the paper's step of 6 cm
COMMAND = 5.0  # V to each side, where the full command is not stated
SAMPLES = 2500  # samples of an episode, unless the plant needs more
STROKE_SHARE = 0.3  # of the stroke: the default of the largest step
PERIODS = 20  # smallest number of ultimate periods in an episode
LONGEST = 200_000  # samples


def refuse_no_step(sizes: Sequence[float]) -> None:
    """Refuse a step that is zero or not finite.

    Raises:
        InputError: one is not.
    """
    for size in sizes:
        if not (math.isfinite(size) and size != 0.0):
            raise InputError(f"{size:g}", field="setpoint", expected="a step that is not zero")


def half_range(settings: Settings) -> float:
    """The smaller of both limits of the command."""
    return min(abs(settings.low), abs(settings.high))


def reachable(plant: Plant, settings: Settings, size: float) -> bool:
    """Whether some constant command within the limits holds the output there."""
    if not math.isfinite(plant.static_gain) or any(abs(p) >= 1.0 for p in plant.poles):
        return True
    ends = sorted(plant.static_gain * limit for limit in (settings.low, settings.high))
    return ends[0] <= size <= ends[1]


def refuse_out_of_reach(plant: Plant, spec: TuningSpec, settings: Settings, unit: str) -> None:
    """Refuse a set-point that no command within the limits can hold.

    Raises:
        InputError: a set-point or a profile beyond the static gain times a limit.
    """
    paths = [(path - path[0], "--profile") for _, path in spec.profiles if path.size]
    asked = [(size, "--setpoint") for size in spec.setpoints]
    for path, name in paths:
        asked += [(float(path.max()), name), (float(path.min()), name)]
    for size, name in asked:
        if not reachable(plant, settings, size):
            far = max(abs(plant.static_gain * limit) for limit in (settings.low, settings.high))
            raise InputError(
                f"{size:g} {unit} is out of reach: static gain {plant.static_gain:.3g} times the limit "
                f"({settings.low:g} to {settings.high:g}) holds {far:.3g} {unit} at most",
                where=name,
                field="setpoint",
                expected="a set-point that a constant command within the limits can hold",
                hint="choose a smaller step, or widen --limits",
            )


def controller_settings(spec: TuningSpec, plant: Plant, limits: tuple[float, float], where: Path) -> Settings:
    """Of the controller; anti-windup by back-calculation works within half an ultimate period."""
    T = plant.sample_time if spec.sample_time is None else spec.sample_time
    if not math.isclose(T, plant.sample_time, rel_tol=1e-9):
        raise InputError(
            f"{T:g} s, and the model was identified at {plant.sample_time:g} s",
            where=where,
            field="sample_time",
            expected="the model's own",
            hint="identify from a recording at the controller's rate",
        )
    back = spec.anti_windup is AntiWindup.BACK_CALCULATION
    tracking = max(0.5 * ultimate(plant).period, plant.sample_time) if back else 0.0
    return Settings(
        plant.sample_time,
        *limits,
        math.inf if spec.rate is None else spec.rate,
        -spec.deadband[0],
        spec.deadband[1],
        spec.deadband[2],
        spec.resolution,
        spec.anti_windup,
        tracking,
        spec.acceleration,
        notch=spec.notch,
    )


def command_limits(spec: TuningSpec, unit: str, rig: Rig | None) -> tuple[float, float, list[str]]:
    """As given, else the rig file's full command, else 5 V; none for a command that is not in volts."""
    if spec.low is not None and spec.high is not None:
        return spec.low, spec.high, []
    if rig is not None:
        channel = rig.channels[next(port.role for port in rig.model.recorded)]
        if channel.full_scale is not None:
            full = channel.full_scale * channel.per_unit
            return -full, full, [f"Limits of ±{full:g} {unit}: the rig file's full scale."]
    if unit == "V":
        return -COMMAND, COMMAND, [f"Limits of ±{COMMAND:g} V by default (--limits)."]
    return -math.inf, math.inf, [f"The command ({unit}) is not limited: no limits were given (--limits)."]


def episode_samples(spec: TuningSpec, plant: Plant) -> int:
    """Samples of an episode: as given, as the longest profile needs, or 2000, and more for a slow plant."""
    T = plant.sample_time
    if spec.horizon is not None:
        samples = round(spec.horizon / T) if math.isfinite(spec.horizon) else 0
        if not 20 <= samples <= LONGEST:
            raise InputError(
                f"{spec.horizon:g} s", field="horizon", expected=f"{20 * T:g} to {LONGEST * T:g} s"
            )
        return samples
    if spec.profiles:
        return max(path.size for _, path in spec.profiles)
    return min(max(SAMPLES, math.ceil(PERIODS * ultimate(plant).period / T)), LONGEST)


def usual_step(
    plant: Plant, unit: str, settings: Settings, samples: int, rig: Rig | None
) -> tuple[float, str]:
    """The default of the largest step, output's unit, and a sentence on it."""
    stroke = math.inf if rig is None else rig.parameters.get("stroke", math.inf)
    if unit == "m" and math.isfinite(stroke):
        size = float(f"{STROKE_SHARE * stroke:.2g}")
        return size, f"Steps of up to {100 * size:g} cm, {100 * STROKE_SHARE:g} % of the stroke (--setpoint)."
    if unit == "m" and reachable(plant, settings, STEP):
        return STEP, f"A step of {100 * STEP:g} cm, as in the paper (--setpoint)."
    most = min(abs(settings.low), abs(settings.high))
    most = most if 0.0 < most < math.inf else 1.0
    curve = reaction(plant, ultimate(plant))
    if all(abs(pole) < 1.0 for pole in plant.poles) and math.isfinite(plant.static_gain):
        size = 0.5 * most * abs(plant.static_gain)
    elif curve is not None and curve.integrating:
        size = 0.5 * most * abs(curve.gain) * samples * plant.sample_time / 10
    else:
        size = 1.0
    size = float(f"{size:.1g}")
    said = f"{size:g} {unit}".removesuffix(" 1")
    return size, f"A step of {said}, which half of the command can hold (--setpoint)."
