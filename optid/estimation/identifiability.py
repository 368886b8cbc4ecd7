"""Which parameters these data determine: rank and direction of the information left after the states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from optid.core.model import Array
from optid.core.recording import Recording
from optid.estimation.initial_trajectory import guess
from optid.estimation.noise_continuation import LEVELS
from optid.estimation.objective import objective_of, with_nuisance_parameters
from optid.estimation.problem import build_problem, node_distance
from optid.estimation.smoother import Objective, Point, Terms, descend, evaluate, settled_system
from optid.rigs.rigfile import Rig

LOOSE = LEVELS[2]  # process noise of this analysis, as a share of each state's usual size
WEAK = 0.3  # relative standard deviation beyond which parameters are reported as tied


@dataclass(frozen=True, eq=False)
class Collinearity:
    """Which parameters the data can separate.

    Attributes:
        idle: names without any influence.
        mute: (free,) bool, not determined.
        sentences: sentences on parameters that cannot be separated.
        rank: number of directions of the free parameters' logarithms that are determined.
        condition: of the sensitivities: the largest standard deviation of a direction over the smallest.
        weakest: the largest, relative, and the parameter that leads its direction.
    """

    idle: tuple[str, ...]
    mute: Any
    sentences: tuple[str, ...]
    rank: int
    condition: float
    weakest: tuple[float, str]


def information(o: Objective, at: Point, t: Terms, q: Array) -> Array:
    """Information on the logarithms of the free parameters with all states eliminated, (free, free).

    Unit noise sd: an eigenvalue of 1e4 means that its direction is known to 1 %.
    """
    none = np.zeros(len(o.free), dtype=bool)
    s = settled_system(o, at, t, q, none)
    usual = np.array([o.model.parameters[i].typical for i in o.free])
    size = np.maximum(np.abs(at.p[list(o.free)]), usual) / o.typical
    return np.asarray(s.schur * np.outer(size, size))


def find_ties(o: Objective, at: Point, t: Terms, q: Array, held: Any) -> Collinearity:
    """Find parameters that cannot be separated.

    A direction of log-parameters whose standard deviation exceeds 100 % is undetermined; those that
    carry it are named together, with the exponents under which only their product counts. One that exceeds
    `WEAK` is named too: with a choked exhaust and position only, scaling supply, mass and forces together
    changes nothing, and their size follows from the assumed start pressures only.
    """
    names = [o.model.parameters[i].name for i in o.free]
    unasked = {one.name for one in o.model.parameters if one.nuisance is not None}
    matrix = information(o, at, t, q)
    own = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    idle = tuple(n for n, a, h in zip(names, own, held, strict=True) if a < 1.0 and not h)
    values, vectors = np.linalg.eigh(matrix)
    sizes = np.maximum(values, 1e-12 * max(float(values[-1]), 1e-300)) ** -0.5  # ascending values: falling sd
    mute = own < 1.0
    sentences = []
    for sd, vector in zip(sizes, vectors.T, strict=True):
        members = np.flatnonzero(np.abs(vector) > 0.1 * np.abs(vector).max())
        together = [names[i] for i in members]
        if sd > 1.0:
            mute[members] = True
        if unasked >= set(together):
            continue  # nuisance parameters of friction at rest, treated apart
        if sd > 1.0:
            sentences.append(_in_words(together, vector[members]))
        elif sd > WEAK and len(members) > 1:
            sentences.append(
                f"{_scaling(together, vector[members])} has little effect on these data: the factor is known to "
                f"{100 * sd:.0f} %"
            )
    leader = names[int(np.abs(vectors[:, 0]).argmax())]
    return Collinearity(
        idle,
        mute & ~np.asarray(held),
        tuple(sentences),
        int((sizes <= 1.0).sum()),
        float(sizes[0] / sizes[-1]),
        (float(sizes[0]), leader),
    )


def examine(o: Objective, at: Point) -> tuple[Collinearity, Terms]:
    """Identifiability of the free parameters before any fit, and the linearisation at the start.

    Only the states are estimated, with much process noise, so that wrong values do not matter yet.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    theta, q = at.p[list(o.free)], LOOSE * o.model.scales
    pinned, start = replace(o, low=theta, high=theta), evaluate(o, at, q)
    at, terms, _ = descend(pinned, at, q, precision=1e-3, terms=start)
    return find_ties(o, at, terms, q, np.zeros(len(o.free), dtype=bool)), start


def identifiability(rig: Rig, recordings: Sequence[Recording]) -> Collinearity:
    """Which parameters a fit could separate, before it starts.

    Raises:
        SolveError: the model cannot be simulated at the rig's values.
    """
    problem = build_problem(rig.model, recordings, node_distance(recordings))
    objective, p = objective_of(rig, with_nuisance_parameters(rig), problem)
    return examine(objective, Point(guess(rig.model, problem, p), p))[0]


def _in_words(names: list[str], direction: Array) -> str:
    """A null direction d of the logarithms: scaling every parameter by c^d changes nothing."""
    if len(names) == 1:
        return f"{names[0]} has no visible influence on these data"
    share = direction / np.abs(direction).max()
    if len(names) == 2 and np.allclose(np.abs(share), 1.0, atol=0.05):
        form = "product" if share[0] * share[1] < 0 else "ratio"
        return f"{names[0]} and {names[1]} appear only as a {form}: fix one of them"
    return f"{_scaling(names, direction)} changes nothing in these data: fix one of them"


def _scaling(names: list[str], direction: Array) -> str:
    share = direction / direction[np.abs(direction).argmax()]
    if np.allclose(share, 1.0, atol=0.1):
        return f"scaling {', '.join(names[:-1])} and {names[-1]} by one factor"
    together = ", ".join(f"{n} ** {s:+.2f}" for n, s in zip(names, share, strict=True))
    return f"scaling {together} together"
