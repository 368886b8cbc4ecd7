"""The state of a running fit as the document of a checkpoint."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from optid.core.cache import sources
from optid.core.checkpoint import Checkpoint, equations
from optid.core.model import Array
from optid.estimation.smoother import Objective, Point


@dataclass(frozen=True, eq=False)
class Kept:
    """The state of a fit: the number of its start, counted from 0, its point, and the best result of earlier starts."""

    number: int
    at: Point
    best: Point | None


def key_of(o: Objective, p: Array) -> str:
    """A digest of an objective and its start: data, equations, values, weights, bounds, and optid's code."""
    digest = hashlib.sha256()
    b = o.problem
    for array in (b.time, b.inputs, b.measured, b.begins, o.weight, o.low, o.high, o.prior, o.prior_sd, p):
        digest.update(np.ascontiguousarray(array).tobytes())
    digest.update(repr((sources(__file__), o.model.name, o.free, o.huber)).encode() + equations(o.model))
    return digest.hexdigest()


def save(checkpoint: Checkpoint, kept: Kept) -> None:
    """Store the state of a fit."""
    best = None if kept.best is None else _written(kept.best)
    checkpoint.save("fit", {"number": kept.number, "at": _written(kept.at), "best": best})


def load(checkpoint: Checkpoint) -> Kept | None:
    """The stored state of a fit, or ``None``."""
    found = checkpoint.load("fit")
    if found is None:
        return None
    best = None if found["best"] is None else _read(found["best"])
    return Kept(int(found["number"]), _read(found["at"]), best)


def _written(at: Point) -> dict[str, Any]:
    return {"X": at.X.tolist(), "p": at.p.tolist()}


def _read(content: dict[str, Any]) -> Point:
    return Point(np.array(content["X"], dtype=float), np.array(content["p"], dtype=float))
