"""A look around by a simplex, for recordings so short that a filter costs a millisecond or two.

The likelihood of few samples has many tops, above all where the model is wrong: a descent on slopes ends on the first.
Nelder and Mead's simplex (Computer Journal 7, 1965; steps that shrink with the dimension: Gao and Han, Computational
Optimization and Applications 51, 2012) takes no slopes, and steps over what is small beside itself.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.optimize import minimize

from optid.core.model import Array
from optid.errors import SolveError
from optid.estimation.place import LEVELS, Place

FEW = 2000  # samples, up to which it is worth the while
REACH = (0.1, 0.5)  # edges of the first simplex: of typical sizes, and of the log of process noise
EVALUATIONS = 400  # of a simplex
AGAIN = 3  # simplices at most, each from where the last one ended and to the other side
ENOUGH = 0.5  # of -2 log likelihood: a simplex that gains less was the last


def around(here: Place) -> Place:
    """The likeliest place that a simplex finds from here; here itself if it finds nothing better."""
    nf = len(here.q.free)
    edges = np.where(np.arange(len(here.coordinates)) < nf, *REACH)
    for number in range(AGAIN):
        corner = here.coordinates
        corners = np.vstack([corner, corner + (-1.0) ** number * np.diag(edges)])
        found = minimize(
            partial(_score, here),
            corner,
            method="Nelder-Mead",
            options={
                "initial_simplex": corners,
                "maxfev": EVALUATIONS,
                "xatol": 1e-3,
                "fatol": 0.1,
                "adaptive": True,
            },
        )
        if not found.fun < here.score - ENOUGH:
            break
        here = _at(here, found.x)
    return here


def _at(here: Place, coordinates: Array) -> Place:
    """The place at free parameters in typical sizes and log levels, within the bounds."""
    q, nf, p = here.q, len(here.q.free), here.p.copy()
    p[list(q.free)] = np.clip(coordinates[:nf] * q.typical, q.low, q.high)
    return Place(q, p, replace(here.noise, levels=np.clip(coordinates[nf:], *LEVELS)))


def _score(here: Place, coordinates: Array) -> float:
    try:
        return _at(here, coordinates).score
    except SolveError:
        return math.inf
