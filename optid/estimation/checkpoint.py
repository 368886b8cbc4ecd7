"""Checkpoints of a running fit, from which an interrupted one continues.

One JSON file with a digest of its content; a damaged one is ignored.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.cache import sources
from optid.core.document import optional_document
from optid.core.model import Array
from optid.estimation.smoother import Objective, Point


@dataclass(frozen=True, eq=False)
class Kept:
    """The state of a fit: the number of its start, counted from 0, its point, and the best result of earlier starts."""

    number: int
    at: Point
    best: Point | None


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A file that belongs to one fit; without a path nothing is kept.

    Attributes:
        path: the file.
        identity: of the fit; another fit's file is not read.
    """

    path: Path | None
    identity: str

    @staticmethod
    def of(path: Path | None, o: Objective, p: Array) -> Checkpoint:
        """The checkpoint of an objective and its start: data, equations, values, weights, bounds, and optid's code."""
        digest = hashlib.sha256()
        b = o.problem
        for array in (
            b.time,
            b.inputs,
            b.measured,
            b.begins,
            o.weight,
            o.low,
            o.high,
            o.prior,
            o.prior_sd,
            p,
        ):
            digest.update(np.ascontiguousarray(array).tobytes())
        names = [q.name for q in o.model.parameters]
        equations = (o.model.rates, o.model.sensors, o.model.start, o.model.halves)
        written = [one.serialize() for one in equations if one is not None]
        facts = (sources(__file__), o.model.name, names, o.free, o.huber, written)
        digest.update(repr(facts).encode())
        return Checkpoint(path, digest.hexdigest())

    def save(self, kept: Kept) -> None:
        """Write completely or not at all; if that fails, the fit continues without."""
        if self.path is None:
            return
        best = None if kept.best is None else _written(kept.best)
        stand = {"number": kept.number, "at": _written(kept.at), "best": best}
        content = {"fit": self.identity, "digest": _digest(stand), "stand": stand}
        draft = self.path.with_name(f"{self.path.name}.{os.getpid()}.part")
        try:
            draft.write_text(json.dumps(content))
            draft.replace(self.path)
        except OSError:
            with contextlib.suppress(OSError):
                draft.unlink(missing_ok=True)

    def load(self) -> Kept | None:
        """The checkpoint of this fit; ``None`` where there is none, or another fit's."""
        content = None if self.path is None else optional_document(self.path)
        stand = None if content is None or content.get("fit") != self.identity else content.get("stand")
        if content is None or not isinstance(stand, dict) or content.get("digest") != _digest(stand):
            return None
        best = None if stand["best"] is None else _read(stand["best"])
        return Kept(int(stand["number"]), _read(stand["at"]), best)


def _digest(stand: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(stand).encode()).hexdigest()


def _written(at: Point) -> dict[str, Any]:
    return {"X": at.X.tolist(), "p": at.p.tolist()}


def _read(content: dict[str, Any]) -> Point:
    return Point(np.array(content["X"], dtype=float), np.array(content["p"], dtype=float))
