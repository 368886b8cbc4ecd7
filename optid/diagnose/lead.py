"""Where effects lead from the values that the rig file states, under the gains of one filter.

A fitted model that lacks something large has bent its parameters to make up for it: no small change from there shows
what is missing, and searches that begin there end beside it. So effects are tried from where nothing is bent yet, all
parameters free, by a search that goes far and costs little because gains are held. What innovations each effect leaves
ranks it, and where it led is where its refit begins.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from optid.core.model import Array, Model
from optid.diagnose.candidate import QUICK, Candidate, Data
from optid.diagnose.screen import Signature, grown, heard
from optid.effects.effect import Effect
from optid.errors import SolveError
from optid.fit.likelihood import FAR, Noise
from optid.fit.place import NUDGES, Answer, Place, Question
from optid.fit.steering import Steered, innovations, steered_fit
from optid.rigs.rigfile import Rig

BRANCHES = 3  # of an effect, that are led at all
# The race: evaluations of each lead, how many go on, and how many of one effect.
RACE = ((3, 24, 2), (5, 8, 1), (QUICK, 8, 1))
WORTHY = 0.5  # of the best gain: what gains less is not worth a refit


@dataclass(frozen=True, eq=False)
class _Ground:
    """Where leads begin: parameters by name, and what the model without the effect can do there by itself.

    Attributes:
        values: of all parameters, by name.
        guide: whose gains hold.
        plain: the model as it came, whose states alone carry process noise.
        J: slopes of the scaled innovations by the free parameters, (measured, free).
        loss: least that the model reaches without an effect.
    """

    values: Mapping[str, float]
    guide: Answer
    plain: Model
    J: Array
    loss: float

    @classmethod
    def of(cls, current: Candidate, guide: Answer, plain: Model) -> Self:
        q = guide.question
        fitted = guide.p
        p = fitted if current.effects else q.model.vector(current.rig.parameters)
        starts = [fitted] if p is fitted else [p, fitted]
        led = [steered_fit(q, start, q.model, guide.filtered, QUICK) for start in starts]
        P = np.tile(p, (len(q.free) + 1, 1))
        steps = np.where(p[list(q.free)] + NUDGES[1] * q.typical > q.high, -NUDGES[1], NUDGES[1])
        P[range(1, len(P)), list(q.free)] += steps * q.typical
        here, *others = innovations(q, P, q.model, guide.filtered)
        values = dict(zip((one.name for one in q.model.parameters), p.tolist(), strict=True))
        return cls(
            values, guide, plain, ((np.array(others) - here) / steps[:, None]).T, min(one.loss for one in led)
        )

    def placed(self, question: Question, own: Mapping[str, float]) -> Array:
        """All parameters of a question with an effect's `own`, by qualified name."""
        model = question.model
        p = model.vector(question.rig.parameters)
        for name, value in {**self.values, **own}.items():
            low, high = model.parameters[model.index(name)].bounds
            p[model.index(name)] = min(max(value, low), high)
        return p

    def losses(self, question: Question, P: Array) -> Array:
        """What the free parameters' linear say leaves of the innovations, by Huber's weights, (sets,)."""
        found = np.empty(len(P))
        for k, z in enumerate(innovations(question, P, self.guide.question.model, self.guide.filtered)):
            root = np.sqrt(np.minimum(1.0, FAR / np.maximum(np.abs(z), 1e-12)))
            step = np.linalg.lstsq(self.J * root[:, None], -root * z, rcond=1e-9)[0]
            rest = np.abs(z + self.J @ step)
            found[k] = np.where(rest > FAR, FAR * (2.0 * rest - FAR), rest**2).sum()
        return found


@dataclass(frozen=True, eq=False)
class _Lead:
    """An effect on its way."""

    effect: Effect
    question: Question
    at: Steered

    @property
    def own(self) -> dict[str, float]:
        model = self.question.model
        return {
            q.name: float(self.at.p[model.index(f"{self.effect.name}.{q.name}")])
            for q in self.effect.parameters
        }

    def further(self, ground: _Ground, evaluations: int) -> Self:
        """The same, so many evaluations further; with infinite loss where the model leaves the numbers."""
        try:
            guide = ground.guide
            at = steered_fit(self.question, self.at.p, guide.question.model, guide.filtered, evaluations)
        except SolveError:
            at = Steered(self.at.p, math.inf)
        return replace(self, at=at)


def leads(
    current: Candidate, guide: Answer, effects: Iterable[Effect], data: Data, plain: Model
) -> list[Signature]:
    """What effects leave where they lead, the most promising first.

    Args:
        current: the model that they come to; without any effect yet they begin at the rig file's values.
        guide: of the same model, whose gains hold.
        effects: to try.
        data: recordings.
        plain: the model as it came.
    """
    ground = _Ground.of(current, guide, plain)
    running = [lead for effect in effects for lead in _begun(ground, current.rig, effect, data)]
    for evaluations, most, alike in RACE:
        running = _ahead([lead.further(ground, evaluations) for lead in running], most, alike)
    rows = int(np.isfinite(guide.filtered.innovations[0]).sum())
    signatures = []
    for lead in running:
        model, own = lead.question.model, lead.own
        beside = {name: float(lead.at.p[model.index(name)]) for name in ground.values}
        gain = rows * (1.0 - lead.at.loss / ground.loss)
        signatures.append(
            Signature(lead.effect, own, gain, np.zeros(0), lead.effect.size(own), np.inf, beside)
        )
    return [one for one in signatures if one.gain > WORTHY * signatures[0].gain and one.gain > 0.0]


def stood(current: Candidate, led: Signature, guide: Answer, data: Data, plain: Model) -> Answer | None:
    """A model with an effect where it led to, its states as quiet as the guide's; ``None`` if that is no model."""
    question = data.question(grown(current.rig, led.effect), plain)
    p = question.model.vector({**question.rig.parameters, **led.beside, **led.effect.qualified(led.values)})
    here = Place(question, p, Noise(question.measurement, question.groups, guide.noise.levels))
    if not math.isfinite(here.score):
        return None
    here.glance()
    return here.answer(False)


def _begun(ground: _Ground, rig: Rig, effect: Effect, data: Data) -> list[_Lead]:
    """The branches of an effect that promise most, where they begin."""
    question = data.question(grown(rig, effect), ground.plain)
    branches = [effect.qualified({**effect.at_null(), **one}) for one in effect.tries(*heard(ground.guide))]
    P = np.array([ground.placed(question, branch) for branch in branches])
    losses = ground.losses(question, P)
    return [_Lead(effect, question, Steered(P[k], float(losses[k]))) for k in np.argsort(losses)[:BRANCHES]]


def _ahead(running: list[_Lead], most: int, alike: int) -> list[_Lead]:
    """The best of a race, so many of one effect at most."""
    kept: list[_Lead] = []
    for lead in sorted(running, key=lambda one: one.at.loss):
        if len(kept) < most and sum(one.effect is lead.effect for one in kept) < alike:
            kept.append(lead)
    return kept
