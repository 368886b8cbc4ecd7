"""From a model file and a specification to a tuning problem."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from optid.armax.files import ArmaxFile
from optid.armax.model import Armax
from optid.errors import InputError
from optid.rigs.rigfile import Rig
from optid.tuning.bench import PhysicalBench
from optid.tuning.compensation import dead_band_of
from optid.tuning.defaults import (
    command_limits,
    controller_settings,
    episode_samples,
    half_range,
    reachable,
    refuse_no_step,
    refuse_out_of_reach,
    usual_step,
)
from optid.tuning.integrator import with_integrator
from optid.tuning.judges import LINEAR, STICKING, judges_of, with_rig
from optid.tuning.known import sensor_noise
from optid.tuning.plant import plant_of, scenarios
from optid.tuning.specification import TuningSpec
from optid.tuning.step_tests import StepPlan, hunting_limit, sizes_for
from optid.tuning.structures import usual_structure
from optid.tuning.task import Task

USUAL_UNITS = {"command": "V", "position": "m", "pressure_a": "Pa", "pressure_b": "Pa"}


@dataclass(frozen=True, eq=False)
class TuningProblem:
    """A task and its assumptions.

    Attributes:
        task: to tune.
        model: of the file.
        command_unit, output_unit: SI.
        bench: the rig's model, where a rig was given.
        assumed: in sentences.
        judged_on: the plant on which costs are computed, in words.
    """

    task: Task
    model: Armax
    command_unit: str
    output_unit: str
    bench: PhysicalBench | None
    assumed: tuple[str, ...]
    judged_on: str = LINEAR

    @property
    def structure(self) -> str:
        """The default control structure's name."""
        return usual_structure(self.task.bench_alone, self.judged_on != STICKING)

    def without_sensitivity(self) -> TuningProblem:
        """The same without a bound on the maximum sensitivity, for a model that cannot meet it."""
        required = replace(self.task.required, maximum_sensitivity=None)
        bound = self.task.required.maximum_sensitivity
        said = f"No gains keep a maximum sensitivity of {bound:g} on this model: the bound is dropped."
        return replace(self, task=replace(self.task, required=required), assumed=(*self.assumed, said))


def units_of(contents: ArmaxFile) -> tuple[str, str]:
    """Units of command and output: from the file, else from their roles, else "1"."""
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
    spec: TuningSpec,
    rng: np.random.Generator,
    rig: Rig | None = None,
    tune_on_rig: bool = True,
) -> TuningProblem:
    """Build a task from a model file.

    Args:
        contents: of armax.json.
        where: that file, for messages.
        spec: of the tuning.
        rng: source of the scenarios.
        rig: a physical model of the same axis, to test gains.
        tune_on_rig: also include its cost in the tuning.

    Raises:
        InputError: spec that contradict each other or the model.
    """
    model, assumed = model_of(contents, spec.order, where), []
    if len(model.b) != 1:
        raise InputError(
            f"{len(model.b)} inputs",
            where=where,
            field="input",
            expected="a model with one command to control",
        )
    plant, sentence = with_integrator(plant_of(model, where=where), model, spec.integrator)
    assumed += [sentence] if sentence else []
    command_unit, output_unit = units_of(contents)
    low, high, words = command_limits(spec, command_unit, rig)
    assumed += words
    settings = controller_settings(spec, plant, (low, high), where)
    if spec.compensate:
        settings = dead_band_of(settings, rig)
    samples = episode_samples(spec, plant)
    wanted = spec.setpoints
    refuse_no_step(wanted)
    if not (wanted or spec.profiles):
        size, sentence = usual_step(plant, output_unit, settings, samples, rig)
        wanted, assumed = (size,), [*assumed, sentence]
    refuse_out_of_reach(plant, spec, settings, output_unit)
    noise = plant.noise if rig is None else sensor_noise(rig, contents.output) or plant.noise
    sizes = sizes_for(wanted, lambda size: reachable(plant, settings, size)) if wanted else ()
    plan = StepPlan(sizes, samples, model.sample_time, noise, power=spec.criterion.measure.power)
    plants = tuple(
        replace(with_integrator(one, model, spec.integrator)[0], dead_zone=spec.dead_zone)
        for one in scenarios(model, spec.scenarios, rng)
    )
    known = model, contents.axis if model is contents.chosen else None
    judges = judges_of(plan, plants[0], known, spec, settings, rig if tune_on_rig else None)
    if rig is not None:
        axis = known[1], half_range(settings)
        judges = with_rig(judges, plan, spec, (rig, contents.output, tune_on_rig), rng, axis)
    required = spec.required
    if spec.usual_sensitivity:
        required = replace(required, maximum_sensitivity=judges.sensitivity)
    hunting = hunting_limit(max(map(abs, sizes)), noise) if sizes else math.inf
    task = Task(
        plants,
        judges.episodes,
        settings,
        spec.criterion,
        required,
        spec.over,
        judges.judge,
        judges.judge is not None,
        hunting,
    )
    said = (*assumed, *judges.said)
    return TuningProblem(task, model, command_unit, output_unit, judges.bench, said, judges.words)
