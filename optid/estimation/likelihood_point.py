"""A point of a likelihood search: the problem, the filter run there, and the derivatives of its innovations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.core.budget import UNLIMITED, Budget
from optid.core.model import Array, Model
from optid.estimation.likelihood import (
    Filtered,
    Noise,
    broyden_formula,
    deviance,
    huber_weight,
    run_filter,
    run_fixed_gain_filter,
)
from optid.estimation.problem import Booleans, Integers, Problem
from optid.rigs.rigfile import Rig

# Finite differences span REACH conditional standard deviations: dry friction makes the likelihood rough on the scale
# of a few (one break-away more or less), and a smaller step would show only this roughness.
REACH, NUDGES = 5.0, (1e-3, 2e-3, 3e-2)  # smallest, first and largest step, of a parameter's typical size
NUDGE_LEVEL = 0.1  # of the log of process noise
LEVELS = (math.log(1e-5), math.log(10.0))  # bounds of that log


@dataclass(frozen=True, eq=False)
class LikelihoodProblem:
    """The estimation problem of the data.

    Attributes:
        rig: model with parameters to start from.
        problem: the recordings, one window per segment.
        free: indices of the free parameters; low, high, typical, prior, prior_sd as in a batch fit.
        groups: states that share a level of process noise.
        measurement: variance of each output.
        open_variance: variance of windows' errors in addition to the measurement's if nothing is missing, (samples,
            outputs).
        budget: when it is over, searches end with their best result.
    """

    rig: Rig
    problem: Problem
    free: tuple[int, ...]
    low: Array
    high: Array
    typical: Array
    prior: Array
    prior_sd: Array
    groups: tuple[tuple[int, ...], ...]
    measurement: Array
    open_variance: Array | None = None
    budget: Budget = UNLIMITED

    @property
    def model(self) -> Model:
        """The rig's model."""
        return self.rig.model

    def at(self, values: Mapping[str, float]) -> Array:
        """All parameters: the rig's, with these values by name, within the model's bounds, (parameters,)."""
        model = self.model
        p = model.vector(self.rig.parameters)
        for name, value in values.items():
            low, high = model.parameters[model.index(name)].bounds
            p[model.index(name)] = min(max(value, low), high)
        return p


@dataclass(frozen=True, eq=False)
class Jacobians:
    """Derivatives by free parameters in typical sizes and then by log levels, (samples, outputs, free + levels).

    Attributes:
        innovations: of the innovations.
        variances: of the log of their variances.
    """

    innovations: Array
    variances: Array


@dataclass(frozen=True, eq=False)
class LikelihoodFit:
    """The maximum likelihood estimate of parameters and process noise.

    Attributes:
        p: the whole parameter vector.
        noise: with the estimated levels.
        filtered: innovations, variances, states and gains there, sets = 1.
        score: -2 log likelihood with the priors, up to a constant of the data.
        slopes: of innovations and their variances.
        gradient: of half the score, by free parameters in typical sizes and then by levels.
        information: Fisher's, of the same.
        settled: the iteration converged, with derivatives computed at its end.
    """

    likelihood_problem: LikelihoodProblem
    p: Array
    noise: Noise
    filtered: Filtered
    score: float
    slopes: Jacobians
    gradient: Array
    information: Array
    settled: bool


@dataclass(frozen=True, eq=False)
class Scores:
    """Derivatives of half the score, of each sample and output, by parameters in typical sizes and then by log levels.

    Attributes:
        values: (known, free + levels).
        slopes, variances: of the scaled innovations, each times the root of its weight, and of the log of their
            variances; the same shape.
        rows: sample of each, (known,).
    """

    values: Array
    slopes: Array
    variances: Array
    rows: Integers

    @classmethod
    def of(cls, filtered: Filtered, slopes: Jacobians) -> Scores:
        """Of the first parameter set of a filter run."""
        e, v = filtered.innovations[0], filtered.variances[0]
        known = np.isfinite(e) & np.isfinite(slopes.innovations).all(axis=-1)
        sd, D = np.sqrt(v[known]), slopes.variances[known]
        z, J = e[known] / sd, slopes.innovations[known] / sd[:, None]
        weight = huber_weight(z)
        values = J * (weight * z)[:, None] + 0.5 * D * (1.0 - weight * z**2)[:, None]
        return cls(values, J * np.sqrt(weight)[:, None], D, np.nonzero(known)[0])

    def information(self, part: Booleans | slice = slice(None)) -> Array:
        """Fisher's, of a part of the samples, (free + levels, free + levels)."""
        J, D = self.slopes[part], self.variances[part]
        return np.asarray(J.T @ J + 0.5 * D.T @ D)


class LikelihoodPoint:
    """A point of the search with its filter run; derivatives are computed there or updated.

    Args:
        q: the likelihood problem.
        p: the whole parameter vector.
        noise: of measurement and states.

    Attributes:
        filtered: innovations, variances, states and gains, sets = 1.
        score: -2 log likelihood with the priors; infinite where the simulation diverges.
        slopes: of innovations and variances, ``None`` until computed or updated.
        fresh: the slopes were computed here.
        glanced: they were computed with fixed gains.
    """

    def __init__(self, q: LikelihoodProblem, p: Array, noise: Noise) -> None:
        self.q, self.p, self.noise = q, p, noise
        nx = len(q.model.states)
        Q = noise.spectrum(nx)[None]
        self.filtered = run_filter(q.model, q.problem, p[None], Q, noise.measurement[None], keep=True)
        theta = p[list(q.free)]
        prior = float((((theta - q.prior) / q.prior_sd) ** 2).sum())
        total = float(deviance(self.filtered.innovations[0], self.filtered.variances[0]).sum()) + prior
        self.score = total if math.isfinite(total) else math.inf
        self.slopes: Jacobians | None = None
        self.fresh = self.glanced = False

    @property
    def coordinates(self) -> Array:
        """Free parameters in typical sizes, then log levels."""
        return np.concatenate([self.p[list(self.q.free)] / self.q.typical, self.noise.levels])

    def moved(self, step: Array) -> LikelihoodPoint:
        """The point after a step of the coordinates, within the bounds."""
        nf = len(self.q.free)
        p = self.p.copy()
        theta = p[list(self.q.free)] + step[:nf] * self.q.typical
        p[list(self.q.free)] = np.clip(theta, self.q.low, self.q.high)
        levels = np.clip(self.noise.levels + np.clip(step[nf:], -1.5, 1.5), *LEVELS)
        return LikelihoodPoint(self.q, p, replace(self.noise, levels=levels))

    def fixed_gain_jacobian(self) -> None:
        """Compute the slopes with fixed gains, at a tenth of the cost; those of levels by filter runs.

        The dependence of gains and variances on parameters is neglected.
        """
        q, nf, e = self.q, len(self.q.free), self.filtered.innovations[0]
        count, own = nf + len(q.groups), range(len(q.model.states))
        nudges = self._nudges()[:nf]
        theta = self.p[list(q.free)] / q.typical
        nudges = np.where(theta + nudges > q.high / q.typical, -nudges, nudges)
        P = np.tile(self.p, (nf + 1, 1))
        P[range(1, nf + 1), list(q.free)] += nudges * q.typical
        E = run_fixed_gain_filter(q.model, q.problem, P, self.filtered, own)
        lost = np.asarray(~np.isfinite(E[:, np.isfinite(e)]).all(axis=1))
        if lost[0]:
            self.differentiate()
            return
        with np.errstate(invalid="ignore"):
            slopes = np.moveaxis((E[1:] - E[0]) / nudges[:, None, None], 0, -1)
        self.slopes = Jacobians(np.zeros((*e.shape, count)), np.zeros((*e.shape, count)))
        self.slopes.innovations[..., :nf] = slopes
        self.differentiate([*np.flatnonzero(lost[1:]).tolist(), *range(nf, count)])
        self.fresh = self.glanced = True

    def differentiate(self, columns: Sequence[int] | None = None) -> None:
        """Compute the slopes by further filter runs; with `columns` only those."""
        q, nx, nf = self.q, len(self.q.model.states), len(self.q.free)
        count = nf + len(q.groups)
        chosen = list(range(count)) if columns is None else list(columns)
        if not chosen:
            return
        P, R = np.tile(self.p, (len(chosen), 1)), np.tile(self.noise.measurement, (len(chosen), 1))
        Q, nudges = np.tile(self.noise.spectrum(nx), (len(chosen), 1)), self._nudges()[chosen]
        for row, k in enumerate(chosen):
            if k < nf:
                i = q.free[k]
                nudges[row] *= -1.0 if self.p[i] + nudges[row] * q.typical[k] > q.high[k] else 1.0
                P[row, i] += nudges[row] * q.typical[k]
            else:
                levels = self.noise.levels.copy()
                levels[k - nf] += nudges[row]
                Q[row] = replace(self.noise, levels=levels).spectrum(nx)
        other = run_filter(q.model, q.problem, P, Q, R)
        e, v = self.filtered.innovations[0], self.filtered.variances[0]
        de = np.moveaxis((other.innovations - e) / nudges[:, None, None], 0, -1)
        dv = np.moveaxis((np.log(other.variances) - np.log(v)) / nudges[:, None, None], 0, -1)
        if columns is None or self.slopes is None:
            self.slopes, self.fresh, self.glanced = Jacobians(de, dv), True, False
        else:
            self.slopes.innovations[..., chosen] = de
            self.slopes.variances[..., chosen] = dv

    def _nudges(self) -> Array:
        """Step of each parameter, in typical sizes, and of each level for its finite difference."""
        nf, ng = len(self.q.free), len(self.q.groups)
        if self.slopes is None:
            return np.concatenate([np.full(nf, NUDGES[1]), np.full(ng, NUDGE_LEVEL)])
        size = np.sqrt(np.diag(self.gradient_and_fisher()[1])[:nf])
        known = np.clip(REACH / np.maximum(size, 1e-12), NUDGES[0], NUDGES[2])
        return np.concatenate([known, np.full(ng, NUDGE_LEVEL)])

    def broyden_update(self, there: LikelihoodPoint, information: Array) -> Jacobians:
        """Broyden's update of the slopes after a step, in a metric in which all parameters have equal weight.

        A step of less than a conditional standard deviation shows the integrator's error rather than slopes.
        """
        assert self.slopes is not None
        s = there.coordinates - self.coordinates
        weight = np.diag(information)
        if not float(s @ (weight * s)) > 1.0:
            return self.slopes
        old, new = self.filtered, there.filtered
        # Single Jacobian entries may be not finite: gradient_and_fisher leaves them out.
        with np.errstate(invalid="ignore"):
            changes = new.innovations[0] - old.innovations[0], np.log(new.variances[0] / old.variances[0])
            olds = self.slopes.innovations, self.slopes.variances
            return Jacobians(
                *(broyden_formula(J, s, by, weight) for J, by in zip(olds, changes, strict=True))
            )

    def gradient_and_fisher(self) -> tuple[Array, Array]:
        """Gradient of half the score and Fisher's information, in typical sizes and log levels."""
        if self.slopes is None:
            self.differentiate()
        assert self.slopes is not None
        q, nf, scores = self.q, len(self.q.free), Scores.of(self.filtered, self.slopes)
        gradient, information = scores.values.sum(axis=0), scores.information()
        prior = (q.typical / q.prior_sd) ** 2
        gradient[:nf] += (self.p[list(q.free)] - q.prior) / q.typical * prior
        information[range(nf), range(nf)] += prior
        return gradient, information

    def as_fit(self, settled: bool) -> LikelihoodFit:
        """The estimate at this point."""
        gradient, information = self.gradient_and_fisher()
        assert self.slopes is not None
        return LikelihoodFit(
            self.q, self.p, self.noise, self.filtered, self.score, self.slopes, gradient, information, settled
        )
