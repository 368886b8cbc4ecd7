"""A model fitted to a set of recordings, as the diagnosis compares them: by the marginal likelihood of the data.

The likelihood has the states integrated out and the process noise chosen by it (Kristensen et al. 2004). A model
that lacks physics needs more process noise to follow the data, and pays for it; so two models are compared
each at its own best, and what a model gets wrong counts as noise when an effect is judged.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.core.model import Array
from optid.core.recording import Recording
from optid.errors import SolveError
from optid.fit.batch import LEVELS, marginal
from optid.fit.objective import freed_with_rest, objective_of, window_length
from optid.fit.problem import Problem, pose
from optid.fit.smoother import Objective, Point, Terms, descend, evaluate
from optid.rigs.rigfile import Rig

HELD = 1e-9  # prior sd of a parameter that is not to move, as a share of its typical size


@dataclass(frozen=True, eq=False)
class Fitted:
    """A rig's model at its best on some recordings.

    Attributes:
        rig: with the fitted values as its parameters.
        objective: what was minimised.
        at: states at the nodes and parameters.
        terms: the linearisation there.
        level: process noise per node as a share of each state's scale.
        score: -2 log of the marginal likelihood, up to a constant of the data.
        settled: the iteration converged.
    """

    rig: Rig
    objective: Objective
    at: Point
    terms: Terms
    level: float
    score: float
    settled: bool

    @property
    def values(self) -> dict[str, float]:
        """All parameters by name, SI."""
        return {q.name: float(v) for q, v in zip(self.rig.model.parameters, self.at.p, strict=True)}

    @property
    def q(self) -> Array:
        """Process noise per node, SI, (states,)."""
        return self.level * self.rig.model.scales

    @property
    def per_window(self) -> Array:
        """Each window's part of the cost, (windows,): misfit, and defect towards the next node."""
        return np.asarray(self.terms.misfit[:, 0] + ((self.terms.defect / self.q) ** 2).sum(axis=1))


def problem_of(rig: Rig, recordings: Sequence[Recording]) -> Problem:
    """The recordings cut into windows as the diagnosis uses them."""
    return pose(rig.model, recordings, window_length(rig.model, recordings))


def objective_for(rig: Rig, problem: Problem) -> Objective:
    """What a fit of everything the rig frees minimises; an effect's parameters keep their own scale."""
    objective, p = objective_of(rig, freed_with_rest(rig), problem)
    typical = [
        rig.model.parameters[i].typical if "." in rig.model.parameters[i].name else size
        for i, size in zip(objective.free, objective.typical, strict=True)
    ]
    return replace(objective, typical=np.array(typical))


def settle(
    rig: Rig, objective: Objective, at: Point, levels: Sequence[float], iterations: int = 40
) -> Fitted:
    """Anneal through `levels` (loose to tight) as far as the marginal likelihood grows.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    best: Fitted | None = None
    for level in levels:
        q = level * rig.model.scales
        at, _, settled = descend(objective, at, q, iterations=iterations, precision=1e-4)
        terms = evaluate(objective, at, q, slopes=True)
        score = marginal(objective, at, terms, q)
        if best is not None and score > best.score:
            break
        best = Fitted(rig, objective, at, terms, level, score, settled)
    if best is None:
        raise SolveError("no level of process noise to fit at")
    values = dict(zip((q.name for q in rig.model.parameters), best.at.p.tolist(), strict=True))
    return replace(best, rig=replace(rig, parameters={**rig.parameters, **_stated(rig, values)}))


def _stated(rig: Rig, values: Mapping[str, float]) -> dict[str, float]:
    free = {f.name for f in rig.freed}
    return {name: value for name, value in values.items() if name in free}


def around(level: float) -> tuple[float, ...]:
    """The levels to go through from a fit at `level`: one looser, and on from there."""
    looser = [one for one in LEVELS if one > level]
    return tuple((looser[-1:] if looser else []) + [one for one in LEVELS if one <= level])


def judged(fitted: Fitted, problem: Problem, at: Point) -> Fitted:
    """The fitted parameters on other recordings: only the states are estimated, at the same process noise.

    Args:
        fitted: gives parameters and process noise.
        problem: the other recordings.
        at: states to start from.
    """
    objective = objective_for(fitted.rig, problem)
    p = fitted.at.p
    held = replace(objective, prior=p[list(objective.free)], prior_sd=HELD * objective.typical)
    for level in (*(one for one in LEVELS if one > fitted.level), fitted.level):
        at, _, settled = descend(
            held, Point(at.X, p), level * fitted.rig.model.scales, iterations=40, precision=1e-5
        )
    terms = evaluate(held, at, fitted.q, slopes=True)
    score = marginal(held, at, terms, fitted.q)
    return Fitted(fitted.rig, held, at, terms, fitted.level, score, settled)
