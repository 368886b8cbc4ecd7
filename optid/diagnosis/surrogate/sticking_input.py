"""An input that sticks, in place of a named effect of that input that leaves more than the noise.

What sticks passes for hysteresis or a dead band, and no law of the catalogue is a jump. Predictions change with the
width of the jumps by steps, so that no slope leads to it: it is searched on grids that become finer, and all other
parameters are fitted in between. A decimated input jumps at other times, as a less accurate latch does: this goes by
the recordings' own rate and accuracy.
"""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np

from optid.core.model import Array
from optid.diagnosis.alternatives import is_told_apart
from optid.diagnosis.base_fit import with_open_variance
from optid.diagnosis.fitted import FittedModel, fit_model, refit
from optid.diagnosis.problem import DiagnosisProblem, Stage, with_effect
from optid.diagnosis.selection.path import Contender, SelectionPath
from optid.diagnosis.surrogate.library import sticking
from optid.diagnosis.validation import cross_validate
from optid.effects.sticking import WIDTHS, Sticking
from optid.errors import SolveError
from optid.estimation.fixed_gain import innovations
from optid.estimation.likelihood import huber
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.multistep import window_starts

# Widths of a grid, and by which factor it reaches beyond the last one to either side; the last spacing is 0.1 %.
GRID, REACHES = 96, (1.4, 1.2, 1.1, 1.05)


def find_sticking_input(
    path: SelectionPath, search: DiagnosisProblem, problem: DiagnosisProblem
) -> Contender | None:
    """The path's model with a sticking input in place of the first effect that this predicts better than.

    Args:
        path: of the selection, with errors of the search.
        search: its problem.
        problem: the recordings at their own rate.
    """
    if path.validated.error_over_noise <= search.criteria.error_over_noise:
        return None
    full = search
    if search.train is not problem.train or search.tolerance != problem.tolerance:
        full = replace(with_open_variance(problem, path.base), budget=search.budget)
    for effect in path.best.effects:
        for form in sticking(path.base, effect.sites):
            search.report(Stage.SURROGATE, f"an input that sticks, in place of {effect.name}")
            with contextlib.suppress(SolveError):
                named, less = refit(path.best, full), refit(path.without[effect.name][0], full)
                model = _fit_width(form, less, named.fit.loss, full)
                if model is None:
                    continue
                before, validated = cross_validate(named, full), cross_validate(model, full)
                if is_told_apart(before, validated, full):
                    return Contender(form, model, validated, "")
    return None


def _fit_width(
    form: Sticking, less: FittedModel, most: float, problem: DiagnosisProblem
) -> FittedModel | None:
    """The model with the form at its best width; ``None`` where the first fit is not near a loss."""
    q, o = problem.likelihood_problem(with_effect(less.rig, form)), problem.options
    p = q.at({**less.values, **form.qualified(form.at_null())})
    grid = np.geomspace(WIDTHS[0], WIDTHS[-1], GRID)
    p = _search_width(q, p, form, grid, less, o.short * problem.window)
    best: FittedModel | None = None
    for reach in REACHES:
        model = fit_model(problem, (*less.effects, form), q.rig, q, p)
        if model.fit.loss > o.near * most or problem.budget.is_over:
            break
        best = model if best is None else min(best, model, key=lambda one: one.fit.loss)
        width = best.own_values(form)["width"]
        p = _search_width(q, best.p, form, width * np.geomspace(1 / reach, reach, GRID), best, problem.window)
    return best


def _search_width(
    q: LikelihoodProblem, p: Array, form: Sticking, widths: Array, by: FittedModel, seconds: float
) -> Array:
    """The parameters with the width, of some, that predicts best with the gains of a model's filter."""
    P = np.tile(p, (len(widths), 1))
    P[:, q.model.index(f"{form.name}.width")] = widths
    resets = window_starts(q.problem, seconds)
    z = innovations(q, P, by.rig.model, by.fit.filtered, resets=resets)
    return np.asarray(P[np.argmin(huber(z).sum(axis=1))])
