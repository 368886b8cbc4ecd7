"""95 % intervals of a diagnosed model's parameters.

Fisher's information of the filter's innovations, and the largest of three estimates by how much a law's wrong form and
coloured innovations widen its intervals: a sandwich estimate over blocks, the error beyond the noise, and by how much
the estimates of single recordings disagree (both Birge, Physical Review 40, 1932). Each of them sees all of the misfit;
their product would count it twice. Times resolved by samples have at least the interval that the effect states.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import chdtrc, ndtri

from optid.core.model import Array
from optid.diagnosis.refinement import RefinedModel
from optid.effects.effect import Effect
from optid.estimation.likelihood_point import LikelihoodFit, Scores
from optid.estimation.problem import Booleans, Integers, window_blocks, window_seconds
from optid.estimation.result import Z95, Estimate

SINGULAR = 1e-13  # of the largest eigenvalue: directions with less information are not shown


def intervals(model: RefinedModel, ratio: float) -> tuple[Estimate, ...]:
    """Every free parameter with its interval, SI; `ratio` is the model's error over the expected one (Birge)."""
    answer = model.fit
    q, theta = answer.likelihood_problem, answer.p[list(answer.likelihood_problem.free)]
    bound = _at_bounds(answer)
    # A parameter fixed at a bound also restricts the others.
    own, others = (np.diag(_covariance(answer, fixed, ratio)) for fixed in (np.zeros_like(bound), bound))
    # An infinite ratio of no variance is none.
    sd = np.sqrt(np.fmax(np.where(bound, own, others), 0.0)) * q.typical
    # Bounds of nuisance parameters keep simulations short: the truth may lie beyond, and others make up for it.
    nuisance = np.array([q.model.parameters[i].nuisance is not None for i in q.free])
    sd = np.hypot(sd, _left_to_go(answer, bound & ~nuisance))
    sd = np.hypot(sd, np.where(bound, 0.0, q.model.known_bias(q.free, theta)))
    unseen = [_unidentifiable(answer.information, fixed) for fixed in (np.zeros_like(bound), bound)]
    sd[np.where(bound, *unseen)] = np.inf
    half = np.maximum(Z95 * sd, _resolution(model)) + model.shift
    found = []
    for k, i in enumerate(q.free):
        parameter = q.model.parameters[i]
        low, high = max(theta[k] - half[k], q.low[k]), min(theta[k] + half[k], q.high[k])
        identifiable = bool(np.isfinite(sd[k]))
        found.append(
            Estimate(
                parameter.name,
                parameter.unit,
                float(theta[k]),
                float(low),
                float(high),
                float(q.prior[k]),
                bool(bound[k]),
                identifiable,
            )
        )
    return tuple(found)


def joint_p_value(model: RefinedModel, effect: Effect, ratio: float) -> float:
    """Wald's p-value of the hypothesis that all strengths of an effect are null; one at a bound is held there.

    Strengths that make up for each other, as the parts of a sensor's curve, are uncertain each by itself only.
    """
    answer, null = model.fit, effect.at_null()
    q, bound = answer.likelihood_problem, _at_bounds(model.fit)
    names = [q.model.parameters[i].name.removeprefix(f"{effect.name}.") for i in q.free]
    rows = [k for k, name in enumerate(names) if name in effect.strength and not bound[k]]
    off = np.array([(answer.p[q.free[k]] - null[names[k]]) / q.typical[k] for k in rows])
    covariance = _covariance(answer, bound, ratio)[np.ix_(rows, rows)]
    if not rows or not np.isfinite(covariance).all():
        return 1.0
    return float(chdtrc(len(rows), off @ _inverse(covariance) @ off))


def apart_from_none(
    estimates: Sequence[Estimate], effect: Effect, p_value: float, sure: bool
) -> tuple[Estimate, ...]:
    """Estimates in which one interval excludes zero, where a test rules out that the effect is absent.

    Wald's interval is of first order about the estimate. For a law that is strongly nonlinear between there and zero,
    or whose strength is correlated with its shape, it may include zero although a test clearly rules that out. Then
    the end of the most certain strength's interval is computed by inverting the test along its signed root (Cox and
    Hinkley, Theoretical Statistics, 1974, section 9.3).

    Args:
        estimates: all parameters, SI.
        effect: named.
        p_value: of the hypothesis that it is absent, of a one-sided test.
        sure: whether its model reaches the noise, or its strengths are together away from none. Otherwise the law's
            form is wrong, and the test shows that it helps, not how large it is: its strength must exceed its own sd.
    """
    root, null = float(-ndtri(p_value)), effect.at_null()
    least = {f"{effect.name}.{name}": null[name] for name in effect.strength}
    sizes = [one for one in estimates if one.name in least and one.high > one.low]
    share = 1.0 - Z95 / root
    if not sizes or share <= 0.0 or any(not e.low <= least[e.name] <= e.high for e in sizes):
        return tuple(estimates)
    surest = max(sizes, key=lambda e: abs(e.value - least[e.name]) / (e.high - e.low))
    sd = max(surest.high - surest.value, surest.value - surest.low) / Z95
    if not sure and abs(surest.value - least[surest.name]) < sd:
        return tuple(estimates)
    end = least[surest.name] + share * (surest.value - least[surest.name])
    mended = replace(surest, low=end) if surest.value > least[surest.name] else replace(surest, high=end)
    return tuple(mended if one is surest else one for one in estimates)


def _at_bounds(answer: LikelihoodFit) -> Booleans:
    """Free parameters at a bound, (free,)."""
    q, theta = answer.likelihood_problem, answer.p[list(answer.likelihood_problem.free)]
    span = np.where(np.isfinite(q.high - q.low), q.high - q.low, np.abs(theta) + q.typical)
    return np.asarray((theta - q.low <= 1e-9 * span) | (q.high - theta <= 1e-9 * span))


def _resolution(model: RefinedModel) -> Array:
    """Smallest half-widths of times resolved by samples, (free,), SI; for numbers of samples without conversion."""
    q = model.fit.likelihood_problem
    free = {q.model.parameters[i].name: (k, q.model.parameters[i].unit) for k, i in enumerate(q.free)}
    least, interval = np.zeros(len(q.free)), float(np.median(q.problem.dt))
    for effect in model.effects:
        for name, samples in effect.resolved.items():
            k, unit = free[f"{effect.name}.{name}"]
            least[k] = samples * (interval if unit == "s" else 1.0)
    return least


def _left_to_go(answer: LikelihoodFit, fixed: Booleans) -> Array:
    """The Gauss-Newton step from the end of a search, (free,), SI; zero for `fixed` parameters.

    Dry friction and the integrator's steps make a likelihood rough on the scale of an sd where the noise is low: a
    search ends in one of its small local minima, while slopes over several of them show the global one.
    """
    q, moved = answer.likelihood_problem, _moved(answer, fixed)
    step = np.zeros(len(answer.gradient))
    step[moved] = _inverse(answer.information[np.ix_(moved, moved)]) @ answer.gradient[moved]
    return np.asarray(np.abs(step[: len(fixed)]) * q.typical)


def _covariance(answer: LikelihoodFit, fixed: Booleans, ratio: float) -> Array:
    """Of the free parameters in typical sizes, (free, free), where some of them, (free,), are known.

    `ratio` is the model's error over the expected one.
    """
    q, moved = answer.likelihood_problem, _moved(answer, fixed)
    scores = Scores.of(answer.filtered, answer.slopes)
    inverse = np.zeros_like(answer.information)
    inverse[np.ix_(moved, moved)] = _inverse(answer.information[np.ix_(moved, moved)])
    length = window_seconds(float(np.median(q.problem.dt)), float(np.ptp(q.problem.time)))
    owner = np.repeat(q.problem.recording, q.problem.counts + 1)[scores.rows]
    where = window_blocks(owner, q.problem.time[scores.rows], length)
    summed = np.zeros((int(where.max()) + 1, len(moved)))
    np.add.at(summed, where, scores.values)
    prior = np.zeros(len(moved))
    prior[: len(q.free)] = (q.typical / q.prior_sd) ** 2
    sandwich = inverse @ (summed.T @ summed + np.diag(prior)) @ inverse
    own = np.diag(inverse)
    wider = np.divide(
        np.diag(sandwich), own, out=np.ones(len(own)), where=own > 1e-30
    )  # 0: without influence
    between = _between_recordings(scores, owner, prior, moved)
    scale = np.sqrt(np.maximum(np.maximum(wider, between), max(ratio, 1.0) ** 2))
    nf = len(q.free)
    return np.asarray((inverse * np.outer(scale, scale))[:nf, :nf])


def _between_recordings(scores: Scores, owner: Integers, prior: Array, moved: Booleans) -> Array:
    """Variance of each parameter's estimates from single recordings over the expected one, (free + levels,).

    Each estimate is the Gauss-Newton step of its recording from the common one. A law in another form than the true
    one biases recordings of different motion differently, long before its error exceeds the noise.
    """
    recordings = np.unique(owner)
    if len(recordings) < 2:
        return np.ones(len(moved))
    at, weight = np.zeros((2, len(recordings), len(moved)))
    for k, one in enumerate(recordings):
        part = owner == one
        information = scores.information(part) + np.diag(prior) / len(recordings)
        inverse = _inverse(information[np.ix_(moved, moved)])
        at[k, moved] = -inverse @ scores.values[part].sum(axis=0)[moved]
        own = np.diag(inverse)
        weight[k, moved] = np.divide(1.0, own, out=np.zeros(len(own)), where=own > 1e-30)
    total = np.maximum(weight.sum(axis=0), 1e-300)
    mean = (weight * at).sum(axis=0) / total
    return np.asarray((weight * (at - mean) ** 2).sum(axis=0) / (len(recordings) - 1))


def _moved(answer: LikelihoodFit, fixed: Booleans) -> Booleans:
    """Parameters that are not fixed, and all levels, (free + levels,)."""
    return np.append(~fixed, np.ones(len(answer.information) - len(fixed), dtype=np.bool_))


def _inverse(information: Array) -> Array:
    """Without the directions that the data do not show; their coordinates are `_unidentifiable`."""
    scaled, size = _scaled_information(information)
    return np.asarray(np.linalg.pinv(scaled, rcond=SINGULAR, hermitian=True) / np.outer(size, size))


def _unidentifiable(information: Array, fixed: Booleans) -> Booleans:
    """Free parameters without influence, or with one that others, not `fixed`, can replace exactly, (free,)."""
    moved = np.append(~fixed, np.ones(len(information) - len(fixed), dtype=np.bool_))
    unseen = np.zeros(len(moved), dtype=np.bool_)
    values, directions = np.linalg.eigh(_scaled_information(information[np.ix_(moved, moved)])[0])
    lost = directions[:, values <= SINGULAR * values.max()]
    unseen[moved] = (lost**2).sum(axis=1) > np.sqrt(SINGULAR)
    return unseen[: len(fixed)]


def _scaled_information(information: Array) -> tuple[Array, Array]:
    """The information in units in which its diagonal is 1, or 0 without any, and these units."""
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return information / np.outer(size, size), size
