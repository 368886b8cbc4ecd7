"""Comparison of old and new gains before they are applied, on the identified and on the physical model."""

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
from optid.tuning.integrator import Integrator, with_integrator
from optid.tuning.loop import ClosedLoop
from optid.tuning.margins import Margins, Required, margins
from optid.tuning.plant import Plant, plant_of
from optid.tuning.response_metrics import Response, response
from optid.tuning.scenarios import Episode, step
from optid.tuning.task import Task

STEP_SHARE = 0.25  # of the stroke limits' span: the step for tuning and review
SECONDS = 1.5  # of the response
HUNTS = 0.005  # of the step: less movement at rest is not hunting
SLACK = 1.001  # tolerance for a maximum sensitivity at its limit
ARRIVED = 0.05  # of the step: largest final error that counts as settled


@dataclass(frozen=True)
class Case:
    """The input of a tuning.

    Attributes:
        model: identified so far; position (m) from command (V).
        gains: in use.
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
    """The comparison of old and new gains.

    Attributes:
        old, new: gains.
        step: m.
        sample_time: s.
        responses: by model ("identified", "physical"), to the old and to the new gains, one step without noise.
        itae: by model, of the old and of the new gains, m s2: of the physical one the mean over many steps with
            noise, each as if it had the size of this one.
        margins: of the identified model with the old and with the new gains.
        sensitivity: largest maximum sensitivity that tuned gains may have.
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
        """Objections to the new gains, in words; empty if they are better.

        A model predicts no smaller ITAE, the physical one does not settle or hunts more, or the identified one's
        margins are below the required ones and below the former ones.
        """
        found = []
        for model, (before, after) in self.itae.items():
            if not after < before:
                found.append(f"the {model} model predicts a larger ITAE ({before:.3g} -> {after:.3g} m s2)")
        old, new = self.responses["physical"]
        if not abs(new.output[-1] - self.step) < ARRIVED * abs(self.step):
            found.append("the physical model does not settle")
        if new.hunting > max(old.hunting, HUNTS * abs(self.step)):
            found.append(f"the physical model hunts ({new.hunting:.3g} m peak to peak at rest)")
        before, after = (one.maximum_sensitivity for one in self.margins)
        if not after <= max(before, self.sensitivity * SLACK):
            found.append(f"smaller margins (Ms {before:.3g} -> {after:.3g}, limit {self.sensitivity:.3g})")
        return tuple(found)

    @property
    def better(self) -> bool:
        """Whether there are no objections to the new gains."""
        return not self.worse

    @property
    def words(self) -> str:
        """Both models' predictions, margins and hunting, old to new."""
        parts = [
            f"the {name} model predicts ITAE {before:.3g} -> {after:.3g} m s2"
            for name, (before, after) in self.itae.items()
        ]
        before, after = self.margins
        old, new = self.responses["physical"]
        parts.append(
            f"Ms {before.maximum_sensitivity:.3g} -> {after.maximum_sensitivity:.3g} "
            f"(at most {self.sensitivity:.3g})"
        )
        parts.append(f"hunting {old.hunting:.2g} -> {new.hunting:.2g} m")
        return "; ".join(parts)


def case_of(model: Armax, session: tuple[Settings, Wiring], choices: Choices, gains: Gains) -> Case:
    """The case of a session: a step of a quarter of the range between the stroke limits.

    Args:
        model: identified so far.
        session: its settings and wiring.
        choices: with the controller's own settings.
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
    closed_loop = ClosedLoop((case.plant,), (episode,), Criterion(), pid.vector, 1.0)
    clean = PhysicalBench(bench.rig, (episode,), case.output)
    costs = bench.costs(np.array([case.gains.vector, new.vector]), pid, Criterion(), 1.0)

    def identified(gains: Gains) -> Response:
        return response(episode, *closed_loop.trace(gains.vector), pid.sample_time)

    linear = (identified(case.gains), identified(new))
    responses = {"identified": linear, "physical": (clean(case.gains, pid)[0], clean(new, pid)[0])}
    itae = {
        "identified": (linear[0].measures["itae"], linear[1].measures["itae"]),
        "physical": (float(costs[0]), float(costs[1])),
    }
    both = (margins(case.plant, case.gains.vector), margins(case.plant, new.vector))
    return Review(case.gains, new, case.step, pid.sample_time, responses, itae, both, sensitivity)
