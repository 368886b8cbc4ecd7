"""Activity of an effect at each sample: its change of the plant's rates and outputs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from optid.core.model import Array
from optid.core.sheet import Sheet
from optid.diagnosis.localisation.instrument import Instrument
from optid.diagnosis.localisation.region import by_usual_size
from optid.diagnosis.refinement import RefinedModel
from optid.effects.effect import Effect
from optid.rigs.rigfile import with_effects

DUST = 1e-9  # of a rate or output: rounding left by an effect that does nothing


class Taken(Instrument):
    """Records the signal at each of an effect's sites before the effect changes it."""

    def __init__(self, sites: tuple[str, ...]) -> None:
        self.name, self.sites, self.signal = "taken", sites, None

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The unchanged signal."""
        self.signal = nominal
        return nominal


class Bypass(Instrument):
    """Restores the recorded signal: the effect runs in parallel and does not act on the plant."""

    def __init__(self, taken: Taken) -> None:
        self.name, self.sites, self.taken = "bypass", taken.sites, taken

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal before the effect."""
        return self.taken.signal


def effect_activity(base: RefinedModel, best: RefinedModel, effect: Effect) -> Array:
    """The change by an effect at each sample, relative to usual sizes, (samples,).

    The plant's rates with the effect and with a bypass around it, at the filter's states, each relative to the usual
    size of its state; likewise the outputs, relative to their noise. An effect on both is active where it changes
    either.

    Args:
        base: the model without the effects that were found.
        best: the model with them, and the filter's states.
        effect: one of them.
    """
    taken = Taken(effect.sites)
    around = [(taken, one, Bypass(taken)) if one is effect else (one,) for one in best.effects]
    rig = with_effects(base.rig, (part for parts in around for part in parts), {})
    answer, own, model = best.fit, best.rig.model, rig.model
    X, U = answer.filtered.states[0], answer.likelihood_problem.problem.inputs
    states, names = [s.name for s in own.states], [s.name for s in model.states]
    order = [states.index(name) for name in names]
    p = model.vector_from(own, answer.p, rig.parameters)
    plant = [k for k, name in enumerate(names) if not name.startswith(f"{effect.name}.")]
    rates = _beyond(
        np.array(own.rates.map(len(X))(X.T, U.T, answer.p))[order], model.rates, X[:, order], U, p
    )
    readings = _beyond(
        np.array(own.sensors.map(len(X))(X.T, U.T, answer.p)), model.sensors, X[:, order], U, p
    )
    return by_usual_size(
        np.linalg.norm((rates / model.scales[:, None])[plant], axis=0),
        np.linalg.norm(readings / np.sqrt(answer.noise.measurement)[:, None], axis=0),
    )


def _beyond(whole: Array, without: ca.Function, X: Array, U: Array, p: Array) -> Array:
    """The difference to the model without it, beyond rounding."""
    more = whole - np.array(without.map(len(X))(X.T, U.T, p))
    return np.where(np.abs(more) > DUST * np.abs(whole), more, 0.0)
