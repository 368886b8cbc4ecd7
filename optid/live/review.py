"""Old and new gains beside each other before anything is applied: on the identified model and on the physical one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from optid.armax.model import Armax
from optid.live.gains import controller_settings
from optid.live.loop import Choices
from optid.live.settings import Settings, Wiring
from optid.pid.controller import Gains
from optid.pid.controller import Settings as PidSettings
from optid.tuning.bench import PhysicalBench
from optid.tuning.criterion import Criterion
from optid.tuning.demand import Episode, step
from optid.tuning.integrator import Integrator, with_integrator
from optid.tuning.loop import Course
from optid.tuning.margins import Margins, Required, margins
from optid.tuning.plant import Plant, plant_of
from optid.tuning.score import Response, response
from optid.tuning.task import Task

STEP_SHARE = 0.25  # of the stroke limits' span: the step that is tuned for and reviewed
SECONDS = 1.5  # of the response
HUNTS = 0.005  # of the step: less movement at rest is no hunting
SLACK = 1.001  # on a maximum sensitivity that stands at its limit
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

    @cached_property
    def plant(self) -> Plant:
        """The identified model; a pole next to 1 is carried as an integrator, as dry friction makes an axis creep."""
        return with_integrator(plant_of(self.model), self.model, Integrator.YES)[0]

    def task(self, required: Required, bench: PhysicalBench, hunting: float) -> Task:
        """As `optid.tuning` wants it: margins to keep on the identified model, and a physical one that judges."""
        return Task(
            (self.plant,),
            (self.episode,),
            self.pid,
            required=required,
            bench=bench,
            bench_alone=True,
            hunting=hunting,
        )

    @property
    def episode(self) -> Episode:
        """The step."""
        return step(self.step, round(SECONDS / self.pid.sample_time), self.pid.sample_time)


@dataclass(frozen=True, eq=False)
class Review:
    """Gains beside each other.

    Attributes:
        old, new: gains.
        step: m.
        sample_time: s.
        responses: by model ("identified", "physical"), to the old and to the new gains, one step without noise.
        itae: by model, of the old and of the new gains, m s2: of the physical one the mean over many steps with
            noise, each as if it had the size of this one.
        margins: of the identified model with the old and with the new gains.
        sensitivity: largest maximum sensitivity that was asked for.
    """

    old: Gains
    new: Gains
    step: float
    sample_time: float
    responses: dict[str, tuple[Response, Response]]
    itae: dict[str, tuple[float, float]]
    margins: tuple[Margins, Margins]
    sensitivity: float

    @property
    def worse(self) -> tuple[str, ...]:
        """What speaks against the new gains, in words; empty where they are better.

        Either model expects no less ITAE, the physical one does not arrive or hunts more, or the identified one's
        margins are less than asked for and less than before.
        """
        found = []
        for model, (before, after) in self.itae.items():
            if not after < before:
                found.append(f"the {model} model expects more ITAE ({before:.3g} -> {after:.3g} m s2)")
        old, new = self.responses["physical"]
        if not abs(new.output[-1] - self.step) < ARRIVED * abs(self.step):
            found.append("the physical model does not arrive")
        if new.hunting > max(old.hunting, HUNTS * abs(self.step)):
            found.append(f"the physical model hunts ({new.hunting:.3g} m peak to peak at rest)")
        before, after = (one.maximum_sensitivity for one in self.margins)
        if not after <= max(before, self.sensitivity * SLACK):
            found.append(f"less margin (Ms {before:.3g} -> {after:.3g}, asked for {self.sensitivity:.3g})")
        return tuple(found)

    @property
    def better(self) -> bool:
        """Nothing speaks against the new gains."""
        return not self.worse

    @property
    def words(self) -> str:
        """Both models' expectation, margins and hunting, old to new."""
        parts = [
            f"the {name} model expects ITAE {before:.3g} -> {after:.3g} m s2"
            for name, (before, after) in self.itae.items()
        ]
        before, after = self.margins
        old, new = self.responses["physical"]
        parts.append(
            f"Ms {before.maximum_sensitivity:.3g} -> {after.maximum_sensitivity:.3g} "
            f"(at most {self.sensitivity:.3g} asked for)"
        )
        parts.append(f"hunting {old.hunting:.2g} -> {new.hunting:.2g} m")
        return "; ".join(parts)


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


def review(case: Case, new: Gains, bench: PhysicalBench, sensitivity: float) -> Review:
    """Simulate old and new gains on the identified model and on the physical one.

    Args:
        case: with the old gains.
        new: gains.
        bench: the physical model on many steps.
        sensitivity: largest maximum sensitivity that was asked for.
    """
    episode, pid = case.episode, case.pid
    course = Course((case.plant,), (episode,), Criterion(), pid.vector, 1.0)
    clean = PhysicalBench(bench.rig, (episode,), case.output)
    costs = bench.costs(np.array([case.gains.vector, new.vector]), pid, Criterion(), 1.0)

    def identified(gains: Gains) -> Response:
        return response(episode, *course.trace(gains.vector), pid.sample_time)

    linear = (identified(case.gains), identified(new))
    responses = {"identified": linear, "physical": (clean(case.gains, pid)[0], clean(new, pid)[0])}
    itae = {
        "identified": (linear[0].measures["itae"], linear[1].measures["itae"]),
        "physical": (float(costs[0]), float(costs[1])),
    }
    both = (margins(case.plant, case.gains.vector), margins(case.plant, new.vector))
    return Review(case.gains, new, case.step, pid.sample_time, responses, itae, both, sensitivity)
