"""Old and new gains beside each other before anything is applied: on the identified model and on the physical one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from optid.armax.model import Armax
from optid.live.settings import Settings, live_settings, wiring_of
from optid.live.twin import Twin
from optid.pid.controller import Controller, Gains
from optid.pid.controller import Settings as PidSettings
from optid.rigs.rigfile import Rig
from optid.tune.demand import Episode, step
from optid.tune.loop import Course
from optid.tune.margins import Required
from optid.tune.plant import plant_of
from optid.tune.score import Response, response
from optid.tune.task import Task

STEP_SHARE = 0.25  # of the stroke limits' span: the step that is tuned for and reviewed
SECONDS = 1.5  # of the response
ARRIVED = 0.05  # of the step: an error at its end that counts as having arrived
AWAY = 1e3  # steps: a response that far off has run away


@dataclass(frozen=True)
class Case:
    """What a tuning works on.

    Attributes:
        model: identified so far; position (m) from command (V).
        gains: that are in use.
        pid: everything else of the controller.
        step: m.
    """

    model: Armax
    gains: Gains
    pid: PidSettings
    step: float

    def task(self, required: Required | None = None) -> Task:
        """As `optid.tune` wants it, with margins to keep."""
        return Task((plant_of(self.model),), (self.episode,), self.pid, required=required or Required())

    @property
    def episode(self) -> Episode:
        """The step."""
        return step(self.step, round(SECONDS / self.pid.sample_time), self.pid.sample_time)


@dataclass(frozen=True, eq=False)
class Review:
    """Gains beside each other: responses by model ("identified", "physical") to the old and to the new ones."""

    old: Gains
    new: Gains
    step: float
    sample_time: float
    responses: dict[str, tuple[Response, Response]]

    @property
    def better(self) -> bool:
        """The identified model expects less ITAE, and the physical one also arrives with the new gains.

        The identified model has learnt from the rig; the physical one may lack what makes the rig hard, so it
        has a veto, but no vote.
        """
        old, new = self.responses["identified"]
        last = abs(self.responses["physical"][1].output[-1] - self.step)
        return bool(new.measures["itae"] < old.measures["itae"] and last < ARRIVED * abs(self.step))


def case_of(model: Armax, gains: Gains, settings: Settings) -> Case:
    """The case of a session: a step of a quarter of the way between the stroke limits."""
    limits = settings.limits
    pid = PidSettings(settings.span, low=limits.low, high=limits.high, rate=limits.rate)
    low, high = limits.stroke
    size = STEP_SHARE * (high - low) if np.isfinite(high - low) else 1.0
    return Case(replace(model, covariance=None), gains, pid, size)


class Bench:
    """The physical model in a loop, from rest in the middle of its stroke.

    Args:
        rig: whose model and parameters.
        rate: Hz; ``None`` for the rig file's.
    """

    def __init__(self, rig: Rig, rate: float | None) -> None:
        wiring = wiring_of(rig)
        self._model, self._parameters = rig.model, rig.model.vector(rig.parameters)
        self._output = [port.role for port in rig.model.outputs].index(wiring.measured[0].role)
        self._per_unit, self._span = wiring.command.per_unit, live_settings(rig, rate).span

    def run(self, gains: Gains, pid: PidSettings, episode: Episode) -> Response:
        """The answer to an episode, without noise; NaN from where it has run away."""
        twin, controller = Twin(self._model, self._parameters), Controller(gains, pid)
        start = float(twin.outputs()[self._output])
        controller.reset(0.0, 0.0)
        n, bound = len(episode.reference), AWAY * episode.size
        output, command = np.full(n, np.nan), np.full(n, np.nan)
        y = 0.0
        for k in range(n):
            output[k], command[k] = y, controller.step(float(episode.reference[k]), y)
            sane = twin.advance(float(command[k]) / self._per_unit, self._span)
            y = float(twin.outputs()[self._output]) - start
            if not (sane and abs(y) < bound):
                break
        return response(episode, output, command, self._span)


def review(case: Case, new: Gains, bench: Bench) -> Review:
    """Simulate a step with old and new gains on both models."""
    episode, course = case.episode, case.task().course
    responses = {
        "identified": (
            _identified(case.gains, course, episode, case),
            _identified(new, course, episode, case),
        ),
        "physical": (bench.run(case.gains, case.pid, episode), bench.run(new, case.pid, episode)),
    }
    return Review(case.gains, new, case.step, case.pid.sample_time, responses)


def _identified(gains: Gains, course: Course, episode: Episode, case: Case) -> Response:
    return response(episode, *course.trace(gains.vector), case.pid.sample_time)
