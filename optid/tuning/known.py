"""Results of a rig's fit: uncertainty of its parameters and noise of its sensor, from the files beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.document import HUGE, optional_document
from optid.rigs.rigfile import Rig

FILES = ("fit.json", "diagnosis.json")  # files in the same folder as the rig file with the fitted values
DRAWS = 6  # parameter sets in addition to the fitted one
SAME = 1e-6  # relative: a value in such a file belongs to the rig file if they agree
UNFITTED = 0.1  # sd of a parameter that was not fitted, as a share of its value, where the file states none
WITHIN = 2.0  # standard deviations to which draws are clipped


def parameter_sets(rig: Rig, rng: np.random.Generator, count: int = DRAWS) -> tuple[Mapping[str, float], ...]:
    """Values drawn from the intervals of this rig's fit; for unfitted parameters, around the file's values.

    Returns:
        `count` mappings from parameter to SI value, or an empty tuple where nothing may be fitted.
    """
    spread = _spread(rig) or _unfitted(rig)
    if not spread:
        return ()
    bounds = {q.name: q.bounds for q in rig.model.parameters}
    sets = []
    for _ in range(count):
        drawn = {}
        for name, (value, sd) in spread.items():
            low, high = bounds[name]
            moved = value + sd * float(np.clip(rng.standard_normal(), -WITHIN, WITHIN))
            drawn[name] = float(np.clip(moved, low, high))
        sets.append(drawn)
    return tuple(sets)


def sensor_noise(rig: Rig, role: str) -> float | None:
    """Sd of a channel's noise, SI: as the rig file states it, else as its fit found it; None where neither does."""
    channel = rig.channels.get(role)
    if channel is not None and channel.sd:
        return float(channel.sd)
    for content in _documents(rig):
        sd = _number(content, "noise", role, "sd") or _number(content, "noise_floor", role, "rmse")
        if sd is not None and sd > 0.0:
            return sd
    return None


def _spread(rig: Rig) -> dict[str, tuple[float, float]]:
    """Value and standard deviation by parameter, of those whose fitted value the rig file holds."""
    found: dict[str, tuple[float, float]] = {}
    known = {q.name for q in rig.model.parameters}
    for content in _documents(rig):
        improved = content.get("improved")
        table = content.get("parameters") or (
            improved.get("parameters") if isinstance(improved, dict) else None
        )
        for name, entry in table.items() if isinstance(table, dict) else ():
            value, sd = _interval(entry)
            if name in known and sd and math.isclose(value, rig.parameters.get(name, math.nan), rel_tol=SAME):
                found.setdefault(name, (value, sd))
    return found


def _unfitted(rig: Rig) -> dict[str, tuple[float, float]]:
    values = {freed.name: rig.parameters[freed.name] for freed in rig.freed if freed.name in rig.parameters}
    return {
        f.name: (values[f.name], f.sd or UNFITTED * abs(values[f.name]))
        for f in rig.freed
        if f.name in values
    }


def fitted(rig: Rig) -> bool:
    """Whether a fit's intervals lie beside the rig file."""
    return bool(_spread(rig))


def _interval(entry: Any) -> tuple[float, float]:
    """Value and standard deviation, 0 without an interval; an open side counts as wide as the other."""
    value = _number(entry, "value")
    ends = entry.get("ci95") if isinstance(entry, dict) else None
    if value is None:
        return math.nan, 0.0
    known = map(_number, ends if isinstance(ends, list) else ())
    sides = [abs(end - value) for end in known if end is not None]
    return value, max(sides, default=0.0) / 1.96


def _documents(rig: Rig) -> list[dict[str, Any]]:
    found = []
    for name in FILES:
        content = optional_document(Path(rig.path).parent / name)
        if content is not None and str(content.get("schema", "")).startswith("optid."):
            found.append(content)
    return found


def _number(content: Any, *keys: str) -> float | None:
    for key in keys:
        content = content.get(key) if isinstance(content, dict) else None
    sound = isinstance(content, int | float) and abs(content) <= HUGE
    return float(content) if sound else None
