"""Intervals of a diagnosed model's parameters that count what the catalogue could still hold.

Four sources: the noise (Fisher's information), colour of the innovations (a sandwich over blocks), every effect that
was not named, which may be present up to the smallest size worth a name, and the numerical settings, which may be
wrong by a factor of two. The last two are priors on sizes that the data may sharpen; they are what keeps intervals
honest when a law's form is not exact. Where it visibly is not, recordings disagree, and that counts as well; and what
a model misses by beyond noise widens every interval in proportion (Birge, Physical Review 40, 1932), as all recordings
may err alike. A search ends somewhat below the top: what is within reach of the top is within reach of its end by as
much more.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from optid.core.model import Array
from optid.diagnosis.candidate import Candidate
from optid.diagnosis.judge import numerical_settings
from optid.diagnosis.screen import LOST, Signature, View
from optid.estimation.likelihood import run_steered
from optid.estimation.place import Answer
from optid.estimation.prediction import horizon
from optid.estimation.result import Estimate
from optid.estimation.scoring import ENOUGH
from optid.estimation.steering import STEPS, steered_fit

FEWEST = 3  # recordings whose disagreement says something; of two an interval is 13 times what they differ by
UNNAMED = 0.5  # sd of an unnamed effect's size, in smallest sizes worth a name
BLOCK = 0.5  # of a window: innovations within it count as one
# sd to the ends of a 95 % interval: where the likelihood has fallen by what chance makes it fall, and by what a search
# leaves of the way up.
WITHIN = float(np.sqrt(stats.chi2.ppf(0.95, 1) + ENOUGH))


def estimates(
    answer: Answer, signatures: Sequence[Signature], least: Array | None = None, ratio: float = 1.0
) -> tuple[Estimate, ...]:
    """Every free parameter with its 95 % interval, SI.

    Args:
        answer: the fit.
        signatures: of effects that were not named.
        least: half-width of each interval at least, (free,), SI.
        ratio: of what the model misses by to what it should (Birge).
    """
    q = answer.question
    theta = answer.p[list(q.free)]
    covariance = _covariance(answer, signatures)
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0)) * q.typical
    span = np.where(np.isfinite(q.high - q.low), q.high - q.low, np.abs(theta) + q.typical)
    bound = (theta - q.low <= 1e-9 * span) | (q.high - theta <= 1e-9 * span)
    half = np.maximum(ratio * WITHIN * sd, 0.0 if least is None else least)
    found = []
    for k, i in enumerate(q.free):
        parameter = q.model.parameters[i]
        low, high = max(theta[k] - half[k], q.low[k]), min(theta[k] + half[k], q.high[k])
        start = float(q.prior[k])
        found.append(
            Estimate(
                parameter.name, parameter.unit, float(theta[k]), float(low), float(high), start,
                bool(bound[k]), bool(np.isfinite(sd[k]) and sd[k] < 1e3 * q.typical[k]),
            )
        )  # fmt: skip
    return tuple(found)


def disagreement(answer: Answer) -> Array:
    """Half-widths of 95 % intervals by the jackknife over recordings (Miller, Biometrika 61, 1974), (free,), SI.

    A law of another form than the truth's comes out differently where the excitation differs. What the recordings say
    without one of them is found under the answer's own gains: they are the same for all.
    """
    q, found = answer.question, []
    owners = np.unique(q.problem.recording)
    count = len(owners)
    if count < 2:
        return np.zeros(len(q.free))
    for left_out in owners:
        rest = np.flatnonzero(q.problem.recording != left_out).tolist()
        p = steered_fit(q, answer.p, q.model, answer.filtered, STEPS, rest).p
        found.append(p[list(q.free)])
    return jackknife(found)


def jackknife(without: Sequence[Array]) -> Array:
    """Half-widths of 95 % intervals from what was estimated without one recording each, as `disagreement` takes it."""
    count = len(without)
    squares = (np.array(without) - np.mean(without, axis=0)) ** 2
    spread = np.sqrt((count - 1) / count * squares.sum(axis=0))
    return np.asarray(stats.t.ppf(0.975, count - 1) * spread)


def resolution(model: Candidate) -> Array:
    """Least half-widths of 95 % intervals of times that laws resolve by samples, (free,), SI."""
    q = model.answer.question
    names = {q.model.parameters[i].name: k for k, i in enumerate(q.free)}
    least = np.zeros(len(q.free))
    for effect in model.effects:
        for name, samples in effect.resolved.items():
            least[names[f"{effect.name}.{name}"]] = samples * float(np.median(q.problem.dt))
    return least


def _covariance(answer: Answer, signatures: Sequence[Signature]) -> Array:
    """Of the free parameters in typical sizes, (free, free)."""
    view, q = View.of(answer), answer.question
    nf = len(q.free)
    extra = [s.change / s.size for s in signatures if len(s.change) == len(view.z) and s.size > 0]
    numerical = _numerical(answer, view)
    J = np.column_stack([view.J, *extra, *numerical])
    prior = np.r_[(q.typical / q.prior_sd) ** 2, np.full(len(extra), UNNAMED**-2), np.ones(len(numerical))]
    H = J.T @ J + np.diag(prior)
    size = np.sqrt(np.maximum(np.diag(H), 1e-300))
    inverse = np.linalg.pinv(H / np.outer(size, size), rcond=1e-13) / np.outer(size, size)
    scores = J * view.z[:, None]
    length = BLOCK * horizon(float(np.median(q.problem.dt)))
    blocks = (q.problem.time[view.rows] / length).astype(int) + 10**6 * view.rows_owner(q.problem)
    _, where = np.unique(blocks, return_inverse=True)
    summed = np.zeros((where.max() + 1, J.shape[1]))
    np.add.at(summed, where.ravel(), scores)
    meat = summed.T @ summed + np.diag(prior)
    sandwich = inverse @ meat @ inverse
    own = np.diag(inverse)[:nf]
    wider = np.divide(np.diag(sandwich)[:nf], own, out=np.ones(nf), where=own > 1e-30)  # 0: without influence
    scale = np.sqrt(np.maximum(wider, 1.0))
    return np.asarray(inverse[:nf, :nf] * np.outer(scale, scale))


def _numerical(answer: Answer, view: View) -> list[Array]:
    """What each numerical setting changes in the scaled innovations: half the way from its half to its double."""
    q = answer.question
    pairs = numerical_settings(answer)
    if not len(pairs):
        return []
    runs = run_steered(q.model, q.problem, pairs, answer.filtered, range(len(q.model.states)))
    with np.errstate(invalid="ignore"):  # both may have left the numbers
        changes = [
            (high - low)[view.known] / 2 * view.scale * view.weight
            for low, high in zip(runs[::2], runs[1::2], strict=True)
        ]
    # Beyond it a model that lost track under held gains says nothing.
    return [np.where(np.abs(change) > LOST, 0.0, change) for change in changes if np.isfinite(change).all()]
