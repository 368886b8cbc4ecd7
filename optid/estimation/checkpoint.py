"""What a running fit leaves on disk, so that one that was cut short, or killed, can go on."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.model import Array
from optid.estimation.smoother import Objective, Point


@dataclass(frozen=True, eq=False)
class Kept:
    """Where a fit stood: the start it was at, counted from 0, its point, and the best end of the starts before."""

    number: int
    at: Point
    best: Point | None


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A file that belongs to one fit; ``None`` keeps nothing.

    Attributes:
        path: the file.
        identity: of the fit; another fit's file is not read.
    """

    path: Path | None
    identity: str

    @staticmethod
    def of(path: Path | None, o: Objective, p: Array) -> Checkpoint:
        """The checkpoint of an objective and the parameters it starts from: data, model, values, weights, bounds."""
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
        digest.update(repr((o.model.name, names, o.free, o.huber)).encode())
        return Checkpoint(path, digest.hexdigest())

    def save(self, kept: Kept) -> None:
        """Write whole or not at all; where it cannot be kept, the fit goes on without."""
        if self.path is None:
            return
        content = {"fit": self.identity, "number": kept.number, "at": _written(kept.at)}
        if kept.best is not None:
            content["best"] = _written(kept.best)
        draft = self.path.with_name(f"{self.path.name}.{os.getpid()}.part")
        with contextlib.suppress(OSError):
            draft.write_text(json.dumps(content))
            draft.replace(self.path)

    def load(self) -> Kept | None:
        """What this fit left before; ``None`` where there is nothing, or another fit's."""
        if self.path is None or not self.path.exists():
            return None
        try:
            content = json.loads(self.path.read_text())
            if content["fit"] != self.identity:
                return None
            best = _read(content["best"]) if "best" in content else None
            return Kept(int(content["number"]), _read(content["at"]), best)
        except (OSError, ValueError, KeyError, TypeError, RecursionError):
            return None  # half a file, or an older kind: the fit begins anew


def _written(at: Point) -> dict[str, Any]:
    return {"X": at.X.tolist(), "p": at.p.tolist()}


def _read(content: dict[str, Any]) -> Point:
    return Point(np.array(content["X"], dtype=float), np.array(content["p"], dtype=float))
