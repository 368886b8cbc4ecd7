"""The 95 % band of a prediction from the uncertainty of a fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from optid.api.inputs import Progress
from optid.core.model import Array
from optid.core.recording import Recording
from optid.errors import InputError
from optid.estimation.prediction import predict
from optid.results.fit import FitResult
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    import pandas as pd

NORMAL = 1.959964  # standard deviations that hold 95 % of a normal distribution
STEP = (
    0.3  # sd of the parameter, for finite differences: far above the error of the simulation, nearly linear
)
KINDS = ("free_run", "window")


def with_band(
    table: pd.DataFrame, rig: Rig, recordings: Sequence[Recording], fit: FitResult, progress: Progress
) -> pd.DataFrame:
    """The table with NAME_KIND_low and NAME_KIND_high beside every prediction.

    First-order propagation of the parameters' covariance: the error is the sum of each parameter's contribution, by
    finite differences, two predictions a parameter. Ljung, System Identification (1999), section 9.6.

    Raises
    ------
    InputError
        the fit is of another model: a parameter of it is unknown here.
    """
    covariance = fit.covariance
    names = list(fit.parameters)
    for name in names:
        if name not in {parameter.name for parameter in rig.model.parameters}:
            raise InputError(
                f'the fit has the parameter "{name}", which {rig.path} does not have', field="fit"
            )
    columns = [f"{role}_{kind}" for role in _roles(table) for kind in KINDS]
    nominal = table[columns].to_numpy(dtype=float)

    def predicted(name: str, value: float) -> Array:
        moved = {**fit.values, name: value}
        frames = [predict(rig, one, moved, fit.process_noise).frame[columns] for one in recordings]
        return np.concatenate([frame.to_numpy(dtype=float) for frame in frames])

    slopes = []
    for number, name in enumerate(names):
        progress(number / len(names), f"what {name} moves")
        value, size = fit.values[name], STEP * float(np.sqrt(covariance[number, number]))
        sides = [
            (predicted(name, place) - nominal) / (place - value) for place in _places(rig, name, value, size)
        ]
        # An estimated start that jumps to another one gives no slope: the side that moves less is used.
        slopes.append(min(sides, key=lambda one: float(np.nansum(one**2)), default=np.zeros_like(nominal)))
    stacked = np.stack(slopes, axis=-1)
    variance = np.einsum("nci,ij,ncj->nc", stacked, covariance, stacked)
    half = NORMAL * np.sqrt(np.maximum(variance, 0.0))
    found = table.copy()
    for k, column in enumerate(columns):
        found[f"{column}_low"], found[f"{column}_high"] = (
            nominal[:, k] - half[:, k],
            nominal[:, k] + half[:, k],
        )
    return found


def _roles(table: pd.DataFrame) -> list[str]:
    return [str(column).removesuffix("_window") for column in table if str(column).endswith("_window")]


def _places(rig: Rig, name: str, value: float, size: float) -> list[float]:
    """A parameter's values to each side, within the physical range; none where it is fixed."""
    low, high = next(p.bounds for p in rig.model.parameters if p.name == name)
    return [place for place in (max(value - size, low), min(value + size, high)) if place != value]
