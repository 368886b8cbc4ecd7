"""Vertices and colours for a page: few and short, without a visible difference."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.colors import to_rgba

from optid.core.model import Array

POINTS = 3000  # vertices that a line keeps: more than the pixels of a page, and fewer than its bytes
DIGITS = 4  # decimal places relative to a line's range: a thousand pixels show three


def colour(value: Any, alpha: float | None = None) -> str:
    """A colour as a page writes it."""
    red, green, blue, opacity = to_rgba(value, alpha)
    return f"rgba({red * 255:.0f},{green * 255:.0f},{blue * 255:.0f},{opacity:.3g})"


def thin(x: Array, y: Array, points: int = POINTS) -> tuple[Array, Array]:
    """Lowest and highest value of every stretch, so that no spike is lost."""
    if len(y) <= points:
        return x, y
    size = -(-len(y) // (points // 2))
    rows = np.r_[y, np.full(-len(y) % size, np.nan)].reshape(-1, size)
    known = np.isfinite(rows)
    low = np.argmin(np.where(known, rows, np.inf), axis=1)
    high = np.argmax(np.where(known, rows, -np.inf), axis=1)
    picked = np.sort(np.c_[low, high], axis=1) + size * np.arange(len(rows))[:, None]
    at = np.minimum(picked.ravel(), len(y) - 1)
    return x[at], y[at]


def numbers(values: Any, digits: int = DIGITS) -> list[float | None]:
    """Rounded to the resolution of a page; ``None`` for values that are not finite."""
    array = np.asarray(values, dtype=float).ravel()
    known = array[np.isfinite(array)]
    span = float(np.ptp(known)) or float(np.abs(known).max()) if known.size else 0.0
    places = digits - math.floor(math.log10(span)) if span > 0 else digits
    rounded = np.round(array, min(max(places, -300), 300)) + 0.0  # avoids minus zero
    return [value if math.isfinite(value) else None for value in rounded.tolist()]
