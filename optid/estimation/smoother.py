"""Multiple shooting with soft continuity: the states at all nodes and the free parameters, together.

Minimises  sum ((y - h) / sd)^2 + sum ((X_next - F(X)) / q)^2 + priors  by Gauss-Newton with Levenberg-Marquardt
damping. q, the process noise at a node, is annealed by the caller from large to small. The normal matrix is
block tridiagonal in the states with a border for the parameters: a banded Cholesky factor and a small Schur
complement solve it in time linear in the record (Ribeiro et al. 2020 on why shooting must be multiple).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import LinAlgError, cho_solve, cho_solve_banded, cholesky_banded

from optid.core.gauss_newton_kernels import normal_equations
from optid.core.jit import compiled
from optid.core.llvm_simd import LANES
from optid.core.model import Array, Model
from optid.core.threads import parallel_for
from optid.errors import SolveError
from optid.estimation.problem import Booleans, Problem

# Relative decrease of the cost that ends a descent: of one that goes on at another level of process noise, and of the
# last one.
PASSING, PRECISE = 1e-4, 1e-6
ENOUGH = 50  # iterations: a fit that needs more does not converge
TRUSTED = 1e-3  # damping up to which a step's predicted gain equals that of the undamped step
# Damping beyond which no step is tried: where an axis breaks away at another time, states alone need a hundred.
LARGEST_DAMPING = 1e8


@dataclass(frozen=True, eq=False)
class Objective:
    """The objective, apart from the process noise.

    Attributes:
        free: indices of the fitted parameters in p.
        low, high: their bounds; `typical`: their sizes; `prior`: means; `prior_sd`: infinity for none.
        weight: 1/sd of each sample, (samples, outputs).
        start, spread: mean and sd of the state at the head of every segment.
        huber: residual (in sd) beyond which the loss grows linearly.
    """

    model: Model
    problem: Problem
    free: tuple[int, ...]
    low: Array
    high: Array
    typical: Array
    prior: Array
    prior_sd: Array
    weight: Array
    start: Array
    spread: Array
    huber: float
    tolerance: float

    @property
    def heads(self) -> Array:
        """Windows at which a segment begins, as 1.0, else 0.0; shape (windows,)."""
        return np.asarray(np.r_[1.0, self.problem.closed[:-1]], dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Terms:
    """One linearisation: window ends, slopes, normal matrices, and the parts of the cost."""

    end: Array
    slope: Array
    H: Array
    g: Array
    misfit: Array  # (windows, 2): loss and number of samples
    defect: Array  # (windows, states): next node minus end of window; 0 where nothing is linked
    cost: float


@dataclass(frozen=True, eq=False)
class Point:
    """A point of the iteration: node states (windows, states) and the whole parameter vector."""

    X: Array
    p: Array


@dataclass(frozen=True, eq=False)
class System:
    """The factored normal equations in scaled variables: Z = A_xx^-1 B and the Schur complement of theta."""

    factor: Array
    Z: Array
    schur: Array
    rhs_x: Array
    rhs_theta: Array
    step_x: Array  # A_xx^-1 rhs_x


def evaluate(o: Objective, at: Point, q: Array) -> Terms:
    """The linearisation at a point, and its cost with process noise `q` (states,)."""
    machine, b = compiled(o.model, o.free), o.problem
    w, nx, nd, room = len(b.begins), len(o.model.states), machine.directions, machine.width
    end, slope = np.empty((w, nx)), np.empty((w, nx, room))
    H, g, misfit = np.empty((w, nd, room)), np.empty((w, room)), np.empty((w, 2))
    given = (b.begins, b.counts, b.closed, at.X, at.p, b.dt, b.inputs, b.measured, o.weight, o.huber)
    found = (o.tolerance * o.model.scales, end, slope, H, g, misfit)
    parallel_for(w, lambda i, j: machine.run(normal_equations, i, j, *given, *found), LANES)
    defect = np.zeros((w, nx))
    defect[:-1] = (at.X[1:] - end[:-1]) * b.linked[:-1, None]
    terms = Terms(end, slope[:, :, :nd], H[:, :, :nd], g[:, :nd], misfit, defect, math.nan)
    return priced(o, at, terms, q)


def priced(o: Objective, at: Point, t: Terms, q: Array) -> Terms:
    """The same linearisation with its cost at process noise `q`, the only part that depends on it."""
    theta = at.p[list(o.free)]
    cost = (
        float(t.misfit[:, 0].sum())
        + float(((t.defect / q) ** 2).sum())
        + float((((at.X - o.start) / o.spread) ** 2).sum(axis=1) @ o.heads)
        + float((((theta - o.prior) / o.prior_sd) ** 2).sum())
    )
    known = math.isfinite(cost) and bool(np.isfinite(t.H).all())  # a cost without slopes gives no step
    return replace(t, cost=cost if known else math.inf)


def system(o: Objective, at: Point, t: Terms, q: Array, damping: float, held: Booleans) -> System:
    """Assemble and factor the normal equations; `held` parameters (bool) are fixed.

    Raises:
        LinAlgError: not positive definite (damping too small).
    """
    nx, nf = len(o.model.states), len(o.free)
    w = len(t.end)
    D, theta_scale = o.model.scales, o.typical * ~held
    linked = o.problem.linked.astype(float)
    Q = 1.0 / q**2
    Fx, Ft = t.slope[:, :, :nx], t.slope[:, :, nx:]
    QFx = Q[:, None] * Fx * linked[:, None, None]
    QFt = Q[:, None] * Ft * linked[:, None, None]
    diagonal = t.H[:, :nx, :nx] + np.einsum("wki,wkj->wij", Fx, QFx)
    index = np.arange(nx)
    diagonal[1:, index, index] += Q * linked[:-1, None]
    diagonal[:, index, index] += o.heads[:, None] / o.spread**2
    border = t.H[:, :nx, nx:] + np.einsum("wki,wkj->wij", Fx, QFt)
    border[1:] -= QFt[:-1]
    corner = t.H[:, nx:, nx:].sum(axis=0) + np.einsum("wki,wkj->ij", Ft, QFt) + np.diag(1 / o.prior_sd**2)
    Qd = Q * t.defect
    rhs_x = t.g[:, :nx] + np.einsum("wki,wk->wi", Fx, Qd)
    rhs_x[1:] -= Qd[:-1]
    rhs_x -= o.heads[:, None] * (at.X - o.start) / o.spread**2
    rhs_t = t.g[:, nx:].sum(axis=0) + np.einsum("wki,wk->i", Ft, Qd)
    rhs_t -= (at.p[list(o.free)] - o.prior) / o.prior_sd**2

    diagonal *= D[:, None] * D
    off = -QFx[:-1] * D[:, None] * D
    bands = np.zeros((2 * nx, w * nx))
    for i in range(nx):
        for j in range(nx):
            if i >= j:
                bands[i - j, j::nx] = diagonal[:, i, j]
            bands[nx + i - j, j : (w - 1) * nx : nx] = off[:, i, j]
    bands[0] *= 1.0 + damping
    factor = cholesky_banded(bands, lower=True)
    B = (border * D[:, None] * theta_scale).reshape(w * nx, nf)
    b = (rhs_x * D).ravel()
    solved = cho_solve_banded((factor, True), np.column_stack([B, b]))
    Z, step_x = solved[:, :nf], solved[:, nf]
    C = corner * np.outer(theta_scale, theta_scale)
    C[np.diag_indices(nf)] *= 1.0 + damping
    return System(factor, Z, C - B.T @ Z, b, rhs_t * theta_scale - B.T @ step_x, step_x)


def settled_system(o: Objective, at: Point, t: Terms, q: Array, held: Booleans) -> System:
    """The undamped normal equations, with only as much damping as rounding requires.

    With little process noise the weights span ten decades and the last pivots are lost in rounding.

    Raises:
        SolveError: even strong damping does not make them positive definite.
    """
    for damping in (0.0, 1e-12, 1e-10, 1e-8, 1e-6):
        try:
            found = system(o, at, t, q, damping, held)
            np.linalg.cholesky(_firm(found.schur))
            return found
        except (LinAlgError, ValueError):
            continue
    raise SolveError("the normal equations are singular: free fewer parameters")


def _firm(schur: Array) -> Array:
    """With 1 on the diagonal where a parameter is fixed or has no influence, so that it does not move."""
    return schur + np.diag((np.diag(schur) == 0.0).astype(float))


def _step(o: Objective, at: Point, t: Terms, q: Array, damping: float) -> tuple[Point, float, float]:
    """The damped Gauss-Newton point within bounds, the largest scaled movement of parameters, the promised decrease.

    The predicted decrease is the linearisation's; it is negative where the matrix is not positive definite.
    """
    theta = at.p[list(o.free)]
    held = np.zeros(len(o.free), dtype=bool)
    delta = np.zeros(len(o.free))
    for _ in range(len(o.free) + 1):
        s = system(o, at, t, q, damping, held)
        delta = np.linalg.solve(_firm(s.schur), s.rhs_theta) * o.typical * ~held if len(o.free) else delta
        outward = ((theta <= o.low) & (delta < 0)) | ((theta >= o.high) & (delta > 0))
        if not (outward & ~held).any():
            break
        held |= outward
    moved = np.clip(theta + delta, o.low, o.high)
    p = at.p.copy()
    p[list(o.free)] = moved
    share = (moved - theta) / o.typical
    dX = (s.step_x - s.Z @ share).reshape(at.X.shape) * o.model.scales
    promise = float(s.rhs_x @ s.step_x + (2.0 * s.rhs_theta - s.schur @ share) @ share)
    return Point(at.X + dX, p), float(np.abs(np.r_[share, 0.0]).max()), promise


Watch = Callable[[int, float, Array], bool]  # iteration, cost, parameters -> whether to stop


def descend(
    o: Objective,
    at: Point,
    q: Array,
    *,
    precision: float,
    iterations: int = ENOUGH,
    terms: Terms | None = None,
    watch: Watch | None = None,
) -> tuple[Point, Terms, bool]:
    """Minimise at one level of process noise; `terms` is the linearisation at the start where it is known.

    Returns the point, its linearisation and whether the relative decrease of the cost fell below `precision`.
    A trial is evaluated with its slopes at once: most are accepted, and costs from the same integrator steps can be
    compared exactly.

    Raises:
        SolveError: the model cannot be simulated at the start.
    """
    terms = evaluate(o, at, q) if terms is None else priced(o, at, terms, q)
    if not math.isfinite(terms.cost):
        raise SolveError(
            "the simulation diverged at the start values (NaN or infinite); check them and their units"
        )
    damping = 1e-6
    for number in range(iterations):
        settled = stuck = refused = False
        enough = precision * max(terms.cost, 1.0)
        while True:
            try:
                trial, moved, promise = _step(o, at, terms, q, damping)
                # A refused step met a kink (a stop, a reversal): the gain predicted for shorter ones is what remains.
                if (refused or damping <= TRUSTED) and 0.0 <= promise <= 0.1 * enough and moved < 1e-2:
                    return at, terms, True
                found = evaluate(o, trial, q)
            except (LinAlgError, ValueError):  # not positive definite, or not finite
                found, moved, trial = replace(terms, cost=math.inf), math.inf, at
            if found.cost <= terms.cost * (1 + 1e-12):
                settled = terms.cost - found.cost <= enough and moved < 1e-2
                break
            reached = float(np.abs((trial.X - at.X) / o.model.scales).max())
            if damping > LARGEST_DAMPING or max(moved, reached) < 1e-12:
                stuck = True
                break
            refused, damping = True, max(damping * 10, 1e-4)
        if stuck:
            return at, terms, True  # no smaller cost within rounding
        at, terms = trial, found
        damping = damping if refused else max(damping / 10, 1e-9)  # the same step would be refused again
        stop = watch is not None and watch(number, terms.cost, at.p)
        if settled or stop:
            return at, terms, settled
    return at, terms, False


def solve_schur(s: System, right: Array) -> Array:
    """S^-1 right for a positive definite Schur complement."""
    return np.asarray(cho_solve((np.linalg.cholesky(s.schur), True), right))
