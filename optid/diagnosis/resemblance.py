"""Effects by their resemblance to the unknown signal at their site: where the parameters stand that are not bent.

A fit that lacks something bends its parameters to make up for it, and a search from there finds few laws. A signal that
may be anything takes over what is missing at its site; estimated with it, the parameters are their own again, and what
it turned out to be is what a law has to look like (regression of the estimated error, as in direct discrepancy models).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares

from optid.core.model import Array, Model
from optid.diagnosis.candidate import Candidate, Data
from optid.diagnosis.disturbance import Located, locate_at
from optid.diagnosis.law import Probe
from optid.diagnosis.screen import grown
from optid.effects.effect import Effect
from optid.estimation.place import Question
from optid.estimation.problem import Integers
from optid.rigs.rigfile import with_effects

# What is added to a reading moves the readings alone: held gains take it for motion, and lead astray.
KINDS = ("sensor",)
POINTS = 600  # of the signal, that a law is fitted to
FEW = 2  # branches of an effect that are
EVALUATIONS = 40
FAINT = 1e-3  # spreads that a typical size of a parameter counts as
AWAY = 1e3  # spreads: where a law leaves the numbers
# Of the signal's spread: deviations beyond it count by their logarithm, as the signal errs wildly now and then.
PLAIN = 0.1


def resembling(
    current: Candidate,
    effects: Sequence[Effect],
    data: Data,
    plain: Model,
    signals: Mapping[str, Located] | None = None,
) -> list[tuple[Effect, Question, Array]]:
    """Effects, each with its question and the parameters where it resembles the unknown signal at its site most.

    Of those at a site of KINDS whose law is a function of states, inputs and time alone.

    Args:
        current: the model that they come to.
        effects: to try.
        data: recordings.
        plain: the model as it came.
        signals: unknown ones by site that were estimated beside that model; only effects at these are tried then.
    """
    found = []
    for site in dict.fromkeys(effect.sites[0] for effect in effects if effect.site in KINDS):
        if data.over:
            break
        located = locate_at(current, data, site) if signals is None else signals.get(site)
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
    problem = question.problem
    rows = np.arange(0, len(problem.time), max(len(problem.time) // POINTS, 1))
    added, signal = _added(current, effect, question, located, rows), located.signal[rows]
    spread = 1.4826 * float(np.median(np.abs(signal - np.median(signal))))
    if added is None or not spread > 0.0:
        return None
    owner = np.repeat(problem.recording, problem.counts + 1)[rows]
    recordings = [owner == one for one in np.unique(owner)]

    typical = np.array([q.typical for q in effect.fitted])
    null = np.array([effect.at_null()[q.name] for q in effect.fitted])

    def off(values: Array) -> Array:
        """What the law misses of the signal, in its spread, but for a constant in each recording; then its parameters.

        A walk that begins at nothing stays behind by as much as nobody knows of the start. What neither it nor the rest
        of the signal tells stays about where there is no effect.
        """
        missed = np.nan_to_num((added(values) - signal) / spread, nan=AWAY)
        for own in recordings:
            missed[own] -= np.median(missed[own])
        return np.concatenate([missed, FAINT * (values - null) / typical])

    def loss(values: Array) -> float:
        return float(np.log1p((off(values) / PLAIN) ** 2).sum())

    low, high = np.array([q.bounds for q in effect.fitted]).T
    inside = np.nan_to_num(1e-6 * (high - low), posinf=0.0)
    tries = [{**effect.at_null(), **one} for one in effect.usual]
    starts = [np.array([one[q.name] for q in effect.fitted]) for one in tries]
    ends = [
        least_squares(
            off, np.clip(start, low + inside, high - inside), bounds=(low, high), loss="cauchy", f_scale=PLAIN,
            x_scale=typical, max_nfev=EVALUATIONS,
        ).x
        for start in sorted(starts, key=loss)[:FEW]
    ]  # fmt: skip
    return dict(zip((q.name for q in effect.fitted), min(ends, key=loss).tolist(), strict=True))


def _added(
    current: Candidate, effect: Effect, question: Question, located: Located, rows: Integers
) -> Callable[[Array], Array] | None:
    """What the law adds to its site at these samples, given its parameters in SI; ``None`` if it has a memory."""
    site, answer = located.site, located.answer
    model = with_effects(current.rig, (Probe("before", site), effect, Probe("after", site)), {}).model
    own = answer.question.model
    known = [state.name for state in own.states]
    if not {state.name for state in model.states} <= set(known):
        return None
    columns = np.array([known.index(state.name) for state in model.states])
    X, U = answer.filtered.states[0][np.ix_(rows, columns)].T, question.problem.inputs[rows].T
    names = {q.name for q in model.parameters}
    stands = zip((q.name for q in own.parameters), answer.p.tolist(), strict=True)
    p = model.vector({name: value for name, value in stands if name in names})
    mine = [model.index(f"{effect.name}.{q.name}") for q in effect.fitted]
    roles, shown = [port.role for port in model.outputs], model.sensors.map(len(rows))

    def added(values: Array) -> Array:
        p[mine] = values
        out = np.array(shown(X, U, p))
        return np.asarray(out[roles.index("after")] - out[roles.index("before")])

    return added
