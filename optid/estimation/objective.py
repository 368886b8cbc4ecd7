"""The objective of a fit: data, weights, bounds and priors from the rig file and the recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from optid.core.model import Array, Model
from optid.core.parameter import Parameter
from optid.estimation.problem import Problem
from optid.estimation.smoother import Objective
from optid.quality.noise import colour, information_factor, noise_sd
from optid.rigs.rigfile import Freed, Rig

# Local error of the integration as a share of each state's usual size: 0.01 micrometre of position, and a cost
# that is smooth to 0.001; at 1e-5 its roughness of about 1 keeps the last iterations busy and saves no time.
SOLVER = 1e-6


def with_nuisance_parameters(rig: Rig, *, by_filter: bool = False) -> tuple[Freed, ...]:
    """Parameters to fit: the rig's [fit] table, and nuisance parameters of the plant that the file does not state.

    `by_filter` adds those that only a filter can fit.
    """
    stated = {f.name for f in rig.freed} | set(rig.parameters)
    return (
        *rig.freed,
        *(
            Freed(one.name, max(one.bounds[0], n.low), min(one.bounds[1], n.high), n.sd)
            for one in rig.model.parameters
            if (n := one.nuisance) is not None and one.name not in stated and (by_filter or not n.by_filter)
        ),
    )


def physical_bounds(model: Model, free: Sequence[int], low: Array) -> Array:
    """Lower bounds, (free,), with those that keep searches of nuisance parameters quick replaced by the physical ones.

    True stiction drives the elastic motion before sliding to its bound, which biases the other parameters in proportion
    (viscous friction by 0.1 % at 2 um, the inertia of an arm by 0.3 % at 20 urad).
    """
    parameters = [model.parameters[i] for i in free]
    quick = [
        one.nuisance is not None and one.nuisance.low == at for one, at in zip(parameters, low, strict=True)
    ]
    return np.where(quick, [one.bounds[0] for one in parameters], low)


def objective_of(
    rig: Rig, freed: tuple[Freed, ...], problem: Problem, huber: float = math.inf
) -> tuple[Objective, Array]:
    """The objective of a fit of `freed`, and the parameter vector of the rig's own values."""
    model, p = rig.model, rig.model.vector(rig.parameters)
    free = tuple(model.index(f.name) for f in freed)
    weight = np.ones_like(problem.measured)
    for j, port in enumerate(model.outputs):
        weight[:, j] = 1.0 / _sd(rig, problem, j, port.role)
    mean, spread = (np.array(a).ravel() for a in model.start(p))
    sd = np.array([f.sd if f.sd else math.inf for f in freed])
    objective = Objective(
        model,
        problem,
        free,
        np.array([f.low for f in freed]),
        np.array([f.high for f in freed]),
        np.array([_size(model.parameters[i], p[i]) for i in free]),
        p[list(free)],
        sd,
        weight,
        mean,
        spread,
        huber,
        SOLVER,
    )
    return objective, p


def _size(parameter: Parameter, value: float) -> float:
    """A parameter's usual size, which scales the steps of searches."""
    n = parameter.nuisance
    return parameter.typical if n is not None and n.by_filter else abs(value) or parameter.typical


def _sd(rig: Rig, problem: Problem, output: int, role: str) -> float:
    """Sd of white noise with the same information on slow motion as the output's own noise, which may be coloured."""
    y = problem.measured[:, output]
    y = y[np.isfinite(y)]
    if not len(y):
        return 1.0
    channel = rig.channels.get(role)
    stated = None if channel is None else channel.sd
    floor = 1e-6 * max(float(np.std(y)), 1e-12)
    found = stated or noise_sd(y)
    found = max(found, floor) if math.isfinite(found) else floor
    known = None if channel is None else channel.colour
    return found * math.sqrt(information_factor(colour(y) if known is None else known))
