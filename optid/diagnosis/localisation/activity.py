"""When an effect acts: what it changes within the next samples, relative to the most that it changes in a recording."""

from __future__ import annotations

import numpy as np

from optid.core.model import Array
from optid.core.simulation import simulate
from optid.diagnosis.refinement import RefinedModel
from optid.effects.effect import Effect
from optid.estimation.likelihood import noisy_states
from optid.estimation.problem import Integers

# Samples that are simulated with and without the effect: friction's microseconds have passed by then.
AHEAD = 5
MOST = 0.99  # quantile that counts as the largest: neither rest nor a single jolt determines it
FAINT = 1e-4  # of the largest in all recordings: what is smaller in a whole recording does not act there


def effect_activity(best: RefinedModel, effect: Effect) -> Array:
    """What an effect changes at each sample, relative to the most that it changes in the same recording, (samples,).

    From every few samples the model is simulated from the filter's states, once as it is and once with the effect at
    its null. The difference of the states at the end counts, or for an effect of a sensor that of the readings.

    Args:
        best: the model with the effect, and the filter's states.
        effect: one of its effects.
    """
    q, model, X = best.fit.likelihood_problem, best.rig.model, best.fit.filtered.states[0]
    problem = q.problem
    starts = np.concatenate(
        [
            np.arange(begin, max(begin + count - AHEAD, begin) + 1, AHEAD)
            for begin, count in zip(problem.begins, problem.counts, strict=True)
        ]
    )
    with_it, without = (
        simulate(model, p, X[starts], problem.dt, problem.inputs, first=starts, intervals=AHEAD)
        for p in (best.fit.p, best.at_null(effect))
    )
    own = f"{effect.name}."
    plant = [i for group in noisy_states(model) for i in group if not model.states[i].name.startswith(own)]
    moved = np.nan_to_num(np.abs(with_it.states - without.states)[:, AHEAD, plant] / model.scales[plant])
    read = np.nan_to_num(np.abs(with_it.outputs - without.outputs)[:, AHEAD] / np.sqrt(q.measurement))
    of_sensor = effect.site == "sensor" or not moved.any()
    size = np.linalg.norm(read if of_sensor else moved, axis=1)
    owner = np.repeat(problem.recording, problem.counts + 1)
    return share_of_largest(_held(size, starts, len(X)), owner)


def _held(size: Array, starts: Integers, samples: int) -> Array:
    """Each value at its sample and at those up to the next one."""
    return np.asarray(size[np.maximum(np.searchsorted(starts, np.arange(samples), side="right") - 1, 0)])


def share_of_largest(size: Array, owner: Integers) -> Array:
    """Sizes relative to the largest of their recording, (samples,); 0 where a recording has next to nothing."""
    size = np.where(np.isfinite(size), size, 0.0)
    shares, least = np.zeros(len(size)), FAINT * float(np.max(size, initial=0.0))
    for number in np.unique(owner):
        mine = owner == number
        acts = size[mine & (size > least)]
        if len(acts):
            shares[mine] = size[mine] / np.quantile(acts, MOST)
    return shares
