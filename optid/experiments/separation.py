"""From inner products of signatures to the standard deviations between rivals.

Between "this rival is present at its smallest size worth a name" and "that one is present, in any size and form": the
norm of the residual of the first one's signature after a linear fit of the parameters and all forms of the second (a
Schur complement). That is the distance of the means of the best test between the two.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from optid.core.model import Array
from optid.experiments.signatures import Layout

NEEDED = 4.65  # sd between two hypotheses that a test confuses in 1 % of the cases, in both directions
# Singular values below this share of the largest: directions that forms share up to nonlinearity. Refits of simulated
# experiments agree with it for a lag and a delay, 0.71 and 2.3 sd compared with 0.8 and 2.35; 0.05 would predict 2.9
# for 0.71.
SAME = 0.02
SHARP = 1e-5  # the same for slopes, which are known exactly
NOTHING = 1e-6  # share of a signature's square that is rounding

Pair = tuple[
    int, int | None
]  # the rival that is present, and the one it could be mistaken for; None for no effect


def pairs(rivals: int) -> tuple[Pair, ...]:
    """Every ordered pair; a single rival is paired with no effect."""
    return tuple(itertools.permutations(range(rivals), 2)) if rivals > 1 else ((0, None),)


def separations(gram: Array, layout: Layout, wanted: Sequence[Pair]) -> Array:
    """The sd of each wanted pair, (pairs,), the smallest over the forms of the rival that is present.

    Args:
        gram: inner products of all columns, (columns, columns).
        layout: of its columns.
        wanted: pairs of rivals.
    """
    slopes = tuple(range(layout.slopes))
    refitted = _without(gram, slopes, SHARP)
    gone = np.diag(refitted) <= NOTHING * np.diag(gram)  # only rounding remains of these columns
    refitted = np.where(gone[:, None] | gone[None, :], 0.0, refitted)
    spans = {j: _without(refitted, layout.forms[j], SAME) for _, j in wanted if j is not None}
    found = np.empty(len(wanted))
    for k, (i, j) in enumerate(wanted):
        worth = list(layout.worth[i])
        left = np.diag(refitted if j is None else spans[j])[worth]
        whole = np.diag(gram)[worth]
        found[k] = float(np.sqrt(np.where(left > NOTHING * whole, left, 0.0).min()))
    return found


def _without(gram: Array, taken: Sequence[int], cut: float) -> Array:
    """Inner products of what remains after projecting off the `taken` columns, small singular values of theirs left."""
    lengths = np.sqrt(np.diag(gram))
    used = [k for k in taken if lengths[k] > 0.0]
    if not used:
        return gram
    unit = gram[:, used] / lengths[used]
    square, directions = np.linalg.eigh(unit[used] / lengths[used, None])
    kept = square > max(cut**2, 1e-14) * square[-1]
    basis = unit @ directions[:, kept] / np.sqrt(square[kept])
    return np.asarray(gram - basis @ basis.T)
