"""The change of a site's signal by named effects, sample by sample, for comparison with the unknown input there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from optid.core.model import Array
from optid.core.sheet import Sheet
from optid.diagnosis.localisation.instrument import Instrument
from optid.diagnosis.refinement import RefinedModel
from optid.errors import InputError
from optid.rigs.rigfile import with_effects


class Probe(Instrument):
    """Adds the signal at a site as an output, without changing it."""

    def __init__(self, name: str, site: str) -> None:
        self.name, self.sites = name, (site,)

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The unchanged signal."""
        sheet.output(self.name, "1", nominal)
        return nominal


def effect_signal_at(base: RefinedModel, best: RefinedModel, site: str) -> Array | None:
    """The best model's effects on a site's signal along the recordings, SI, (samples,).

    ``None`` at a site that the equations pass more than once, as "flow.ratio" of every port, where there is no single
    signal.

    Args:
        base: the model without them.
        best: their fitted values, and the filter's states.
        site: of the plant, as "force.external".
    """
    try:
        rig = with_effects(base.rig, (Probe("before", site), *best.effects, Probe("after", site)), {})
    except InputError:  # declared twice
        return None
    model, own, answer = rig.model, best.rig.model, best.fit
    p = model.vector_from(own, answer.p, rig.parameters)
    names = [state.name for state in own.states]
    X = answer.filtered.states[0][:, [names.index(state.name) for state in model.states]]
    U = answer.likelihood_problem.problem.inputs
    roles = [port.role for port in model.outputs]
    shown = np.array(model.sensors.map(len(X))(X.T, U.T, p))
    return np.asarray(shown[roles.index("after")] - shown[roles.index("before")])
