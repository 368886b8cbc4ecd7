"""Tuning of the running loop: gains are found and reviewed in a separate process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from optid.live.background import Background
from optid.live.plan import Plan
from optid.live.review import Case, Review, review
from optid.pid.controller import Gains
from optid.rigs.rigfile import Rig, read_rig
from optid.tuning.bench import PhysicalBench
from optid.tuning.judges import BENCH_TOLERANCE
from optid.tuning.known import parameter_sets, sensor_noise
from optid.tuning.margins import Required, margins
from optid.tuning.optimise import Options, optimise
from optid.tuning.step_tests import STRONGER, StepPlan, hunting_limit, sizes_for
from optid.tuning.task import Task

BRISK = 2.0  # maximum sensitivity up to which the gains in use may define the bound for new ones
INDIFFERENT = 1.002  # ratio of costs that the physical model's integration does not tell from 1
RUNS = 8  # of each size of step on the physical model


class Tuning:
    """One tuning at a time, in the background.

    Args:
        plan: of the session.
        note: called with events in words.

    Attributes:
        review: of the last gains found.
    """

    def __init__(self, plan: Plan, note: Callable[[str], None]) -> None:
        self._plan, self._note = plan, note
        self._background: Background[Review] = Background(not plan.fast)
        self.review: Review | None = None

    @property
    def busy(self) -> bool:
        """A tuning is under way."""
        return self._background.busy

    def begin(self, case: Case) -> None:
        """Start; call `poll` until `busy` is false."""
        self._background.begin(tuned, case, self._plan)

    def poll(self) -> None:
        """Check whether it is finished."""
        try:
            found = self._background.result()
        except Exception as error:  # whatever failed in the tuning's process, the loop continues
            self._note(f"not tuned: {error}")
            return
        if found is not None:
            self.review = found
            self._note(f"tuned: {found.words}")

    def close(self) -> None:
        """Cancel the job."""
        self._background.close()


def tuned(case: Case, plan: Plan, room: float | None = None) -> Review:
    """Gains that are good on the physical model, with margins on the identified one for what neither knows.

    The physical model judges as for `optid tune --rig`: steps of several sizes in both directions, with the sensor's
    noise, with parameters from the fit's intervals, and some with a plant that answers more strongly.

    Args:
        case: the loop.
        plan: of the session.
        room: largest maximum sensitivity on the identified model; the plan's if absent. If the gains in use have a
            larger one, that is used instead, up to `BRISK`.

    Raises:
        OptidError: nothing stabilises the identified model.
    """
    rng = np.random.default_rng(plan.seed)
    present = margins(case.plant, case.gains.vector).maximum_sensitivity
    room = max(plan.sensitivity if room is None else room, min(present, BRISK))
    bench, hunting = physical(case, read_rig(plan.rig), rng)
    task = case.task(Required(maximum_sensitivity=room), bench, hunting)
    return review(case, plainest(task, optimise(task, Options(grid=0), rng).gains), bench, room)


def plainest(task: Task, gains: Gains) -> Gains:
    """Without integral action where that costs no more: a slow integral keeps for minutes what a change left in it."""
    without = replace(gains, ki=0.0)
    costs = task.fitness(np.array([gains.vector, without.vector]))
    return without if costs[1] <= INDIFFERENT * costs[0] else gains


def physical(case: Case, rig: Rig, rng: np.random.Generator) -> tuple[PhysicalBench, float]:
    """The rig's model on many steps, and beyond how much movement at rest it hunts, m."""
    noise, variants = sensor_noise(rig, case.output) or case.plant.noise, parameter_sets(rig, rng)
    samples, T = case.episode.reference.size, case.pid.sample_time
    sizes = sizes_for((case.step,))
    steps = StepPlan(sizes, samples, T, noise, RUNS, len(variants), stronger=STRONGER, quiet=False)
    bench = PhysicalBench(rig, steps.episodes(), case.output, 0.0, variants, BENCH_TOLERANCE)
    return bench, hunting_limit(case.step, noise)
