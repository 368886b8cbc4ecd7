"""Effects by their resemblance to the unknown signal at their site: where the parameters stand that are not bent.

A fit that lacks something bends its parameters to make up for it, and a search from there finds few laws. A signal that
may be anything takes over what is missing at its site; estimated with it, the parameters are their own again, and what
it turned out to be is what a law has to look like (regression of the estimated error, as in direct discrepancy models).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from optid.core.model import Array, Model
from optid.diagnose.candidate import Candidate, Data
from optid.diagnose.disturbance import Located, locate_at
from optid.diagnose.law import Probe
from optid.diagnose.screen import grown
from optid.effects.effect import Effect
from optid.errors import OptidError
from optid.fit.place import Question
from optid.rigs.rigfile import with_effects

# What is added to a reading moves the readings alone: held gains take it for motion, and lead astray.
KINDS = ("sensor",)
POINTS = 600  # of the signal, that a law is fitted to
FEW = 2  # branches of an effect that are
EVALUATIONS = 40
AWAY = 1e3  # spreads: where a law leaves the numbers
# Of the signal's spread: deviations beyond it count by their logarithm, as the signal errs wildly now and then.
PLAIN = 0.1


def resembling(
    current: Candidate, effects: Sequence[Effect], data: Data, plain: Model
) -> list[tuple[Effect, Question, Array]]:
    """Effects, each with its question and the parameters where it resembles the unknown signal at its site most.

    Of those at a site of KINDS whose law is a function of states, inputs and time alone.

    Args:
        current: the model that they come to.
        effects: to try.
        data: recordings.
        plain: the model as it came.
    """
    found = []
    for site in dict.fromkeys(effect.sites[0] for effect in effects if effect.site in KINDS):
        if data.over:
            break
        located = locate_at(current, data, site)
        if located is None:
            continue
        for effect in effects:
            if effect.sites != (site,):
                continue
            question = data.question(grown(current.rig, effect), plain)
            values = _regressed(current, effect, question, located)
            if values is not None:
                names = [parameter.name for parameter in located.answer.question.model.parameters]
                stands = dict(zip(names, located.answer.p.tolist(), strict=True))
                found.append((effect, question, question.at({**stands, **effect.qualified(values)})))
    return found


def _regressed(
    current: Candidate, effect: Effect, question: Question, located: Located
) -> dict[str, float] | None:
    """Its parameters by own name; ``None`` for a law with a memory of its own."""
    site, answer = located.site, located.answer
    try:
        rig = with_effects(current.rig, (Probe("before", site), effect, Probe("after", site)), {})
    except OptidError:
        return None
    model, own = rig.model, answer.question.model
    known = [state.name for state in own.states]
    if not {state.name for state in model.states} <= set(known):
        return None
    problem = question.problem
    rows = np.arange(0, len(problem.time), max(len(problem.time) // POINTS, 1))
    owner = np.repeat(problem.recording, problem.counts + 1)[rows]
    own_rows = [owner == recording for recording in np.unique(owner)]
    X = answer.filtered.states[0][np.ix_(rows, [known.index(state.name) for state in model.states])].T
    U, signal = problem.inputs[rows].T, located.signal[rows]
    roles = [port.role for port in model.outputs]
    after, before, shown = roles.index("after"), roles.index("before"), model.sensors.map(len(rows))
    stands = dict(zip((q.name for q in own.parameters), answer.p.tolist(), strict=True))
    names = {q.name for q in model.parameters}
    p = model.vector({name: value for name, value in stands.items() if name in names})
    mine = np.array([model.index(f"{effect.name}.{q.name}") for q in effect.parameters])
    typical = np.array([q.typical for q in effect.parameters])
    low, high = np.array([q.bounds for q in effect.parameters]).T / typical
    spread = 1.4826 * float(np.median(np.abs(signal - np.median(signal))))
    if not spread > 0.0:
        return None

    def off(theta: Array) -> Array:
        """What the law misses of the signal, in its spread, but for a constant in each recording."""
        p[mine] = theta * typical
        values = np.array(shown(X, U, p))
        missed = np.nan_to_num((values[after] - values[before] - signal) / spread, nan=AWAY)
        for (
            one
        ) in own_rows:  # a walk that begins at nothing is late by as much as it does not know of the start
            missed[one] -= np.median(missed[one])
        return np.asarray(missed)

    def loss(theta: Array) -> float:
        return float(np.log1p((off(theta) / PLAIN) ** 2).sum())

    points = [{**effect.at_null(), **one} for one in effect.usual]
    starts = [np.array([one[q.name] for q in effect.parameters]) / typical for one in points]
    best: list[Array] = []
    for start in sorted(starts, key=loss)[:FEW]:
        inside = np.clip(start, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        fit = least_squares(
            off, inside, bounds=(low, high), loss="cauchy", f_scale=PLAIN, x_scale="jac", max_nfev=EVALUATIONS
        )
        best.append(fit.x)
    values = min(best, key=loss) * typical
    return dict(zip((q.name for q in effect.parameters), values.tolist(), strict=True))
