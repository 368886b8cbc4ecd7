"""Better gains for the loop that is running, found and reviewed in a process of its own."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor

import numpy as np

from optid.live.plan import Plan
from optid.live.review import Case, Review, review
from optid.rigs.rigfile import read_rig
from optid.tuning.bench import PhysicalBench
from optid.tuning.margins import Required, margins
from optid.tuning.optimise import Options
from optid.tuning.plant import plant_of
from optid.tuning.tuning import tune

BRISK = 2.0  # maximum sensitivity up to which gains in use are a measure of how brisk new ones may be
NICENESS = 10  # a loop that runs by the clock goes first


class Tuning:
    """One tuning at a time, in the background.

    Args:
        plan: of the session.
        note: told what happens, in words.

    Attributes:
        review: of the last gains found.
    """

    def __init__(self, plan: Plan, note: Callable[[str], None]) -> None:
        self._plan, self._note = plan, note
        self._pool: ProcessPoolExecutor | None = None
        self._future: Future[Review] | None = None
        self.review: Review | None = None

    @property
    def busy(self) -> bool:
        """A tuning is under way."""
        return self._future is not None

    def begin(self, case: Case) -> None:
        """Start; `poll` until `busy` is over."""
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(1, context, None if self._plan.fast else _step_back)
        self._future = self._pool.submit(tuned, case, self._plan)

    def poll(self) -> None:
        """See whether it is done."""
        if self._future is None or not self._future.done():
            return
        future, self._future = self._future, None
        try:
            self.review = future.result()
        except Exception as error:  # whatever the tuning's process met, the loop goes on
            self._note(f"not tuned: {error}")
            return
        self._note(f"tuned: {self.review.words}")

    def close(self) -> None:
        """Drop what is under way."""
        if self._pool is not None:
            for process in multiprocessing.active_children():
                if process.pid in (self._pool._processes or {}):
                    process.terminate()
            self._pool.shutdown(wait=True, cancel_futures=True)


def _step_back() -> None:
    if hasattr(os, "nice"):
        os.nice(NICENESS)


def tuned(case: Case, plan: Plan, room: float | None = None) -> Review:
    """Gains that are good on the identified and on the physical model, with room for what neither knows.

    Args:
        case: the loop.
        plan: of the session.
        room: largest maximum sensitivity on the identified model; the plan's where absent. Gains in use that are
            brisker than that are no worse a measure, up to `BRISK`.

    Raises:
        OptidError: nothing stabilises the identified model.
    """
    present = margins(plant_of(case.model), case.gains.vector).maximum_sensitivity
    room = max(plan.sensitivity if room is None else room, min(present, BRISK))
    bench = PhysicalBench(read_rig(plan.rig), (case.episode,), case.output)
    task = case.task(Required(maximum_sensitivity=room), bench)
    gains = tune(task, np.random.default_rng(plan.seed), Options(grid=0)).gains
    return review(case, gains, bench, room)
