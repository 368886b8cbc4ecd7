"""Which parameters these data determine: rank and direction of the information left after the states."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from optid.core.model import Array
from optid.fit.smoother import Objective, Point, Terms, descend, settled_system

LOOSE = 0.03  # process noise of the examination, as a share of each state's usual size
MUTE = 1.0  # relative standard deviation beyond which the data say nothing of a value's size


@dataclass(frozen=True, eq=False)
class Ties:
    """`idle`: names without any influence; `mute`: (free,) bool, not determined; `sentences`: in words."""

    idle: tuple[str, ...]
    mute: Any
    sentences: tuple[str, ...]


def information(o: Objective, at: Point, t: Terms, q: Array) -> Array:
    """Information on the logarithms of the free parameters with all states eliminated, (free, free).

    Unit noise sd: an eigenvalue of 1e4 means that its direction is known to 1 %.
    """
    none = np.zeros(len(o.free), dtype=bool)
    s = settled_system(o, at, t, q, none)
    usual = np.array([o.model.parameters[i].typical for i in o.free])
    size = np.maximum(np.abs(at.p[list(o.free)]), usual) / o.typical
    return np.asarray(s.schur * np.outer(size, size))


def find_ties(o: Objective, at: Point, t: Terms, q: Array, held: Any) -> Ties:
    """Say which parameters cannot be told apart.

    A direction of log-parameters whose standard deviation exceeds `MUTE` (100 %) is undetermined; those that
    carry it are named together, with the exponents under which only their product counts.
    """
    names = [o.model.parameters[i].name for i in o.free]
    matrix = information(o, at, t, q)
    own = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    idle = tuple(n for n, a, h in zip(names, own, held, strict=True) if a * MUTE < 1.0 and not h)
    values, vectors = np.linalg.eigh(matrix)
    mute = own * MUTE < 1.0
    sentences = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value * MUTE**2 >= 1.0:
            continue
        members = np.flatnonzero(np.abs(vector) > 0.1 * np.abs(vector).max())
        mute[members] = True
        if len(members) == 1:
            sentences.append(f"{names[members[0]]} has no visible influence on these data")
        else:
            sentences.append(_in_words([names[i] for i in members], vector[members]))
    return Ties(idle, mute & ~np.asarray(held), tuple(sentences))


def examine(o: Objective, at: Point) -> Ties:
    """What the data can say of the free parameters, before any fit: at the values of the start.

    Only the states are estimated, with much process noise, so that wrong values do not matter yet.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    theta, q = at.p[list(o.free)], LOOSE * o.model.scales
    pinned = replace(o, low=theta, high=theta)
    at, terms, _ = descend(pinned, at, q, iterations=20, precision=1e-3)
    return find_ties(o, at, terms, q, np.zeros(len(o.free), dtype=bool))


def _in_words(names: list[str], direction: Array) -> str:
    """A null direction d of the logarithms: scaling every parameter by c^d changes nothing."""
    share = direction / np.abs(direction).max()
    if len(names) == 2 and np.allclose(np.abs(share), 1.0, atol=0.05):
        form = "product" if share[0] * share[1] < 0 else "ratio"
        return f"{names[0]} and {names[1]} appear only as a {form}: fix one of them"
    together = ", ".join(f"{n} ** {s:+.2f}" for n, s in zip(names, share, strict=True))
    return f"scaling {together} together changes nothing these data show: fix one of them"
