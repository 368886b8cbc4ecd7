"""The sign of a model's response to its inputs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from optid.core.model import CLOCK, INTERVAL, Array, Model
from optid.core.recording import Recording
from optid.core.simulation import simulate
from optid.errors import PlantError

_SAMPLES = 400
_SECONDS = 0.4  # s of a step; an axis moves by then
_MIXED = 0.05  # of a response: more than this of the other sign, and it has none
_CLEAR = 1e-9  # of what an output can resolve: a smaller response has no sign


def signs(
    model: Model, parameters: Mapping[str, float] | None, recording: Recording
) -> dict[tuple[str, str], int]:
    """(input, output) -> sign of the answer to a step of the recorded size around the recorded mean, 0 where none.

    Args:
        model: the plant.
        parameters: SI values by name; without any the model's typical ones.
        recording: shows the inputs' size.
    """
    values = dict(parameters or {})
    for q in model.parameters:
        if q.name not in values and q.default is None:
            values[q.name] = q.typical
    try:
        p = model.vector({q.name: values[q.name] for q in model.parameters if q.name in values})
    except PlantError:
        return {}
    dt = np.full(_SAMPLES, max(_SECONDS, 20 * recording.interval) / _SAMPLES)
    start = np.array(model.start(p)[0]).ravel()
    means = {port.role: _mean(recording, port.role) for port in model.recorded}
    found: dict[tuple[str, str], int] = {}
    for cause in means:
        size = float(np.nanstd(recording[cause].values)) if cause in recording else 0.0
        if not size > 0:
            continue
        up, down = (
            simulate(
                model, p, start, dt, _inputs(model, means, cause, way * size, dt), tolerance=1e-4
            ).outputs[0]
            for way in (2.0, -2.0)
        )
        for j, port in enumerate(model.outputs):
            apart = up[:, j] - down[:, j]
            apart = apart[np.isfinite(apart)]
            scale = float(np.abs(up[:, j]).max()) if np.isfinite(up[:, j]).all() else 0.0
            found[cause, port.role] = _sign(apart, scale)
    return found


def _sign(apart: Array, scale: float) -> int:
    """The sign of a response; 0 where it is next to nothing, or changes on the way.

    The pressure of a chamber falls while a piston of unequal areas moves, and rises once it is at its stop.
    """
    rises, falls = float(np.maximum(apart, 0.0).sum()), float(np.maximum(-apart, 0.0).sum())
    clear = max(rises, falls) > _CLEAR * max(scale, 1e-30) * max(len(apart), 1)
    return int(np.sign(rises - falls)) if clear and min(rises, falls) < _MIXED * max(rises, falls) else 0


def _mean(recording: Recording, role: str) -> float:
    return float(np.nanmean(recording[role].values)) if role in recording else 0.0


def _inputs(model: Model, means: Mapping[str, float], cause: str, step: float, dt: np.ndarray) -> np.ndarray:
    columns = []
    for port in model.inputs:
        if port.role == INTERVAL:
            columns.append(dt)
        elif port.role == CLOCK:
            columns.append(np.cumsum(dt))
        else:
            columns.append(np.full(len(dt), means[port.role] + (step if port.role == cause else 0.0)))
    return np.column_stack(columns)
