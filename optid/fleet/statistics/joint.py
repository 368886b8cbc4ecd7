"""Have a rig's quantities changed together? One test of all of them, whitened by how sound nights move them.

Friction and supply that wander from night to night move several estimates at once, and a wear moves several, too. The
reference nights of all rigs say how estimates move together; in coordinates in which these moves are independent and
of equal size, a change stands out in directions that wander leaves alone (Hotelling's T squared). How much more than
others a rig moves is estimated from all directions of its own reference.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

Array = NDArray[np.float64]
LEAST = 4  # differences of nights a quantity: of fewer no covariance is made
SLIGHT = 1e-6  # of a direction's variance, in robust sd: less is none
NORMAL = 1.4826  # median of absolute deviations to sd


def joint(nightly: pd.DataFrame, reference: int, looks: tuple[int, ...], degrees: float) -> pd.DataFrame:
    """One row a rig and night after the reference: rig, date, p.

    Parameters
    ----------
    nightly : pd.DataFrame
        value by quantity, rig and date (its index). A rig is left out where one of its nights lacks a quantity.
    reference : int
        nights, the first of each rig.
    looks : tuple[int, ...]
        last nights whose mean is compared; their number multiplies p.
    degrees : float
        of freedom of a variance, of one direction of one rig.
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
    rows = []
    for (rig, one), moved in zip(rigs.items(), whitened, strict=True):
        p = _of_rig(moved, reference, looks, degrees)
        rows.append(pd.DataFrame({"rig": rig, "date": one.index[reference:], "p": p}))
    return pd.concat(rows, ignore_index=True).dropna()


def _whitened(values: list[Array], reference: int) -> list[Array]:
    """Each rig's nights about its reference's mean, in independent directions of the wander of all rigs."""
    centred = [one - np.median(one[:reference], axis=0) for one in values]
    sizes = NORMAL * np.median(np.abs(np.concatenate([one[:reference] for one in centred])), axis=0)
    scaled = [one / np.where(sizes > 0.0, sizes, 1.0) for one in centred]
    moved = [one - one[:reference].mean(axis=0) for one in scaled]
    about = np.concatenate([one[:reference] for one in moved])
    variances, directions = np.linalg.eigh(about.T @ about / (len(moved) * (reference - 1)))
    return [one @ (directions / np.sqrt(np.maximum(variances, SLIGHT))) for one in moved]


def _of_rig(moved: Array, reference: int, looks: tuple[int, ...], degrees: float) -> Array:
    """p of each night after the reference by the look that tells most, NaN before the first look is full.

    The night that is farthest off is left out where that tells less: none carries a look alone.
    """
    count = moved.shape[1]
    scale = float(np.sum(moved[:reference] ** 2)) / (count * (reference - 1))
    after = moved[reference:]
    p = np.full((len(after), len(looks)), np.nan)
    for k, look in enumerate(looks):
        for night in range(look - 1, len(after)):
            some = after[night - look + 1 : night + 1]
            rest = np.delete(some, int(np.argmax(np.sum(some**2, axis=1))), axis=0)
            squares = [
                float(np.sum(one.mean(axis=0) ** 2)) / (1 / len(one) + 1 / reference) for one in (some, rest)
            ]
            p[night, k] = stats.f.sf(min(squares) / scale / count, count, degrees)
    seen = np.isfinite(p).any(axis=1)
    least = np.where(seen, np.nanmin(np.where(np.isfinite(p), p, np.inf), axis=1), np.nan)
    return np.asarray(np.minimum(least * np.isfinite(p).sum(axis=1), 1.0))
