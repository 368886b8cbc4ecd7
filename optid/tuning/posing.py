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
from optid.tuning.bench import Bench, PhysicalBench
from optid.tuning.criterion import Criterion
from optid.tuning.demand import Episode, load, profile
from optid.tuning.integrator import Integrator, with_integrator
from optid.tuning.known import fitted, parameter_sets, sensor_noise
from optid.tuning.margins import Required
from optid.tuning.plant import Plant, plant_of, scenarios
from optid.tuning.reaction import reaction
from optid.tuning.step_tests import STRONGER, StepPlan, hunting_limit, sizes_for
from optid.tuning.sticking_axis import OTHERS, StickingAxis, mechanics
from optid.tuning.task import Over, Task
from optid.tuning.ultimate import ultimate

STEP = 0.06  # m: the paper's step of 6 cm
COMMAND = 5.0  # V to either side, where nobody says what a full command is
SAMPLES = 2500  # of an episode, unless the plant wants more
STROKE_SHARE = 0.3  # of the stroke: the largest step where nobody says one
RUNS, BENCH_RUNS, SHOWN_RUNS = 2, 16, 5  # of each size; where friction is simulated; of those in tables
BENCH_TOLERANCE = 2e-4  # of its integration: costs differ by 0.2 % from those at 1e-7
# Largest maximum sensitivity where nobody says one: of what is recommended (Astrom and Hagglund, Advanced PID Control,
# 2006, section 4.6); and on the identified model with an assumed dry friction, which damps small motions as no linear
# model does. With a rig's model no bound: friction that was measured is simulated, and so is a stronger plant.
SENSITIVITY, BESIDE_FRICTION = 2.0, 5.0
SIMULATED_MARGIN = (
    f"No bound on the maximum sensitivity: the gains are tried with {STRONGER:g} times the command, friction and "
    "limits included; the identified linear model knows no friction (--ms 2 asks for gains that it bears, too)."
)
SMALLEST_LOAD = 2e-3  # of half the command's range: standing loads below it are none
SURE = 3.0  # standard errors by which a standing load must differ from 0
PERIODS = 20  # ultimate periods that an episode holds at least
LONGEST = 200_000  # samples
USUAL_UNITS = {"command": "V", "position": "m", "pressure_a": "Pa", "pressure_b": "Pa"}
LINEAR = "the identified linear model"
STICKING = "the identified model with dry friction"
PHYSICAL = "the rig's physical model"


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
        integrator: whether the pole nearest to 1 is carried as exactly 1.
        dead_zone: (low, high) of the valve, part of the plant; command's unit.
        usual_sensitivity: bound the maximum sensitivity as usual for what judges: nobody said a bound.
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
    integrator: Integrator = Integrator.AUTO
    dead_zone: tuple[float, float] = (0.0, 0.0)
    usual_sensitivity: bool = False


@dataclass(frozen=True, eq=False)
class Posed:
    """A task and what was assumed for it.

    Attributes:
        task: to tune.
        model: of the file.
        command_unit, output_unit: SI.
        bench: the rig's model, where a rig was given.
        assumed: in sentences.
        judged_on: which plant the costs stand for, in words.
    """

    task: Task
    model: Armax
    command_unit: str
    output_unit: str
    bench: PhysicalBench | None
    assumed: tuple[str, ...]
    judged_on: str = LINEAR

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


def build_problem(
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
    plant, sentence = with_integrator(plant_of(model, where=where), model, wishes.integrator)
    assumed += [sentence] if sentence else []
    command_unit, output_unit = units_of(contents)
    low, high, words = _limits(wishes, command_unit, rig)
    assumed += words
    settings = _settings(wishes, plant, (low, high), where)
    samples = _samples(wishes, plant)
    wanted = wishes.setpoints
    _refuse_no_step(wanted)
    if not (wanted or wishes.profiles):
        size, sentence = _usual_step(plant, output_unit, settings, samples, rig)
        wanted, assumed = (size,), [*assumed, sentence]
    _refuse_out_of_reach(plant, wishes, settings, output_unit)
    noise = plant.noise if rig is None else sensor_noise(rig, contents.output) or plant.noise
    sizes = sizes_for(wanted, lambda size: _reached(plant, settings, size)) if wanted else ()
    plan = StepPlan(sizes, samples, model.sample_time, noise, power=wishes.criterion.measure.power)
    plants = tuple(
        replace(with_integrator(one, model, wishes.integrator)[0], dead_zone=wishes.dead_zone)
        for one in scenarios(model, wishes.scenarios, rng)
    )
    judges = _judges(plan, plants[0], model, wishes, settings, rig if tune_on_rig else None)
    if rig is not None:
        judges = _with_rig(judges, plan, wishes, (rig, contents.output, tune_on_rig), rng)
    required = wishes.required
    if wishes.usual_sensitivity:
        required = replace(required, maximum_sensitivity=judges.sensitivity)
    hunting = hunting_limit(max(map(abs, sizes)), noise) if sizes else math.inf
    task = Task(
        plants,
        judges.episodes,
        settings,
        wishes.criterion,
        required,
        wishes.over,
        judges.judge,
        judges.judge is not None,
        hunting,
    )
    said = (*assumed, *judges.said)
    return Posed(task, model, command_unit, output_unit, judges.bench, said, judges.words)


@dataclass(frozen=True, eq=False)
class _Judges:
    """Who judges what: the plant with friction, if any, the rig's bench beside it, their episodes, and words."""

    judge: Bench | None
    episodes: tuple[Episode, ...]
    words: str
    said: tuple[str, ...] = ()
    bench: PhysicalBench | None = None
    sensitivity: float | None = SENSITIVITY


def _judges(
    plan: StepPlan, plant: Plant, model: Armax, wishes: Wishes, settings: Settings, rig: Rig | None
) -> _Judges:
    """Without a rig: the identified model, with dry friction where it is an axis."""
    axis = mechanics(plant) if rig is None and math.isfinite(_half(settings)) else None
    if axis is None:
        return _Judges(None, _episodes(replace(plan, runs=RUNS), wishes), LINEAR)
    load = standing_load(model, plant, _half(settings))
    episodes = _episodes(replace(plan, runs=BENCH_RUNS, variants=len(OTHERS), load=load), wishes)
    judge = StickingAxis(axis, episodes, _half(settings), wishes.dead_zone)
    unit = USUAL_UNITS["command"]
    return _Judges(judge, episodes, STICKING, tuple(_said_of_axis(load, unit)), sensitivity=BESIDE_FRICTION)


def _with_rig(
    judges: _Judges, plan: StepPlan, wishes: Wishes, known: tuple[Rig, str, bool], rng: np.random.Generator
) -> _Judges:
    """With a rig's physical model: it judges, or is only tried on the episodes of what does."""
    rig, output, judging = known
    usual = wishes.usual_sensitivity
    variants = parameter_sets(rig, rng)
    if not judging:
        return replace(
            judges, bench=PhysicalBench(rig, judges.episodes, output, 0.0, variants, BENCH_TOLERANCE)
        )
    plan = replace(plan, variants=len(variants), stronger=STRONGER)
    episodes = _episodes(replace(plan, runs=BENCH_RUNS), wishes)
    shown = _episodes(replace(plan, runs=SHOWN_RUNS), wishes)
    judge, bench = (
        PhysicalBench(rig, one, output, 0.0, variants, BENCH_TOLERANCE) for one in (episodes, shown)
    )
    said = (_said_of_rig(len(variants), fitted(rig), plan.noise), *((SIMULATED_MARGIN,) if usual else ()))
    return _Judges(judge, shown, PHYSICAL, said, bench, None)


def _said_of_rig(variants: int, sure: bool, noise: float) -> str:
    sets = (
        f"{variants} parameter sets beside it from its fit's intervals"
        if sure
        else (f"{variants} parameter sets around it, as no fit.json lies beside the rig file (optid fit)")
    )
    return (
        "The rig's model judges performance, the identified one the margins; "
        f"{sets if variants else 'no other parameters'}; sensor noise {noise:.3g} (sd)."
    )


def _said_of_axis(load: float, unit: str) -> list[str]:
    said = [
        "The model holds no dry friction, and integral action that a linear model likes makes an axis that sticks "
        "hunt: half of the model's damping (a quarter, three quarters) is taken for dry friction "
        "(--rig knows it better)."
    ]
    if load:
        said.append(f"A standing load of {load:.3g} {unit}, which the recording shows.")
    return said


def standing_load(model: Armax, plant: Plant, half: float) -> float:
    """What holds an integrating plant back or drives it, as a command: the model's constant, where it is sure.

    Args:
        model: with its constant, if it has one.
        plant: of it.
        half: half the range of the command.
    """
    constant = float(getattr(model, "constant", 0.0))
    errors = getattr(model, "trend_errors", None)
    sd = float(errors[0]) if errors else 0.0
    load = constant / float(plant.b.sum())
    sure = abs(constant) > SURE * sd if math.isfinite(sd) else False
    return load if sure and SMALLEST_LOAD * half < abs(load) < half else 0.0


def _refuse_no_step(sizes: Sequence[float]) -> None:
    for size in sizes:
        if not (math.isfinite(size) and size != 0.0):
            raise InputError(f"{size:g}", field="setpoint", expected="a step that is not zero")


def _half(settings: Settings) -> float:
    return min(abs(settings.low), abs(settings.high))


def _reached(plant: Plant, settings: Settings, size: float) -> bool:
    """Whether some constant command within the limits holds the output there."""
    if not math.isfinite(plant.static_gain) or any(abs(p) >= 1.0 for p in plant.poles):
        return True
    ends = sorted(plant.static_gain * limit for limit in (settings.low, settings.high))
    return ends[0] <= size <= ends[1]


def _refuse_out_of_reach(plant: Plant, wishes: Wishes, settings: Settings, unit: str) -> None:
    """No gains hold an output that no command holds.

    Raises:
        InputError: a set-point or a profile beyond the static gain times a limit.
    """
    paths = [(path - path[0], "--profile") for _, path in wishes.profiles if path.size]
    asked = [(size, "--setpoint") for size in wishes.setpoints]
    for path, name in paths:
        asked += [(float(path.max()), name), (float(path.min()), name)]
    for size, name in asked:
        if not _reached(plant, settings, size):
            far = max(abs(plant.static_gain * limit) for limit in (settings.low, settings.high))
            raise InputError(
                f"{size:g} {unit} is out of reach: static gain {plant.static_gain:.3g} times the limit "
                f"({settings.low:g} to {settings.high:g}) holds {far:.3g} {unit} at most",
                where=name,
                field="setpoint",
                expected="a set-point that a constant command within the limits can hold",
                hint="ask for less, or widen --limits",
            )


def _settings(wishes: Wishes, plant: Plant, limits: tuple[float, float], where: Path) -> Settings:
    """Of the controller; anti-windup by back-calculation works within half an ultimate period."""
    T = plant.sample_time if wishes.sample_time is None else wishes.sample_time
    if not math.isclose(T, plant.sample_time, rel_tol=1e-9):
        raise InputError(
            f"{T:g} s, and the model was identified at {plant.sample_time:g} s",
            where=where,
            field="sample_time",
            expected="the model's own",
            hint="identify from a recording at the controller's rate",
        )
    back = wishes.anti_windup is AntiWindup.BACK_CALCULATION
    tracking = max(0.5 * ultimate(plant).period, plant.sample_time) if back else 0.0
    return Settings(
        plant.sample_time,
        *limits,
        math.inf if wishes.rate is None else wishes.rate,
        -wishes.deadband[0],
        wishes.deadband[1],
        wishes.deadband[2],
        wishes.resolution,
        wishes.anti_windup,
        tracking,
    )


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


def _usual_step(
    plant: Plant, unit: str, settings: Settings, samples: int, rig: Rig | None
) -> tuple[float, str]:
    stroke = math.inf if rig is None else rig.parameters.get("stroke", math.inf)
    if unit == "m" and math.isfinite(stroke):
        size = float(f"{STROKE_SHARE * stroke:.2g}")
        return size, f"Steps of up to {100 * size:g} cm, {100 * STROKE_SHARE:g} % of the stroke (--setpoint)."
    if unit == "m" and _reached(plant, settings, STEP):
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


def _episodes(plan: StepPlan, wishes: Wishes) -> tuple[Episode, ...]:
    """The steps, whose weights sum to 1, then what else is asked for."""
    found = list(plan.episodes()) if plan.sizes else []
    for name, path in wishes.profiles:
        held = np.r_[path, np.full(max(plan.samples - path.size, 0), path[-1])][: plan.samples]
        found.append(profile(held, plan.sample_time, name))
    found.extend(load(size, plan.samples, plan.sample_time) for size in wishes.disturbances)
    return tuple(found)
