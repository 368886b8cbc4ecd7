"""Readings beyond the plant's range: a wrong zero, a wrong unit, or a wrong stroke."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from optid.core.model import Model
from optid.core.quantity import quantity
from optid.core.recording import Recording
from optid.errors import PlantError
from optid.quality.remark import Remark

_LEEWAY = 0.05  # of the range: tolerance for the stated stroke and elastic end stops
_FEW = 0.1  # per cent of the samples at each end that are ignored: outliers have their own remarks


def reach(recording: Recording, model: Model, parameters: Mapping[str, float] | None) -> Iterator[Remark]:
    """Remarks on outputs that exceed the range given by the plant's parameters.

    Args:
        recording: as read.
        model: states the range of some of its outputs.
        parameters: SI values by name; without them nothing is checked.
    """
    if parameters is None or not model.reach:
        return
    known = {q.name for q in model.parameters}
    try:
        p = model.vector({name: value for name, value in parameters.items() if name in known})
    except PlantError:
        return
    for role, limits in model.reach.items():
        values = recording[role].values if role in recording else np.empty(0)
        values = values[np.isfinite(values)]
        if not len(values):
            continue
        low, high = (float(end) for end in np.array(limits(p)).ravel())
        least, most = np.percentile(values, (_FEW, 100 - _FEW))
        if max(low - least, most - high) <= _LEEWAY * (high - low):
            continue
        unit = next(port.unit for port in model.outputs if port.role == role)
        fits = most - least <= (1 + _LEEWAY) * (high - low)
        cure = (
            f"is its zero at mid-stroke (channels.{role}: offset)"
            if fits
            else "are its unit and the stroke right"
        )
        seen, can = (f"{quantity(a, unit)} to {quantity(b, unit)}" for a, b in ((least, most), (low, high)))
        yield Remark("reach", "error", role, f"{role} goes from {seen}, where the rig has {can}: {cure}?")
