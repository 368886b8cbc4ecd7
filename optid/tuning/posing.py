"""From a model file and a few wishes to a task: defaults that a model of any size and unit can live with."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from optid.armax.files import ArmaxFile
from optid.armax.model import Armax
from optid.core.model import Array
from optid.errors import InputError
from optid.pid.controller import AntiWindup, Settings
from optid.rigs.rigfile import Rig
from optid.tuning.bench import PhysicalBench
from optid.tuning.criterion import Criterion
from optid.tuning.demand import Episode, load, profile, step
from optid.tuning.margins import Required
from optid.tuning.plant import Plant, plant_of, scenarios
from optid.tuning.reaction import reaction
from optid.tuning.task import Over, Task
from optid.tuning.ultimate import ultimate

STEP = 0.06  # m: the paper's step of 6 cm
COMMAND = 5.0  # V to either side, where nobody says what a full command is
SAMPLES = 2000  # of an episode, unless the plant wants more
PERIODS = 20  # ultimate periods that an episode holds at least
LONGEST = 200_000  # samples
USUAL_UNITS = {"command": "V", "position": "m", "pressure_a": "Pa", "pressure_b": "Pa"}


@dataclass(frozen=True)
class Wishes:
    """What a user asks for, SI; what is empty or None is chosen to suit the model.

    Attributes:
        order: na of the model to take; the recommended one.
        setpoints: steps from rest, each an episode.
        disturbances: steps of the command from outside, each an episode beside those.
        profiles: name and path (samples,), each an episode.
        low, high, rate, resolution, deadband, anti_windup: of the controller's command.
        horizon: s of every episode.
        sample_time: s at which the controller runs; must be the model's.
        criterion, required, over: see `Task`.
        scenarios: plants drawn from the model's covariance, the model itself counted.
    """

    order: int | None = None
    setpoints: tuple[float, ...] = ()
    disturbances: tuple[float, ...] = ()
    profiles: tuple[tuple[str, Array], ...] = ()
    low: float | None = None
    high: float | None = None
    rate: float | None = None
    resolution: float = 0.0
    deadband: tuple[float, float, float] = (0.0, 0.0, 0.0)
    anti_windup: AntiWindup = AntiWindup.CLAMPING
    horizon: float | None = None
    sample_time: float | None = None
    criterion: Criterion = field(default_factory=Criterion)
    required: Required = field(default_factory=Required)
    over: Over = Over.WORST
    scenarios: int = 1


@dataclass(frozen=True, eq=False)
class Posed:
    """A task and what was assumed for it.

    Attributes:
        task: to tune.
        model: of the file.
        command_unit, output_unit: SI.
        bench: the rig's model, where a rig was given.
        assumed: in sentences.
    """

    task: Task
    model: Armax
    command_unit: str
    output_unit: str
    bench: PhysicalBench | None
    assumed: tuple[str, ...]

    def without_sensitivity(self) -> Posed:
        """The same with no bound on the maximum sensitivity, for a model that allows none."""
        required = replace(self.task.required, maximum_sensitivity=None)
        bound = self.task.required.maximum_sensitivity
        said = f"No gains keep a maximum sensitivity of {bound:g} on this model: none is asked for."
        return replace(self, task=replace(self.task, required=required), assumed=(*self.assumed, said))


def units_of(contents: ArmaxFile) -> tuple[str, str]:
    """Of command and output: as the file says, else as their roles suggest, else "1"."""
    return (
        contents.input_unit or USUAL_UNITS.get(contents.input, "1"),
        contents.output_unit or USUAL_UNITS.get(contents.output, "1"),
    )


def model_of(contents: ArmaxFile, order: int | None, where: Path) -> Armax:
    """The recommended model or the one of an order.

    Raises:
        InputError: no such order.
    """
    if order is None:
        return contents.chosen
    found = {saved.model.orders.na: saved.model for saved in contents.models}
    if order not in found:
        raise InputError(
            f"{order}", where=where, field="order", expected=" or ".join(str(na) for na in found)
        )
    return found[order]


def pose(
    contents: ArmaxFile,
    where: Path,
    wishes: Wishes,
    rng: np.random.Generator,
    rig: Rig | None = None,
    tune_on_rig: bool = True,
) -> Posed:
    """Make a task of a model file.

    Args:
        contents: of armax.json.
        where: that file, for messages.
        wishes: what is asked.
        rng: source of the scenarios.
        rig: a physical model of the same axis, to try gains on.
        tune_on_rig: let its cost count in the tuning, too.

    Raises:
        InputError: wishes that contradict each other or the model.
    """
    model, assumed = model_of(contents, wishes.order, where), []
    if len(model.b) != 1:
        raise InputError(
            f"{len(model.b)} inputs",
            where=where,
            field="input",
            expected="a model with one command to control",
        )
    plant = plant_of(model, where=where)
    command_unit, output_unit = units_of(contents)
    low, high, said = _limits(wishes, command_unit, rig)
    assumed += said
    settings = _settings(wishes, plant, (low, high), where)
    samples = _samples(wishes, plant)
    setpoints = wishes.setpoints
    if not (setpoints or wishes.profiles):
        size, words = _usual_step(plant, output_unit, settings, samples)
        setpoints, assumed = (size,), [*assumed, words]
    episodes = _episodes(setpoints, wishes, samples, model.sample_time)
    plants = scenarios(model, wishes.scenarios, rng)
    bench = None if rig is None else PhysicalBench(rig, episodes, contents.output, plant.noise)
    on_rig = bench if tune_on_rig else None
    task = Task(plants, episodes, settings, wishes.criterion, wishes.required, wishes.over, on_rig)
    return Posed(task, model, command_unit, output_unit, bench, tuple(assumed))


def _settings(wishes: Wishes, plant: Plant, limits: tuple[float, float], where: Path) -> Settings:
    """Of the controller; anti-windup by back-calculation works within half an ultimate period."""
    T = plant.sample_time if wishes.sample_time is None else wishes.sample_time
    if not math.isclose(T, plant.sample_time, rel_tol=1e-9):
        raise InputError(
            f"{T:g} s, and the model was identified at {plant.sample_time:g} s", where=where,
            field="sample_time", expected="the model's own",
            hint="identify from a recording at the controller's rate",
        )  # fmt: skip
    back = wishes.anti_windup is AntiWindup.BACK_CALCULATION
    tracking = max(0.5 * ultimate(plant).period, plant.sample_time) if back else 0.0
    return Settings(
        plant.sample_time, *limits, math.inf if wishes.rate is None else wishes.rate,
        -wishes.deadband[0], wishes.deadband[1], wishes.deadband[2], wishes.resolution, wishes.anti_windup, tracking,
    )  # fmt: skip


def _limits(wishes: Wishes, unit: str, rig: Rig | None) -> tuple[float, float, list[str]]:
    """As asked, else the rig file's full command, else 5 V; none for a command that is not in volts."""
    if wishes.low is not None and wishes.high is not None:
        return wishes.low, wishes.high, []
    if rig is not None:
        channel = rig.channels[next(port.role for port in rig.model.recorded)]
        if channel.full_scale is not None:
            full = channel.full_scale * channel.per_unit
            return -full, full, [f"Limits of ±{full:g} {unit}: the rig file's full scale."]
    if unit == "V":
        return -COMMAND, COMMAND, [f"Limits of ±{COMMAND:g} V: nobody said otherwise (--limits)."]
    return -math.inf, math.inf, [f"No limits of the command ({unit}): nobody said any (--limits)."]


def _samples(wishes: Wishes, plant: Plant) -> int:
    """Of an episode: as asked, as the longest profile needs, or 2000 and more where the plant is slower."""
    T = plant.sample_time
    if wishes.horizon is not None:
        samples = round(wishes.horizon / T) if math.isfinite(wishes.horizon) else 0
        if not 20 <= samples <= LONGEST:
            raise InputError(
                f"{wishes.horizon:g} s", field="horizon", expected=f"{20 * T:g} to {LONGEST * T:g} s"
            )
        return samples
    if wishes.profiles:
        return max(path.size for _, path in wishes.profiles)
    return min(max(SAMPLES, math.ceil(PERIODS * ultimate(plant).period / T)), LONGEST)


def _usual_step(plant: Plant, unit: str, settings: Settings, samples: int) -> tuple[float, str]:
    if unit == "m":
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
    return size, f"A step of {said}, which half of the command can make (--setpoint)."


def _episodes(
    setpoints: Sequence[float], wishes: Wishes, samples: int, sample_time: float
) -> tuple[Episode, ...]:
    """Steps of every size weigh alike: their costs are scaled to that of the first one."""
    found = []
    for size in setpoints:
        if not (math.isfinite(size) and size != 0.0):
            raise InputError(f"{size:g}", field="setpoint", expected="a step that is not zero")
        power = wishes.criterion.measure.power
        found.append(step(size, samples, sample_time, abs(setpoints[0] / size) ** power))
    for name, path in wishes.profiles:
        held = np.r_[path, np.full(max(samples - path.size, 0), path[-1])][:samples]
        found.append(profile(held, sample_time, name))
    found.extend(load(size, samples, sample_time) for size in wishes.disturbances)
    return tuple(found)
