"""One test of all quantities of a rig together, whitened by the covariance of unchanged nights.

Friction and supply vary from night to night and move several estimates at once; so does wear. The covariance of these
moves is estimated from the reference nights of the other rigs. In whitened coordinates a change is detected in those
directions in which unchanged nights hardly move (Hotelling's T squared). The scale of a rig's own moves is estimated
from all directions of its reference.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from optid.fleet.statistics.normal_scores import looks, normal_scores, smallest_p, tail_degrees

Array = NDArray[np.float64]
LEAST = 4  # differences of nights a quantity: of fewer no covariance is made
SLIGHT = 1e-6  # of a direction's variance, in robust sd: less is none
NORMAL = 1.4826  # median of absolute deviations to sd


def joint(nightly: pd.DataFrame, reference: int) -> pd.DataFrame:
    """One row per rig and night after the reference: rig, date, p.

    Parameters
    ----------
    nightly : pd.DataFrame
        value by quantity, rig and date (its index). A rig is left out where one of its nights lacks a quantity.
    reference : int
        nights, the first of each rig.
    """
    table = nightly.pivot_table(index=["rig", "date"], columns="quantity", values="value").groupby(
        level="rig"
    )
    rigs = {
        str(rig): one.droplevel("rig")
        for rig, one in table
        if len(one) > reference and not one.isna().to_numpy().any()
    }
    width = nightly.index.get_level_values("quantity").nunique()
    if len(rigs) * (reference - 1) < LEAST * width:
        return pd.DataFrame(columns=["rig", "date", "p"])
    values = {rig: one.to_numpy(dtype=np.float64) for rig, one in rigs.items()}
    whitened = _whitened(list(values.values()), reference)
    among = [
        _moved(one[[night]], np.delete(one[:reference], night, axis=0))
        for one in whitened
        for night in range(reference)
    ]
    degrees = tail_degrees(np.array([float(np.sum(one**2)) for one in among]), width)
    rows = []
    for (rig, one), moved in zip(rigs.items(), whitened, strict=True):
        _, p = looks(normal_scores(_moved(moved[reference:], moved[:reference]), degrees), reference)
        rows.append(pd.DataFrame({"rig": rig, "date": one.index[reference:], "p": smallest_p(p)}))
    return pd.concat(rows, ignore_index=True).dropna()


def _whitened(values: list[Array], reference: int) -> list[Array]:
    """Each rig's nights relative to the mean of its reference, whitened by the covariance of all other rigs.

    Without the rig itself, so that its reference nights are as far out as later ones; the other rigs have equal weight.
    """
    centred = [one - np.median(one[:reference], axis=0) for one in values]
    sizes = NORMAL * np.median(np.abs(np.concatenate([one[:reference] for one in centred])), axis=0)
    scaled = [one / np.where(sizes > 0.0, sizes, 1.0) for one in centred]
    moved = [one - one[:reference].mean(axis=0) for one in scaled]
    squares = [one[:reference].T @ one[:reference] for one in moved]
    squares = [one / max(float(np.trace(one)), 1e-300) for one in squares]
    about = np.sum(squares, axis=0)
    return [one @ _whitener(about - of_one) for one, of_one in zip(moved, squares, strict=True)]


def _whitener(squares: Array) -> Array:
    """Coordinates in which this covariance is the same in all directions."""
    variances, directions = np.linalg.eigh(squares / np.trace(squares) * len(squares))
    return np.asarray(directions / np.sqrt(np.maximum(variances, SLIGHT)))


def _moved(nights: Array, base: Array) -> Array:
    """Distance of nights from the mean of the base, in sd of the base in all directions, (nights, width)."""
    mean, count = base.mean(axis=0), len(base)
    variance = float(np.sum((base - mean) ** 2)) / (base.shape[1] * (count - 1))
    return np.asarray((nights - mean) / np.sqrt(variance * (1.0 + 1.0 / count)))
