"""The likeliest states where a record begins: least squares on all its first readings at once.

A filter keeps one normal distribution, which what friction holds at rest bends out of shape before a first motion tells
of the pressures; what it then believes is off, and it is sure of it. Least squares over everything read since the
beginning has no such memory (moving horizon estimation: Rao, Rawlings and Mayne, IEEE Trans. Autom. Control 48, 2003).
Where states carry process noise, the innovations of a filter that begins at one point are what is squared, so that a
model which errs is not held to its simulation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array, Model
from optid.estimation.likelihood import (
    QUIET,
    Filtered,
    Noise,
    Start,
    deviance,
    run_filter,
    run_fixed_gain_filter,
)
from optid.estimation.problem import Integers, Problem

STEPS, TRIALS = 25, 5  # of Levenberg and Marquardt, and dampings of each
NUDGE = 1e-4  # of the sd beforehand, for differences
ENOUGH = 0.1  # in -2 log likelihood: a step that gains less is the last
STEEP = 4.0  # a normal distribution's cost rises by 1 in one sd: where it rises by more than this, it is none


@dataclass(frozen=True, eq=False)
class StatePrior:
    """What is known of the states where a record begins before anything is read.

    Attributes:
        mean, sd: (states,), SI.
        moved: states that least squares move; the others are left to the filter.
    """

    mean: Array
    sd: Array
    moved: Integers

    def z(self, states: Array) -> Array:
        """Where those that move are, in sd off the mean."""
        return np.asarray(((states - self.mean) / self.sd)[self.moved])


@dataclass(frozen=True, eq=False)
class InitialSegment:
    """The beginning of one segment, and what is asked of it.

    Attributes:
        model: the plant; `p` its parameters, `noise` that of measurement and states.
        problem: one segment, up to where the look ends.
        known: of the states beforehand.
    """

    model: Model
    p: Array
    noise: Noise
    problem: Problem
    known: StatePrior

    @property
    def last(self) -> int:
        """Row where the look ends."""
        return int(self.problem.begins[0] + self.problem.counts[0])

    def filtered(self, means: Array, sd: Array) -> tuple[Array, Filtered]:
        """-2 log likelihood (sets,) and what filters see that begin at `means` (sets, states)."""
        sets = len(means)
        start = Start.apart(means[:, None], np.broadcast_to(sd, (sets, 1, len(sd))))
        Q, R = self.noise.spectrum(len(sd)), self.noise.measurement
        given = (np.tile(a, (sets, 1)) for a in (self.p, Q, R))
        f = run_filter(self.model, self.problem, *given, keep=True, covariances=True, start=start)
        score = deviance(f.innovations, f.variances).sum(axis=-1)
        return np.where(np.isfinite(score), score, np.inf), f


@dataclass(frozen=True, eq=False)
class Likely:
    """A start that no step makes likelier.

    Attributes:
        z: in sd beforehand, off the mean beforehand, of the states that moved, (moved,).
        cost: what speaks against it, in -2 log likelihood.
        root: of the covariance of z that readings and prior leave, (moved, moved).
        end: states where the look ends, (states,).
    """

    z: Array
    cost: float
    root: Array
    end: Array

    @property
    def evidence(self) -> float:
        """-2 log of the probability of the readings near it, by Laplace's approximation, up to a constant."""
        return self.cost - 2.0 * float(np.linalg.slogdet(self.root)[1])


def likely_start(opening: InitialSegment, z: Array) -> Likely:
    """From a start to the likeliest one near it, both in sd off the mean beforehand."""
    place = _Place(opening)
    cost, f = place.cost(z[None])
    damping, here, end = 1e-3, float(cost[0]), place.ends(f)[0]
    slopes, r = place.slopes(z, f)
    for _ in range(STEPS if np.isfinite(here) else 0):
        information, gradient = slopes.T @ slopes + np.eye(len(z)), slopes.T @ r + z
        gain = 0.0
        for _ in range(TRIALS):
            step = np.linalg.solve(information + damping * np.diag(np.diag(information)), gradient)
            cost, f = place.cost((z - step)[None])
            if cost[0] < here:
                gain, here, z = here - float(cost[0]), float(cost[0]), z - step
                slopes, r = place.slopes(z, f)
                damping, end = damping / 10.0, place.ends(f)[0]
                break
            damping = max(10.0 * damping, 1e-2)
        if gain < ENOUGH:
            break
    values, vectors = np.linalg.eigh(slopes.T @ slopes + np.eye(len(z)))
    return Likely(z, here, vectors / np.sqrt(values), end)


def nearest(opening: InitialSegment, Z: Array, count: int) -> Array:
    """Of starts (sets, moved) those that come nearest to the readings, as held gains show it, the nearest first."""
    if not Z.size:  # nothing moves
        return Z
    place = _Place(opening)
    E = place.scaled(Z, place.cost(Z[:1])[1])
    cost = np.nansum(E**2, axis=(1, 2)) + (Z**2).sum(axis=1)
    return Z[np.argsort(np.where(np.isfinite(cost), cost, np.inf), kind="stable")[:count]]


def carried(opening: InitialSegment, found: Sequence[Likely]) -> tuple[Array, Array, bool]:
    """Mean and covariance of the states where a look ends, and whether they are those of a normal distribution.

    They are where the cost rises in no direction far more than the covariance of the best start found says. It does
    while an axis rests: pressures that would have moved it are out of the question, and all others are alike. Where
    readings tell little the cost is a long valley with many small hollows, of which each seems narrow: so the others
    that were found count, too, by how likely they are, as the normal distributions of a sum do.

    Args:
        opening: up to where the look ends.
        found: starts, the best first.
    """
    place, best = _Place(opening), found[0]
    ways = np.concatenate([best.root.T, -best.root.T])
    cost, f = place.cost(np.concatenate([best.z[None], best.z + ways]))
    with np.errstate(invalid="ignore"):  # where all leave the numbers nothing rises, and nothing counts
        rise = cost[1:] - cost[0]
        weights = np.exp(0.5 * (best.evidence - np.array([one.evidence for one in found])))
    weights /= weights.sum()
    ends, half = place.ends(f), len(ways) // 2
    roots = 0.5 * (ends[1 : 1 + half] - ends[1 + half :])
    there = np.array([one.end for one in found])[weights > 0.0]
    weights = weights[weights > 0.0]
    mean = weights @ there
    apart = (there - mean) * np.sqrt(weights)[:, None]
    covariance = roots.T @ roots + apart.T @ apart + f.covariances[0, opening.last]
    return mean, covariance, bool((rise < STEEP).all())


class _Place:
    """Filters of an opening that begin at points of the states that move."""

    def __init__(self, opening: InitialSegment) -> None:
        self._opening = opening
        self._sd, moved = opening.known.sd.copy(), opening.known.moved
        self._sd[moved] = QUIET * opening.model.scales[moved]

    def means(self, Z: Array) -> Array:
        """Where filters begin, (sets, states)."""
        known = self._opening.known
        means = np.tile(known.mean, (len(Z), 1))
        means[:, known.moved] += Z * known.sd[known.moved]
        return means

    def cost(self, Z: Array) -> tuple[Array, Filtered]:
        """What speaks against points (sets, moved), and the filters that begin there."""
        score, f = self._opening.filtered(self.means(Z), self._sd)
        return score + (Z**2).sum(axis=1), f

    def ends(self, f: Filtered) -> Array:
        """States where the look ends, (sets, states)."""
        return f.states[:, self._opening.last]

    def slopes(self, z: Array, f: Filtered) -> tuple[Array, Array]:
        """Jacobians of the scaled innovations by z, (readings, moved), and those innovations, with held gains."""
        scaled = self.scaled(np.concatenate([z[None], z + NUDGE * np.eye(len(z))]), f)
        r = scaled[:, np.isfinite(scaled).all(axis=0)]
        return np.asarray((r[1:] - r[0]).T / NUDGE), np.asarray(r[0])

    def scaled(self, Z: Array, f: Filtered) -> Array:
        """Innovations (sets, samples, outputs), in sd, of models begun at points with the gains of the first filter."""
        o, held = self._opening, replace(f, gains=f.gains[:1])
        P = np.tile(o.p, (len(Z), 1))
        E = run_fixed_gain_filter(o.model, o.problem, P, held, range(len(o.known.mean)), start=self.means(Z))
        return np.asarray(E / np.sqrt(f.variances[:1]))
