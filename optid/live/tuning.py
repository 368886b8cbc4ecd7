"""Tuning of the running loop: gains are found and reviewed in a separate process."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from optid.live.background import Background
from optid.live.plan import Plan
from optid.live.review import Case, Review, review
from optid.rigs.rigfile import read_rig
from optid.tuning.bench import PhysicalBench
from optid.tuning.margins import Required, margins
from optid.tuning.optimise import Options
from optid.tuning.plant import plant_of
from optid.tuning.tuning import tune

BRISK = 2.0  # maximum sensitivity up to which the gains in use may define the bound for new ones


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
    """Gains that are good on the identified and on the physical model, with margins for unmodelled physics.

    Args:
        case: the loop.
        plan: of the session.
        room: largest maximum sensitivity on the identified model; the plan's if absent. If the gains in use have a
            larger one, that is used instead, up to `BRISK`.

    Raises:
        OptidError: nothing stabilises the identified model.
    """
    present = margins(plant_of(case.model), case.gains.vector).maximum_sensitivity
    room = max(plan.sensitivity if room is None else room, min(present, BRISK))
    bench = PhysicalBench(read_rig(plan.rig), (case.episode,), case.output)
    task = case.task(Required(maximum_sensitivity=room), bench)
    gains = tune(task, np.random.default_rng(plan.seed), Options(grid=0)).gains
    return review(case, gains, bench, room)
