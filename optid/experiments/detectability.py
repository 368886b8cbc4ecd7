"""Detectability before a diagnosis: the size from which each effect is visible and distinguishable from all others.

The rig file's parameters are taken as true. An effect at its smallest size worth a name changes the innovations by
some sd after a linear fit of the free parameters, and then of another effect in any size and form. It counts as
distinguishable from where that distance is `NEEDED`, to first order, and never below the smallest size worth a name.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from optid.core.recording import Recording
from optid.effects.effect import Effect
from optid.experiments.separation import NEEDED, pairs, separations
from optid.experiments.signatures import grams
from optid.rigs.rigfile import Rig

MOST = 100_000  # samples of all recordings together that are used: it bounds the memory
HARDER = 2.0  # times the size at which an effect is visible: a rival that needs more counts as similar


@dataclass(frozen=True)
class Detectability:
    """The detectability of an effect in recordings.

    Attributes:
        effect: its name.
        separation: sd between the effect at its smallest size worth a name and no effect.
        apart: the same between it and the effect that is most similar to it.
        shows_from: the parameters of the size from which it is visible, SI; empty where no possible size is.
        told_from: the same where it is distinguishable from every other effect.
        units: of these parameters.
        alike: effects from which it is distinguishable only at more than `HARDER` times the size at which it is
            visible.
    """

    effect: str
    separation: float
    apart: float
    shows_from: Mapping[str, float]
    told_from: Mapping[str, float]
    units: Mapping[str, str]
    alike: tuple[str, ...]


def detectability(
    rig: Rig, recordings: Sequence[Recording], effects: Sequence[Effect]
) -> tuple[Detectability, ...]:
    """The size that each effect must have to be visible in recordings.

    Args:
        rig: its parameters are taken as true.
        recordings: of its plant; of more than `MOST` samples in all, the beginning of each.
        effects: that its model can take.

    Raises:
        SolveError: the model cannot be simulated along them.
    """
    each = MOST // len(recordings)
    parts = [one if len(one) <= each else one.taken(np.arange(each)) for one in recordings]
    found = grams(rig, effects, parts, robust=False)
    total, layout = found.values.sum(axis=0), found.layout
    if len(effects) == 1:
        alone = separations(total, layout, pairs(1))
        return (_of(effects[0], float(alone[0]), {}),)
    count = len(effects)
    alone = separations(total, layout, [(i, None) for i in range(count)])
    wanted = list(itertools.permutations(range(count), 2))
    rivals: list[dict[str, float]] = [{} for _ in effects]
    for (i, j), sd in zip(wanted, separations(total, layout, wanted), strict=True):
        rivals[i][effects[j].name] = float(sd)
    return tuple(
        _of(effect, float(sd), others) for effect, sd, others in zip(effects, alone, rivals, strict=True)
    )


def _of(effect: Effect, separation: float, rivals: Mapping[str, float]) -> Detectability:
    apart = min(rivals.values(), default=separation)
    alike = sorted((sd, name) for name, sd in rivals.items() if HARDER * sd < separation)
    units = {one.name: one.unit for one in effect.parameters if one.name in effect.strength}
    return Detectability(
        effect.name,
        separation,
        apart,
        _size(effect, separation),
        _size(effect, apart),
        units,
        tuple(name for _, name in alike),
    )


def _size(effect: Effect, separation: float) -> dict[str, float]:
    """The parameters at which an effect's first usual form is distinguishable; empty where it cannot be so large."""
    if not separation > 0.0:
        return {}
    null = effect.at_null()
    usual = {**null, **effect.usual[0]}
    times = max(NEEDED / separation, 1.0) / effect.size(usual)
    moved = {name: usual[name] - null[name] for name in effect.strength if usual[name] != null[name]}
    values = {name: null[name] + times * by for name, by in moved.items()}
    bounds = {one.name: one.bounds for one in effect.parameters}
    possible = all(bounds[name][0] <= value <= bounds[name][1] for name, value in values.items())
    return values if possible else {}
