"""The stages of a diagnosis as documents of a checkpoint.

Models are restored by running their filter at the stored parameters, so that the answer is the same as without an
interruption.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.cache import sources
from optid.core.checkpoint import equations
from optid.core.model import Array, Model
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.problem import DiagnosisProblem, with_effect
from optid.diagnosis.proposals import Proposal, Proposals
from optid.diagnosis.selection.path import Contender, Round, SelectionPath
from optid.diagnosis.validation import Validated
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.estimation.multistep import multistep_at
from optid.rigs.rigfile import with_effects


def key_of(problem: DiagnosisProblem) -> str:
    """A digest of everything on which the stages depend.

    These are the rig's values, bounds and equations, the user's effects by their action on them, the recordings with
    their noise, the criteria, and optid's own code.
    """
    rig = problem.rig
    freed = [(f.name, f.low, f.high, f.sd) for f in rig.freed]
    facts = (
        sources(str(Path(__file__).with_name("pipeline.py"))),
        rig.model_name,
        sorted(rig.parameters.items()),
        freed,
        [[getattr(effect, name, None) for name in Effect.__annotations__] for effect in problem.own],
        problem.validation,
        problem.criteria,
        problem.options,
        sorted(problem.noise.items()),
    )
    digest = hashlib.sha256(repr(facts).encode())
    for model in (problem.plain, *_with_each(problem)):
        digest.update(equations(model))
    for one in problem.train:
        digest.update(one.name.encode() + one.time.tobytes())
        for role, channel in sorted(one.channels.items()):
            digest.update(role.encode() + np.ascontiguousarray(channel.values).tobytes())
    return digest.hexdigest()


def _with_each(problem: DiagnosisProblem) -> Iterator[Model]:
    """The plant with each effect of the user's that it can take; the search builds the same."""
    names = {effect.name for effect in problem.own}
    for effect in admitted(problem.plain, problem.own):
        if effect.name in names:
            yield with_effect(problem.rig, effect).model


def base_document(base: FittedModel, problem: DiagnosisProblem) -> dict[str, Any]:
    """Of the base fit."""
    assert problem.open_variance is not None
    return {"model": _model(base), "open_variance": problem.open_variance.tolist()}


def base_from(document: Mapping[str, Any], problem: DiagnosisProblem) -> tuple[FittedModel, DiagnosisProblem]:
    """The base fit that a document holds."""
    problem = replace(problem, open_variance=np.array(document["open_variance"]))
    return _Reader(problem).model(document["model"]), problem


def path_document(path: SelectionPath) -> dict[str, Any]:
    """Of a selection."""
    return {
        "base": _model(path.base),
        "best": _model(path.best),
        "first": _errors(path.first),
        "validated": _errors(path.validated),
        "rounds": [_round(one) for one in path.rounds],
        "without": {name: [_model(m), _errors(v)] for name, (m, v) in path.without.items()},
        "dropped": [[effect.name, why] for effect, why in path.dropped],
        "ended_early": path.ended_early,
    }


def path_from(document: Mapping[str, Any], problem: DiagnosisProblem) -> SelectionPath:
    """The selection that a document holds."""
    read = _Reader(problem)
    return SelectionPath(
        read.model(document["base"]),
        read.model(document["best"]),
        _errors_from(document["first"]),
        _errors_from(document["validated"]),
        tuple(read.round(one) for one in document["rounds"]),
        {name: (read.model(m), _errors_from(v)) for name, (m, v) in document["without"].items()},
        tuple((read.effects[name], why) for name, why in document["dropped"]),
        document["ended_early"],
    )


def _model(one: FittedModel) -> dict[str, Any]:
    return {"effects": [e.name for e in one.effects], "p": one.p.tolist(), "level": one.fit.level}


def _errors(one: Validated) -> dict[str, Any]:
    rows = [[None if np.isnan(x) else float(x) for x in row] for row in one.squares]
    return {"squares": rows, "factors": np.ravel(one.factors).tolist()}


def _errors_from(document: Mapping[str, Any]) -> Validated:
    rows = np.array([[np.nan if x is None else x for x in row] for row in document["squares"]])
    return Validated(rows, np.array(document["factors"]))


def _round(one: Round) -> dict[str, Any]:
    return {
        "model": _model(one.model),
        "ranked": [[p.effect.name, p.p.tolist(), p.loss] for p in one.proposals.ranked],
        "alone": one.proposals.alone,
        "visible": dict(one.proposals.visible),
        "contenders": [
            {"effect": c.effect.name, "model": _model(c.model), "errors": _errors(c.validated), "why": c.why}
            for c in one.contenders
        ],
        "taken": None if one.taken is None else one.contenders.index(one.taken),
    }


class _Reader:
    """Restores the models of a document, each once."""

    def __init__(self, problem: DiagnosisProblem) -> None:
        self.problem = problem
        self.effects: dict[str, Effect] = {e.name: e for e in admitted(problem.plain, problem.own)}
        self._models: dict[str, FittedModel] = {}

    def model(self, document: Mapping[str, Any]) -> FittedModel:
        key = json.dumps(document)
        if key not in self._models:
            effects = tuple(self.effects[name] for name in document["effects"])
            rig = with_effects(self.problem.rig, effects, {}) if effects else self.problem.rig
            q = self.problem.likelihood_problem(rig)
            p: Array = np.array(document["p"])
            fit = multistep_at(q, p, self.problem.window, document["level"])
            self._models[key] = FittedModel(effects, rig, fit)
        return self._models[key]

    def round(self, document: Mapping[str, Any]) -> Round:
        current = self.model(document["model"])
        ranked = []
        for name, p, loss in document["ranked"]:
            q = self.problem.likelihood_problem(with_effects(current.rig, (self.effects[name],), {}))
            ranked.append(Proposal(self.effects[name], q, np.array(p), loss))
        contenders = tuple(
            Contender(self.effects[c["effect"]], self.model(c["model"]), _errors_from(c["errors"]), c["why"])
            for c in document["contenders"]
        )
        taken = None if document["taken"] is None else contenders[document["taken"]]
        proposals = Proposals(tuple(ranked), document["visible"], document["alone"])
        return Round(current, proposals, contenders, taken)
