"""Prediction of windows from past data: moving horizon estimation with process noise between nodes.

The newest windows are estimated from their data, each divided into pieces; earlier ones enter as a Gaussian prior
(Rao, Rawlings and Mayne, IEEE Trans. Automatic Control 48, 2003). The first ones have two starts.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array
from optid.core.simulation import simulate
from optid.errors import SolveError
from optid.estimation.initial_trajectory import guess
from optid.estimation.noise_continuation import LEVELS
from optid.estimation.problem import Integers, Problem
from optid.estimation.smoother import PASSING, PRECISE, Objective, Point, Terms, descend

# Pieces of a past window; the process noise acts between them, so that a wrong model follows the newest data: an
# error of 0.83 mm on the EMPS axis, compared with 1.81 for whole windows.
PIECES = 5
MEMORY = 4  # past windows in the horizon; earlier ones enter as a Gaussian prior
LOOSER = LEVELS[:5:2]  # shares of each state's size through which the process noise is annealed
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class WindowPredictions:
    """Predictions over the windows of a problem.

    Attributes:
        outputs: (samples, outputs); NaN in the first window of a stretch, which has no past data.
        starts: states where each window begins, SI, (windows, states); NaN in the first of a stretch.
        covariances: of these, for a correct model: with process noise, missing physics would count as uncertainty;
            (windows, states, states).
    """

    outputs: Array
    starts: Array
    covariances: Array


def predict_windows(o: Objective, p: Array, q: Array) -> WindowPredictions:
    """Predictions over the windows of a problem, each from the data before it.

    Args:
        o: windows and how outputs are weighted.
        p: parameters, (parameters,).
        q: process noise, sd per window and state, SI.
    """
    count, nx = len(o.problem.begins), len(o.model.states)
    found = WindowPredictions(
        np.full_like(o.problem.measured, np.nan),
        np.full((count, nx), np.nan),
        np.full((count, nx, nx), np.nan),
    )
    for offset, part, at in stretches(o, p):
        head = int(np.searchsorted(o.problem.begins, offset))
        for w, start, covariance, outputs in _windows(part, at, q):
            begin, length = int(part.problem.begins[w]), int(part.problem.counts[w])
            keep = length + 1 if w == len(part.problem.begins) - 1 else length
            found.outputs[offset + begin : offset + begin + keep] = outputs[:keep]
            found.starts[head + w], found.covariances[head + w] = start, covariance
    return found


def stretches(o: Objective, p: Array) -> Iterator[tuple[int, Objective, Point]]:
    """Independent stretches: first sample, windows, and a guess of the states at their starts."""
    heads = np.flatnonzero(o.heads)
    for head, stop in zip(heads, [*heads[1:], len(o.problem.begins)], strict=True):
        part = _segment(o, int(head), int(stop))
        guessed = guess(part.model, part.problem, p)
        yield int(o.problem.begins[head]), part, Point(np.where(np.isfinite(guessed), guessed, o.start), p)


def _segment(o: Objective, head: int, stop: int) -> Objective:
    """Windows head..stop-1 as a problem of their own."""
    b = o.problem
    first, last = int(b.begins[head]), int(b.begins[stop - 1] + b.counts[stop - 1]) + 1
    rows, pick = slice(first, last), slice(head, stop)
    part = Problem(
        b.time[rows],
        np.ascontiguousarray(b.dt[rows]),
        np.ascontiguousarray(b.inputs[rows]),
        np.ascontiguousarray(b.measured[rows]),
        b.begins[pick] - first,
        b.counts[pick],
        b.closed[pick],
        b.linked[pick],
        b.recording[pick],
    )
    return replace(o, problem=part, weight=np.ascontiguousarray(o.weight[rows]))


def past_of(o: Objective, first: int, stop: int, mean: Array, spread: Array) -> Objective:
    """Windows first..stop-1 up to, not including, the sample at which window `stop` begins."""
    b = o.problem
    part = _segment(o, first, stop)
    closed = np.zeros(stop - first, dtype=bool)
    linked = np.ones(stop - first, dtype=bool)
    linked[-1] = False
    assert len(b.begins) >= stop
    return replace(
        part, problem=replace(part.problem, closed=closed, linked=linked), start=mean, spread=spread
    )


def best_estimate(o: Objective, at: Point, q: Array) -> tuple[Point, Terms]:
    """The more likely of the estimates from the guess as it is and annealed.

    An axis that sticks in the model and moves on the rig gives no gradient.
    """
    found = []
    for how in (_tight, _annealed):
        with contextlib.suppress(SolveError):
            found.append(how(o, at, q))
    if not found:
        raise SolveError("the simulation diverged within the first windows (NaN or infinite)")
    return min(found, key=lambda one: one[1].cost)


def _annealed(o: Objective, at: Point, q: Array) -> tuple[Point, Terms]:
    """Anneal from loose to tight: started tight, a sticking node keeps pressures that the data would correct."""
    terms = None
    for looser in LOOSER:
        level = np.maximum(q, looser * o.model.scales)
        at, terms, _ = descend(o, at, level, precision=PASSING, terms=terms)
    return _tight(o, at, q, terms)


def _tight(o: Objective, at: Point, q: Array, terms: Terms | None = None) -> tuple[Point, Terms]:
    """From a near start: most of it comes from the window before."""
    at, terms, _ = descend(o, at, q, precision=PRECISE, terms=terms)
    return at, terms


def _windows(o: Objective, at: Point, q: Array) -> Iterator[tuple[int, Array, Array, Array]]:
    """For every window after the first: its number, start state, covariance, and predicted outputs."""
    b = o.problem
    fine, nodes = _refined(o)
    q = q / np.sqrt(PIECES)
    mean, spread, first, young = o.start, o.spread, 0, 0
    scales = o.model.scales
    unknown = _Uncertainty(*[np.diag((o.spread / scales) ** 2)] * 2)
    sure = unknown
    X = np.full((len(fine.problem.begins), len(o.spread)), np.nan)
    for w in range(len(b.begins)):
        begin = nodes[w]
        if w == 0:
            X[0] = at.X[0]
        else:
            past = past_of(fine, first, begin, mean, spread)
            try:
                near = Point(X[first:begin], at.p)
                if first == young:
                    found, terms = best_estimate(past, near, q)
                else:
                    found, terms = _tight(past, near, q)
                X[first:begin], X[begin] = found.X, terms.end[-1]
                for k in range(nodes[w - 1] - first, begin - first):
                    sure = sure.after(terms, k, q, scales)
                if w - np.searchsorted(nodes, first) >= MEMORY:
                    leaves = nodes[np.searchsorted(nodes, first) + 1] - first
                    mean, spread = _arrival(past, found, terms, q, int(leaves))
                    first += int(leaves)
            except SolveError:  # the model diverges: start again from here
                X[begin] = at.X[w]
                mean, spread, first, young = X[begin], o.spread, begin, begin
                sure = unknown
        run = simulate(
            o.model, at.p, X[begin], b.dt, b.inputs, first=b.begins[w : w + 1], intervals=int(b.counts[w])
        )
        # The model's prediction of the nodes in the window is the next estimate's guess: it uses past data only.
        stop = nodes[w + 1] if w + 1 < len(nodes) else len(X)
        X[begin + 1 : stop] = run.states[0, fine.problem.begins[begin + 1 : stop] - b.begins[w]]
        if w:
            yield w, X[begin].copy(), sure.actual * np.outer(scales, scales), run.outputs[0]


def _refined(o: Objective) -> tuple[Objective, Integers]:
    """The same with every window cut into `PIECES`, and the node at which each window begins, (windows,)."""
    b = o.problem
    cuts = [
        begin + np.unique(np.round(np.linspace(0, count, min(PIECES, count) + 1)).astype(int))
        for begin, count in zip(b.begins.tolist(), b.counts.tolist(), strict=True)
    ]
    each = np.array([len(edges) - 1 for edges in cuts])
    last = np.cumsum(each) - 1
    closed, linked = np.zeros(last[-1] + 1, dtype=bool), np.ones(last[-1] + 1, dtype=bool)
    closed[last], linked[last] = b.closed, b.linked
    fine = replace(
        b,
        begins=np.concatenate([edges[:-1] for edges in cuts]),
        counts=np.concatenate([np.diff(edges) for edges in cuts]),
        closed=closed,
        linked=linked,
        recording=np.repeat(b.recording, each),
    )
    return replace(o, problem=fine), last + 1 - each


@dataclass(frozen=True, eq=False)
class _Uncertainty:
    """Covariances of a filter's state in units of the states' sizes, (states, states).

    Attributes:
        assumed: assumed covariance of the filter, with process noise.
        actual: covariance due to the measurement noise alone, for a correct model.
    """

    assumed: Array
    actual: Array

    def after(self, terms: Terms, k: int, q: Array, scales: Array) -> _Uncertainty:
        """The covariance after piece k, from its start and its data, with process noise `q`."""
        nx = len(scales)
        H = terms.H[k, :nx, :nx] * np.outer(scales, scales)
        slope = terms.slope[k, :, :nx] * scales / scales[:, None]
        values, vectors = np.linalg.eigh(self.assumed)
        told, away = _informative_directions(H, vectors * np.sqrt(np.maximum(values, 0.0)))
        back, left, forward = np.linalg.pinv(away), 1.0 / (1.0 + told), slope @ away
        actual = np.outer(left, left) * (back @ self.actual @ back.T) + np.diag(left**2 * told)
        assumed = (forward * left) @ forward.T + np.diag((q / scales) ** 2)
        return _Uncertainty(assumed, forward @ actual @ forward.T)


def _informative_directions(H: Array, root: Array) -> tuple[Array, Array]:
    """What data of information H tell beside a prior with covariance root root': directions independent in both.

    Returns how many times the prior's information the data add in each, (states,), and the directions, of one prior sd,
    as columns. At a kink of friction slopes may be so large that rounding hides the other directions: of these the data
    tell nothing.
    """
    told, turned = np.linalg.eigh(root.T @ H @ root)
    return np.where(told > len(told) * EPS * told[-1], told, 0.0), root @ turned


def _arrival(past: Objective, found: Point, terms: Terms, q: Array, leaves: int) -> tuple[Array, Array]:
    """The prior of the next node from the pieces that leave the horizon: mean and sd, with process noise."""
    nx = len(q)
    mean, spread = past.start, past.spread
    for k in range(leaves):
        told, away = _informative_directions(terms.H[k, :nx, :nx], np.diag(spread))
        pulled = np.where(told > 0.0, away.T @ terms.g[k, :nx], 0.0)
        pulled -= away.T @ ((found.X[k] - mean) / spread**2)
        forward = terms.slope[k, :, :nx] @ away / np.sqrt(1.0 + told)
        mean = terms.end[k] + forward @ (pulled / np.sqrt(1.0 + told))
        spread = np.sqrt((forward**2).sum(axis=1) + q**2)
    return mean, spread
