"""Is an input held from sample to sample (zero-order hold, a command), or a straight line (first-order, a sensor)?

A first-order signal treated as held is half a sample late. No physics can compensate that: the fit shows a spurious
delay, or damping several times too large. No physical effect precedes its cause, so smaller errors of windows with
linear interpolation are conclusive.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from optid.core.recording import Recording, frozen, midpoints
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem
from optid.diagnosis.validation import cross_validate, p_value
from optid.errors import SolveError
from optid.estimation.multistep import fit_multistep

STEADY = 0.5  # share of unchanged steps from which an input counts as held


def inputs_that_go_on(base: FittedModel, search: DiagnosisProblem) -> tuple[str, ...]:
    """The inputs that are better interpolated linearly between samples: none, or all candidates.

    Args:
        base: the fitted model, with all inputs held.
        search: the problem that it was fitted to.
    """
    roles = tuple(role for role in _open(search) if _moves_on(role, search.train))
    if not roles:
        return ()
    other, o = straightened(search, roles), search.options
    q = other.likelihood_problem(other.rig)
    with contextlib.suppress(SolveError):
        fit = fit_multistep(q, base.p, other.window, turns=o.turns, steps=o.steps, level=base.fit.level)
        if not fit.loss < base.fit.loss:
            return ()
        held = cross_validate(base, search)
        straight = cross_validate(FittedModel((), other.rig, fit), other)
        at_noise = straight.error_over_noise <= search.criteria.error_over_noise
        better = straight.windows.sum() < held.windows.sum()
        if better and p_value(held.windows, straight.windows, at_noise) <= search.criteria.level:
            return roles
    return ()


def straightened(problem: DiagnosisProblem, roles: Sequence[str]) -> DiagnosisProblem:
    """The problem with these inputs interpolated linearly."""
    channels = {
        role: replace(channel, linear=True) if role in roles else channel
        for role, channel in problem.rig.channels.items()
    }
    rig = replace(problem.rig, channels=channels)
    return replace(problem, rig=rig, train=straight_inputs(problem.train, roles), _questions={})


def straight_inputs(recordings: Iterable[Recording], roles: Sequence[str]) -> tuple[Recording, ...]:
    """Recordings with these inputs as means from each sample to the next."""
    return tuple(
        replace(
            one,
            channels={
                role: replace(c, values=frozen(midpoints(c.values))) if role in roles else c
                for role, c in one.channels.items()
            },
        )
        for one in recordings
    )


def _open(problem: DiagnosisProblem) -> list[str]:
    """Inputs for which the rig file does not state it."""
    channels = problem.rig.channels
    ports = [port.role for port in problem.rig.model.recorded]
    return [role for role in ports if role in channels and channels[role].linear is None]


def _moves_on(role: str, recordings: Sequence[Recording]) -> bool:
    """Whether it changes at most samples: a signal that rests between jumps is held."""
    steps = np.concatenate([np.diff(one[role].values) for one in recordings if role in one])
    steps = steps[np.isfinite(steps)]
    return len(steps) > 0 and float(np.mean(steps == 0.0)) < STEADY
