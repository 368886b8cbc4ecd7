"""The simulation that judges the gains: the rig's model, the identified model with dry friction, or without."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from optid.armax.model import Armax
from optid.armax.sliding import SlidingAxis
from optid.pid.controller import Settings
from optid.rigs.rigfile import Rig
from optid.tuning.bench import Bench, PhysicalBench
from optid.tuning.defaults import half_range
from optid.tuning.guarded_bench import GuardedBench
from optid.tuning.known import fitted, parameter_sets
from optid.tuning.plant import Plant
from optid.tuning.scenarios import Episode, load, profile
from optid.tuning.specification import TuningSpec
from optid.tuning.step_tests import STRONGER, StepPlan
from optid.tuning.sticking_axis import StickingAxis, assumed_mechanics, fitted_mechanics

UNIT = "V"  # of a constant load
RUNS, SHOWN_RUNS = 2, 5  # runs of each size; those in tables
# With assumed friction; with friction identified from a recording, where more runs meet more of what its simulation has
# and the rig has not; with a rig's model: with 39 runs gains were found that hunt in one of 203 on the rig.
STICKING_RUNS, FITTED_RUNS, BENCH_RUNS = 9, 39, 78
# Factor on the command in a third of the steps of an axis that a recording shows: the smallest gain margin that is
# usually recommended (Astrom and Hagglund, Advanced PID Control, 2006, section 4.6: 2 to 5).
GAIN_MARGIN = 2.0
BENCH_TOLERANCE = 1e-3  # of its integration: costs of good gains differ by up to 3 % from those at 1e-5
# Default bound on the maximum sensitivity: within the recommended range (Astrom and Hagglund, Advanced PID Control,
# 2006, section 4.6); and on the identified model with an assumed dry friction, which damps small motions as no linear
# model does. With a rig's model no bound: friction that was measured is simulated, and so is a stronger plant.
SENSITIVITY, BESIDE_FRICTION = 2.0, 5.0
SMALLEST_LOAD = 2e-3  # of half the command's range: smaller constant loads are ignored
SURE = 3.0  # standard errors by which a constant load must differ from 0
LINEAR = "the identified linear model"
STICKING = "the identified model with dry friction"
FITTED = "the axis with dry friction that the recording shows"
PHYSICAL = "the rig's physical model"
GUARDED = (
    "Gains must not hunt on the axis that the recording shows either: where an axis rests, two models seldom err "
    "alike."
)


@dataclass(frozen=True, eq=False)
class Judges:
    """The judges: the plant with friction, if any, the rig's bench, their episodes, and remarks."""

    judge: Bench | None
    episodes: tuple[Episode, ...]
    words: str
    said: tuple[str, ...] = ()
    bench: PhysicalBench | None = None
    sensitivity: float | None = SENSITIVITY


def judges_of(
    plan: StepPlan,
    plant: Plant,
    known: tuple[Armax, SlidingAxis | None],
    spec: TuningSpec,
    settings: Settings,
    rig: Rig | None,
) -> Judges:
    """Without a rig: the axis fitted to the recording, else the identified model, with friction if it is an axis.

    Args:
        plan: of the steps.
        plant: of the model.
        known: the model, and the axis that was fitted to its recording.
        spec: of the tuning.
        settings: of the controller.
        rig: whose physical model judges.
    """
    model, shown = known
    half = half_range(settings)
    assumed = assumed_mechanics(plant, half) if rig is None and math.isfinite(half) else ()
    if not assumed:
        return Judges(None, episodes_of(replace(plan, runs=RUNS), spec), LINEAR)
    if shown is not None:
        return _judged_by_shown(plan, shown, spec, half)
    load = standing_load(model, plant, half)
    plan = replace(plan, runs=STICKING_RUNS, variants=len(assumed) - 1, load=load, quiet=False)
    episodes = episodes_of(plan, spec)
    judge = StickingAxis(assumed, episodes, spec.dead_zone)
    return Judges(judge, episodes, STICKING, tuple(_said_of_axis(load, UNIT)), sensitivity=BESIDE_FRICTION)


def _judged_by_shown(plan: StepPlan, shown: SlidingAxis, spec: TuningSpec, half: float) -> Judges:
    """Judges with the axis that was fitted to the recording."""
    judge = _identified_axis(replace(plan, runs=FITTED_RUNS), shown, spec, half, GAIN_MARGIN)
    said = _said_of_shown(shown, len(judge.axes) - 1)
    return Judges(judge, judge.episodes, FITTED, said, sensitivity=None)


def _identified_axis(
    plan: StepPlan, shown: SlidingAxis, spec: TuningSpec, half: float, stronger: float
) -> StickingAxis:
    """The simulation of the axis that was fitted to the recording, with other sets of values."""
    axes = fitted_mechanics(shown, half)
    plan = replace(plan, variants=len(axes) - 1, load=shown.load, stronger=stronger, quiet=False)
    dead = spec.dead_zone if any(spec.dead_zone) else (-shown.dead_zone, shown.dead_zone)
    return StickingAxis(axes, episodes_of(plan, spec), dead)


def _said_of_shown(shown: SlidingAxis, variants: int) -> tuple[str, ...]:
    speed = shown.dry_friction / max(shown.damping, 1e-9)
    more = f"{100 * (shown.breakaway_ratio - 1):.0f} % more at rest"
    said = (
        f"Dry friction identified from the recording: as large as the viscous friction at {speed:.3g} m/s, "
        f"{more if shown.breakaway_ratio > 1.0 else 'the same at rest'}; {variants} other sets of values "
        "are tested as well (--rig gives it more exactly)."
    )
    dead = (
        f"A dead zone of ±{shown.dead_zone:.3g} {UNIT}, identified from the recording, is part of the plant."
    )
    load = f"A constant load of {shown.load:.3g} {UNIT}, identified from the recording."
    return (
        said,
        *((dead,) if shown.dead_zone else ()),
        *((load,) if shown.load else ()),
        _said_of_margin(GAIN_MARGIN),
    )


def with_rig(
    judges: Judges,
    plan: StepPlan,
    spec: TuningSpec,
    known: tuple[Rig, str, bool],
    rng: np.random.Generator,
    axis: tuple[SlidingAxis | None, float],
) -> Judges:
    """Judges with a rig's physical model, which judges performance or is only tested on the others' episodes.

    Args:
        judges: without it.
        plan: of the steps.
        spec: of the tuning.
        known: the rig, the role of the output, and whether it judges.
        rng: source of further parameter sets.
        axis: fitted to the recording, on which gains must not hunt, and half the range of the command.
    """
    rig, output, judging = known
    usual = spec.usual_sensitivity
    variants = parameter_sets(rig, rng)
    if not judging:
        return replace(
            judges, bench=PhysicalBench(rig, judges.episodes, output, 0.0, variants, BENCH_TOLERANCE)
        )
    plan = replace(plan, runs=BENCH_RUNS)
    on_rig = replace(plan, variants=len(variants), stronger=STRONGER, quiet=False)
    episodes = episodes_of(on_rig, spec)
    shown = episodes_of(replace(on_rig, runs=SHOWN_RUNS), spec)
    judge, bench = (
        PhysicalBench(rig, one, output, 0.0, variants, BENCH_TOLERANCE) for one in (episodes, shown)
    )
    said = (
        _said_of_rig(len(variants), fitted(rig), plan.noise),
        *((_said_of_margin(STRONGER),) if usual else ()),
    )
    identified, half = axis
    if identified is None or not math.isfinite(half):
        return Judges(judge, shown, PHYSICAL, said, bench, None)
    guarded = GuardedBench(judge, _identified_axis(plan, identified, spec, half, STRONGER))
    return Judges(guarded, shown, PHYSICAL, (*said, GUARDED), bench, None)


def _said_of_margin(factor: float) -> str:
    return (
        f"No bound on the maximum sensitivity: the gains are tested with {factor:g} times the command, friction and "
        "limits included; the identified linear model has no friction (--ms 2 requires gains that are robust on it, "
        "too)."
    )


def _said_of_rig(variants: int, sure: bool, noise: float) -> str:
    sets = (
        f"{variants} more parameter sets from the intervals of its fit"
        if sure
        else (
            f"{variants} more parameter sets around it, because no fit.json lies beside the rig file (optid fit)"
        )
    )
    return (
        "Performance is judged on the rig's model, margins on the identified model; "
        f"{sets if variants else 'no other parameter sets'}; sensor noise {noise:.3g} (sd)."
    )


def _said_of_axis(load: float, unit: str) -> list[str]:
    said = [
        "The model has no dry friction, and integral action tuned on a linear model makes an axis with stiction "
        "hunt: half of the model's damping (also a quarter and three quarters) is taken as dry friction (--rig "
        "gives it more exactly)."
    ]
    if load:
        said.append(
            f"A constant load of {load:.3g} {unit}, which the recording shows: without integral action it leaves an "
            f"error of {abs(load):.3g} {unit} over kp (--structure pid removes it, and may hunt)."
        )
    return said


def standing_load(model: Armax, plant: Plant, half: float) -> float:
    """The constant load on an integrating plant, as a command: from the model's constant, if it is significant.

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


def episodes_of(plan: StepPlan, spec: TuningSpec) -> tuple[Episode, ...]:
    """The steps, whose weights sum to 1, then the other episodes."""
    found = list(plan.episodes()) if plan.sizes else []
    for name, path in spec.profiles:
        held = np.r_[path, np.full(max(plan.samples - path.size, 0), path[-1])][: plan.samples]
        found.append(profile(held, plan.sample_time, name))
    found.extend(load(size, plan.samples, plan.sample_time) for size in spec.disturbances)
    return tuple(found)
