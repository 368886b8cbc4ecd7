"""The problem of a diagnosis: training recordings, their noise, and everything injected. It has no hold-out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, auto
from functools import cached_property, lru_cache

import numpy as np

from optid.core.budget import UNLIMITED, Budget
from optid.core.channel import ChannelMap
from optid.core.decimation import brought_down, decimated
from optid.core.model import Array, Model
from optid.core.recording import Recording
from optid.diagnosis.criteria import Criteria, SearchOptions
from optid.effects.effect import Effect
from optid.estimation.fisher_scoring import likelihood_problem
from optid.estimation.likelihood import WHOLE
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.problem import TOLERANCE, build_problem, window_seconds
from optid.quality.noise import (
    colour,
    colour_of_factor,
    decimated_noise,
    grid,
    information_factor,
    noise_sd,
    thinned_noise,
)
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
        rig = replace(
            rig, channels={role: _decimated(c, recordings, thin) for role, c in rig.channels.items()}
        )
    told = {
        port.role: _coloured(rig.channels[port.role], thin)
        for port in rig.model.outputs
        if port.role in rig.channels
    }
    return replace(rig, channels={**rig.channels, **told}), thin


def _decimated(c: ChannelMap, before: Sequence[Recording], after: Sequence[Recording]) -> ChannelMap:
    """A channel with the noise that decimation leaves, if it was stated or estimated, or the channel is rounded."""
    pairs = [(a[c.role].values, b[c.role].values) for a, b in zip(before, after, strict=True) if c.role in a]
    if not pairs or (c.sd is None and not all(grid(values) > 0.0 for values, _ in pairs)):
        return c
    if c.sd is not None and c.colour is not None:
        # What hides slow motion is as before; decimated, it is estimated less well.
        sd, left = decimated_noise(c.sd, c.colour, max(round(len(pairs[0][0]) / len(pairs[0][1])), 1))
        return replace(c, sd=sd, colour=left)
    sds = [thinned_noise(c.sd or noise_sd(values), values, slow) for values, slow in pairs]
    return replace(c, sd=float(np.sqrt(np.mean(np.square(sds)))) or None)


def _coloured(c: ChannelMap, recordings: Sequence[Recording]) -> ChannelMap:
    """A channel with the coloured noise that quiet stretches show where nothing states its noise, and else white noise.

    Motion hides colour: recordings with phases of rest show it, also for the others. It is asked once, at the
    recordings' own rate: after decimation fewer stretches are quiet.
    """
    if c.sd is not None or c.colour is not None:
        return c
    values = [r[c.role].values for r in recordings if c.role in r]
    seen = [(noise_sd(v), colour(v)) for v in (v[np.isfinite(v)] for v in values)]
    if any(grid(v) > sd for v, (sd, _) in zip(values, seen, strict=True)):  # mostly rounding
        return c
    told = [(sd**2, information_factor(found)) for sd, found in seen if found > 0.0]
    if not told:
        return replace(c, colour=0.0)
    square = float(np.mean([variance for variance, _ in told]))
    factor = float(np.mean([variance * factor for variance, factor in told])) / square
    return replace(c, sd=float(np.sqrt(square)), colour=colour_of_factor(factor))


def measurement_noise(rig: Rig, recordings: Sequence[Recording]) -> dict[str, float]:
    """Sd of the measurement by role: as stated, or told by quiet stretches, else from neighbouring samples."""
    found = {}
    for port in rig.model.outputs:
        stated = rig.channels[port.role].sd if port.role in rig.channels else None
        values = [r[port.role].values for r in recordings if port.role in r]
        if not values:
            continue
        seen = [noise_sd(v[np.isfinite(v)]) for v in values]
        found[port.role] = float(stated or np.sqrt(np.mean(np.square(seen))))
    return found


@lru_cache(maxsize=256)
def with_effect(rig: Rig, effect: Effect) -> Rig:
    """A rig with one more effect, at its null; cached, so that its model is compiled once."""
    return with_effects(rig, (effect,), {})
