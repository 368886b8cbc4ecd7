"""Old and new gains beside each other before anything is applied: on the identified model and on the physical one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from optid.armax.model import Armax
from optid.live.gains import controller_settings
from optid.live.loop import Choices
from optid.live.settings import Settings, Wiring
from optid.pid.controller import Gains
from optid.pid.controller import Settings as PidSettings
from optid.tuning.bench import PhysicalBench
from optid.tuning.demand import Episode, step
from optid.tuning.margins import Required
from optid.tuning.plant import plant_of
from optid.tuning.score import Response, response
from optid.tuning.task import Task

STEP_SHARE = 0.25  # of the stroke limits' span: the step that is tuned for and reviewed
SECONDS = 1.5  # of the response
ARRIVED = 0.05  # of the step: an error at its end that counts as having arrived


@dataclass(frozen=True)
class Case:
    """What a tuning works on.

    Attributes:
        model: identified so far; position (m) from command (V).
        gains: that are in use.
        pid: everything else of the controller.
        step: m.
        output: role of the position.
    """

    model: Armax
    gains: Gains
    pid: PidSettings
    step: float
    output: str

    def task(self, required: Required | None = None, bench: PhysicalBench | None = None) -> Task:
        """As `optid.tuning` wants it, with margins to keep, and a physical model to be good on as well."""
        plants, required = (plant_of(self.model),), required or Required()
        return Task(plants, (self.episode,), self.pid, required=required, bench=bench)

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


def case_of(model: Armax, session: tuple[Settings, Wiring], choices: Choices, gains: Gains) -> Case:
    """The case of a session: a step of a quarter of the way between the stroke limits.

    Args:
        model: identified so far.
        session: its settings and wiring.
        choices: of which the controller's own settings count.
        gains: in use.
    """
    settings, wiring = session
    low, high = settings.limits.stroke
    size = STEP_SHARE * (high - low) if np.isfinite(high - low) else 1.0
    pid = controller_settings(settings, choices.pid)
    return Case(replace(model, covariance=None), gains, pid, size, wiring.measured[0].role)


def review(case: Case, new: Gains, bench: PhysicalBench) -> Review:
    """Simulate a step with old and new gains on the identified model and on the physical one of the bench."""
    episode, course, pid = case.episode, case.task().course, case.pid

    def identified(gains: Gains) -> Response:
        return response(episode, *course.trace(gains.vector), pid.sample_time)

    responses = {
        "identified": (identified(case.gains), identified(new)),
        "physical": (bench(case.gains, pid)[0], bench(new, pid)[0]),
    }
    return Review(case.gains, new, case.step, pid.sample_time, responses)
