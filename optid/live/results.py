"""Results of a session in addition to its recording: live.json, and the identified model."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optid.armax.audit import audit
from optid.armax.files import ArmaxFile, SavedModel
from optid.core.model import Array
from optid.live.excerpt import last_rows
from optid.live.log import LOG, PREDICTIONS, Layout
from optid.live.review import Review
from optid.live.settings import Settings, Wiring

if TYPE_CHECKING:
    from optid.live.session import Session

SCHEMA = "optid.live/1"
SHOWN = 60.0  # s at the end of a recording that are shown
BEFORE, AFTER = 0.1, 1.4  # s around a step that is shown
CHUNK = 200_000  # rows of a recording in memory at a time


def live_document(session: Session) -> dict[str, Any]:
    """The content of live.json; of an ended session."""
    end, settings = session.end or {}, session.settings
    path = session.plan.out / LOG
    fit = fit_percent(path, session.wiring) if path.is_file() else dict.fromkeys(PREDICTIONS)
    return {
        "schema": SCHEMA,
        "outcome": end.get("how", "failed"),
        "why": end.get("why", ""),
        "safe": end.get("safe", False),
        "safe_after": end.get("safe_after"),
        "driver": session.plan.driver,
        "hides": session.hides,
        "rate": settings.rate,
        "samples": end.get("samples", 0),
        "missed": end.get("missed", 0),
        "held_back": end.get("held_back", 0),
        "timing": end.get("timing", {}),
        "gains": asdict(session.gains),
        "trials": session.trials,
        "review": None if session.tuning.review is None else _reviewed(session.tuning.review),
        "fit_percent": fit,
        "parted": session.disagree,
        "diagnosis": session.diagnosis,
        "followed": session.following.standing,
        "events": [{"time": round(event.time, 3), "words": event.words} for event in session.events],
    }


def _reviewed(review: Review) -> dict[str, Any]:
    """The predictions for the last tuning."""
    responses = review.responses.items()
    return {
        "old": asdict(review.old),
        "new": asdict(review.new),
        "worse": list(review.worse),
        "maximum_sensitivity": {
            "asked": review.sensitivity,
            **{
                name: finite(one.maximum_sensitivity)
                for name, one in zip(("old", "new"), review.margins, strict=True)
            },
        },
        "itae": {model: [finite(one) for one in pair] for model, pair in review.itae.items()},
        "hunting": {model: [finite(one.hunting) for one in pair] for model, pair in responses},
    }


def finite(value: float) -> float | None:
    """A number for JSON: ``None`` if it is not finite."""
    return value if math.isfinite(value) else None


def identified(session: Session) -> ArmaxFile | None:
    """The content of armax.json, with the model's audit; ``None`` where nothing was identified."""
    model = session.model
    if model is None:
        return None
    words = "identified recursively while the loop was closed"
    saved = SavedModel(model, audit(model, fitted=False).findings)
    return ArmaxFile("command", session.wiring.measured[0].role, model.orders.na, (saved,), words)


def fit_percent(path: Path, wiring: Wiring) -> dict[str, float | None]:
    """100 (1 - |y - yhat| / |y - mean y|) of each prediction over a session's recording, read in parts."""
    import pandas as pd

    position = wiring.measured[0].column
    names = Layout(wiring).columns[-len(PREDICTIONS) :]
    sums = np.zeros((len(names), 4))  # samples, y, y squared, error squared
    for part in pd.read_csv(path, usecols=[position, *names], chunksize=CHUNK):
        y = part[position].to_numpy(dtype=float)
        for total, name in zip(sums, names, strict=True):
            error = y - part[name].to_numpy(dtype=float)
            known = np.isfinite(error)
            seen = y[known]
            total += (len(seen), seen.sum(), (seen**2).sum(), (error[known] ** 2).sum())
    return {kind: _percent(*total) for kind, total in zip(PREDICTIONS, sums.tolist(), strict=True)}


def _percent(number: float, total: float, squares: float, errors: float) -> float | None:
    spread = squares - total**2 / number if number else 0.0
    return 100.0 * (1.0 - math.sqrt(errors / spread)) if spread > 0.0 else None


@dataclass(frozen=True, eq=False)
class Stretch:
    """Part of a session, SI.

    Attributes:
        time: s, shape (samples,).
        positions: "reference", "real", "predicted", "simulated", each (samples,).
        command: V, (samples,).
        role, unit, command_unit: of the position and the command.
        limits: of the command.
    """

    time: Array
    positions: dict[str, Array]
    command: Array
    role: str
    unit: str
    command_unit: str
    limits: tuple[float, float]

    def around(self, time: float) -> Stretch:
        """The part around a time."""
        keep = (self.time >= time - BEFORE) & (self.time <= time + AFTER)
        positions = {name: values[keep] for name, values in self.positions.items()}
        return replace(self, time=self.time[keep], positions=positions, command=self.command[keep])

    @property
    def last_step(self) -> float | None:
        """Time of the last step of the reference with enough of its response, s."""
        reference = self.positions["reference"]
        known = np.isfinite(reference)
        moved = self.time[known][1:][np.diff(reference[known]) != 0.0]
        whole = moved[moved <= self.time[-1] - AFTER / 2]
        return float(whole[-1]) if whole.size else None


def last_stretch(path: Path, wiring: Wiring, settings: Settings) -> Stretch | None:
    """The last minute of a session's recording; ``None`` if it is too short."""
    import io

    import pandas as pd

    head, rows = last_rows(path, round(SHOWN * settings.rate))
    if len(rows) < 2:
        return None
    frame = pd.read_csv(io.BytesIO(b"\n".join((head, *rows))), dtype=float)
    columns = [frame[name].to_numpy() for name in Layout(wiring).columns]
    position, command = wiring.measured[0], wiring.command
    reference, *models = columns[-1 - len(PREDICTIONS) :]
    shown = {"real": columns[2], **dict(zip(PREDICTIONS, models, strict=True))}
    positions = {name: position.factor * values + position.shift for name, values in shown.items()}
    of = wiring.reference or position
    positions["reference"] = of.factor * reference + of.shift
    return Stretch(
        columns[0] * wiring.time.factor,
        positions,
        (columns[1] * command.factor + command.shift) * command.per_unit,
        position.role,
        position.model_unit,
        command.recorded_unit,
        (settings.limits.low, settings.limits.high),
    )
