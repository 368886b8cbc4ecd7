"""The problem of a diagnosis: training recordings, their noise, and everything injected. It has no hold-out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import cached_property, lru_cache

import numpy as np

from optid.core.budget import UNLIMITED, Budget
from optid.core.decimation import brought_down, decimated
from optid.core.model import Array, Model
from optid.core.recording import Recording
from optid.diagnosis.criteria import Criteria, SearchOptions
from optid.effects.effect import Effect
from optid.estimation.fisher_scoring import likelihood_problem
from optid.estimation.likelihood import WHOLE
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.problem import TOLERANCE, build_problem, window_seconds
from optid.quality.noise import colour, grid, noise_sd, thinned_noise
from optid.rigs.rigfile import Rig, with_effects


class Stage(Enum):
    """The stages of a diagnosis, in their order."""

    BASE_FIT = auto()
    SELECTION = auto()
    BACKWARD = auto()
    ALTERNATIVES = auto()
    LOCALISATION = auto()
    SURROGATE = auto()
    REFINEMENT = auto()
    TEST = auto()
    VERDICT = auto()

    @property
    def share(self) -> float:
        """Share of the stages that are done when this one begins."""
        return (self.value - 1) / len(Stage)


Report = Callable[[Stage, str], None]


@dataclass(frozen=True, eq=False)
class DiagnosisProblem:
    """A rig, training recordings, and the settings of the search.

    Attributes:
        rig: as stated.
        train: recordings to fit.
        noise: role -> sd of the measurement, SI.
        own: the user's effects, in addition to the catalogue.
        validation: indices of the recordings whose windows alone judge the selection; blocks of all if empty.
        criteria, options: see there.
        open_variance: variance of a correct model's window errors, apart from the noise, (samples, outputs).
        tolerance: local error of the integration in filters, as a share of each state's usual size.
        budget: of the search.
        report: called with the stage and a few words.
    """

    rig: Rig
    train: tuple[Recording, ...]
    noise: dict[str, float]
    own: tuple[Effect, ...] = ()
    validation: tuple[int, ...] = ()
    criteria: Criteria = field(default_factory=Criteria)
    options: SearchOptions = field(default_factory=SearchOptions)
    open_variance: Array | None = None
    tolerance: float = TOLERANCE
    budget: Budget = UNLIMITED
    report: Report = lambda stage, words: None
    _questions: dict[Rig, LikelihoodProblem] = field(default_factory=dict)

    @cached_property
    def window(self) -> float:
        """Length of a window, s."""
        return max(window_seconds(recording.interval, recording.duration) for recording in self.train)

    @property
    def plain(self) -> Model:
        """The original model, whose states alone have process noise."""
        return self.rig.model

    def at_search_accuracy(self) -> DiagnosisProblem:
        """The same as the search goes through it: decimated to its rate, and integrated less accurately."""
        rig, train = prepare(self.rig, self.train, self.options.rate)
        loose = replace(self, tolerance=self.options.tolerance, open_variance=None, _questions={})
        if all(one is before for one, before in zip(train, self.train, strict=True)):
            return loose
        return replace(loose, rig=rig, train=train, noise=measurement_noise(rig, train))

    def likelihood_problem(self, rig: Rig) -> LikelihoodProblem:
        """The likelihood problem of a rig with these recordings."""
        if rig not in self._questions:
            data = replace(build_problem(rig.model, self.train, WHOLE), tolerance=self.tolerance)
            self._questions[rig] = likelihood_problem(rig, data, self.plain)
        return replace(self._questions[rig], open_variance=self.open_variance, budget=self.budget)


def prepare(
    rig: Rig, recordings: Sequence[Recording], rate: float | None = None
) -> tuple[Rig, tuple[Recording, ...]]:
    """A rig and recordings decimated to this rate, or to what the axis's fastest pole requires.

    A stated noise is that of a sample, not of an average.

    The remaining part of a stated noise, or of rounding, is stored in the rig's channels.
    """
    commands = [port.role for port in rig.model.recorded]
    if rate is None:
        thin = tuple(brought_down(rig.model, rig.parameters, one) for one in recordings)
    else:
        thin = tuple(decimated(one, commands, rate) for one in recordings)
    if any(one is not before for one, before in zip(thin, recordings, strict=True)):
        left = {role: _noise_left(role, c.sd, recordings, thin) for role, c in rig.channels.items()}
        rig = replace(rig, channels={role: replace(c, sd=left[role]) for role, c in rig.channels.items()})
    return rig, thin


def _noise_left(
    role: str, stated: float | None, before: Sequence[Recording], after: Sequence[Recording]
) -> float | None:
    """Sd of a decimated channel, if it was stated or the channel is rounded; otherwise it is estimated."""
    pairs = [(a[role].values, b[role].values) for a, b in zip(before, after, strict=True) if role in a]
    if not pairs or (stated is None and not all(grid(values) > 0.0 for values, _ in pairs)):
        return None
    left = [thinned_noise(stated or noise_sd(values), values, slow) for values, slow in pairs]
    return float(np.sqrt(np.mean(np.square(left)))) or None


def measurement_noise(rig: Rig, recordings: Sequence[Recording]) -> dict[str, float]:
    """Sd of the measurement by role: as stated, else from neighbouring samples.

    Coloured noise is hidden by motion; recordings with phases of rest show its colour, also for the others.
    """
    found = {}
    for port in rig.model.outputs:
        stated = rig.channels[port.role].sd if port.role in rig.channels else None
        values = [r[port.role].values for r in recordings if port.role in r]
        if not values:
            continue
        seen = [(noise_sd(v), colour(v) > 0.0) for v in (v[np.isfinite(v)] for v in values)]
        coloured = [sd for sd, told in seen if told] or [sd for sd, _ in seen]
        found[port.role] = float(stated or np.sqrt(np.mean(np.square(coloured))))
    return found


@lru_cache(maxsize=256)
def with_effect(rig: Rig, effect: Effect) -> Rig:
    """A rig with one more effect, at its null; cached, so that its model is compiled once."""
    return with_effects(rig, (effect,), {})
