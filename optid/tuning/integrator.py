"""A nearly integrating pole of the identified model, replaced by an exact integrator where justified."""

from __future__ import annotations

import math
from dataclasses import replace
from enum import Enum

import numpy as np

from optid.armax.model import Armax
from optid.core.model import Array
from optid.tuning.plant import DRIFT, MARGIN, Plant

SURE = 3.0  # standard errors within which a pole cannot be distinguished from 1


class Integrator(Enum):
    """Whether the pole nearest to 1 is set to exactly 1."""

    AUTO = "where the data support it"
    YES = "always"
    NO = "never"


def with_integrator(plant: Plant, model: Armax, choice: Integrator) -> tuple[Plant, str]:
    """The plant with its slowest pole at 1, and the reason as a sentence (empty where nothing changed).

    A pole slightly outside the unit circle is unstable, which no axis at rest is: it requires integral action that
    friction turns into hunting. The gain of the rest of the plant is kept.

    Args:
        plant: of the model.
        model: with its covariance, if known.
        choice: see there.
    """
    at = nearest_to_one(plant)
    if choice is Integrator.NO or at is None or abs(at - 1.0) <= MARGIN:
        return plant, ""
    sd, off = _standard_error(model, at), at - 1.0
    spoken = off > 0.0 or abs(off) <= SURE * sd
    if choice is Integrator.AUTO and not spoken:
        return plant, ""
    why = (
        "a slightly unstable model is an integrator with an estimation error"
        if off > 0.0
        else f"within {SURE:g} standard errors of 1"
        if abs(off) <= SURE * sd
        else "as requested (--integrator yes)"
    )
    said = f"The pole at {at:.7g} is replaced by an exact integrator: {why} (--integrator no keeps it)."
    return replace(plant, a=_moved(plant.a, at), remarks=_without_drift(plant)), said


def nearest_to_one(plant: Plant) -> float | None:
    """The real pole within DRIFT of 1 that is nearest to it."""
    near = [p.real for p in plant.poles if p.imag == 0.0 and abs(p.real - 1.0) <= DRIFT]
    return min(near, key=lambda p: abs(p - 1.0)) if near else None


def _moved(a: Array, pole: float) -> Array:
    """Coefficients with the pole divided out by Horner's scheme and put back at 1."""
    whole = np.r_[1.0, a]
    rest = np.empty(a.size)
    rest[0] = 1.0
    for i in range(1, a.size):
        rest[i] = whole[i] + pole * rest[i - 1]
    return np.asarray(np.convolve(rest, [1.0, -1.0])[1:])


def _standard_error(model: Armax, pole: float) -> float:
    """Of a real pole, from the covariance of A by its linearisation; 0 where that is unknown."""
    if model.covariance is None:
        return 0.0
    n = len(model.a) - 1
    slope = float(np.polyval(np.polyder(np.array(model.a)), pole))
    if slope == 0.0:
        return 0.0
    J = -(pole ** np.arange(n - 1, -1, -1.0)) / slope
    C = np.array(model.covariance)[:n, :n]
    return math.sqrt(max(float(J @ C @ J), 0.0))


def _without_drift(plant: Plant) -> tuple[str, ...]:
    return tuple(remark for remark in plant.remarks if not remark.startswith("The model drifts"))
