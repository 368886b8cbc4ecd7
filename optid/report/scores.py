"""Scores over one or several recordings, and the machine-readable files made of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from optid.core.quantity import friendly
from optid.core.recording import Recording
from optid.quality.noise import noise_sd
from optid.report.residuals import residual
from optid.results.words import score_rows

if TYPE_CHECKING:
    from optid.estimation.prediction import Prediction
    from optid.estimation.profile import Profile
    from optid.estimation.result import Fit

__all__ = [
    "KINDS",
    "SCHEMA",
    "Miss",
    "fit_document",
    "friendly",
    "metrics_document",
    "misses",
    "number",
    "pooled",
    "residual",
    "score_rows",
]

KINDS = ("window", "free_run")
SCHEMA = "optid.fit/1"
FAR = 3.0  # noise sd; fits of correct models to simulated and real axes have errors of 1.0 to 1.1
LEAST_MISS = 1.0  # per cent of a channel's spread: less is seldom worth a search


def pooled(predictions: Sequence[Prediction], kind: str) -> dict[str, dict[str, Any]]:
    """Score of every channel over all recordings: squared errors are summed, with each recording's own mean.

    Args:
        predictions: one a recording; empty gives an empty result.
        kind: "window" or "free_run".

    Returns:
        Role -> fit_percent, rmse, unit (SI). A number that does not exist is None.
    """
    found: dict[str, dict[str, Any]] = {}
    for role in dict.fromkeys(role for one in predictions for role in one.scores[kind]):
        holders = [one for one in predictions if role in one.scores[kind]]
        if len(holders) == 1:
            score = holders[0].scores[kind][role]
            percent, rmse, unit = score.fit_percent, score.rmse, score.unit
        else:
            percent, rmse = _over_all(holders, role, kind)
            unit = holders[0].scores[kind][role].unit
        found[role] = {"fit_percent": number(percent), "rmse": number(rmse), "unit": unit}
    return found


def metrics_document(predictions: Sequence[Prediction]) -> dict[str, Any]:
    """The scores of metrics.json: role -> kind -> fit_percent, rmse, unit."""
    by_kind = {kind: pooled(predictions, kind) for kind in KINDS}
    return {role: {kind: by_kind[kind][role] for kind in KINDS} for role in by_kind["window"]}


@dataclass(frozen=True)
class Miss:
    """A channel whose prediction error exceeds the noise: its fit, error, noise (SI) and unit."""

    role: str
    fit_percent: float
    rmse: float
    noise: float
    unit: str

    @property
    def sentence(self) -> str:
        """What to do about it."""
        factor, unit = friendly(self.unit)
        return (
            f"the model's error is {100 - self.fit_percent:.2g} % of the signal: run `optid diagnose` "
            f"({self.role}: {self.rmse * factor:.3g} {unit} rms, its noise is {self.noise * factor:.2g} {unit})"
        )

    @property
    def held_sentence(self) -> str:
        """The same for the hold-out, to which nothing was fitted."""
        if self.fit_percent >= 0.0:
            return f"held out, {self.sentence}"
        return (
            f"held out, it predicts worse than the mean of the measurement does ({self.role}: "
            f"{self.fit_percent:.4g} %): a different axis, a changed sign or unit, or too little data for the fit"
        )


def misses(predictions: Sequence[Prediction], recordings: Sequence[Recording]) -> tuple[Miss, ...]:
    """Channels whose windowed error is far above their noise; that of a correct model is hardly larger.

    Args:
        predictions: one a recording.
        recordings: in the same order.
    """
    found = []
    for role, score in pooled(predictions, "window").items():
        percent, rmse = score["fit_percent"], score["rmse"]
        squares = [max(noise_sd(r[role].values), r[role].sd or 0.0) ** 2 for r in recordings if role in r]
        noise = math.sqrt(sum(squares) / len(squares)) if squares else 0.0
        if percent is not None and percent < 100 - LEAST_MISS and rmse > FAR * noise:
            found.append(Miss(role, percent, rmse, noise, score["unit"]))
    return tuple(found)


def fit_document(
    fit: Fit,
    train: Sequence[Prediction],
    holdout: Sequence[Prediction],
    profiles: Sequence[Profile] = (),
    missed: Sequence[Miss] = (),
    held_missed: Sequence[Miss] = (),
) -> dict[str, Any]:
    """The content of fit.json."""
    units = {port: score["unit"] for port, score in pooled(train, "window").items()}
    return {
        "schema": SCHEMA,
        "outcome": fit.outcome.name.lower(),
        "outcome_advice": fit.outcome.value,
        "parameters": {
            p.name: {"value": number(p.value), "unit": p.unit, "ci95": [number(p.low), number(p.high)]}
            for p in fit.parameters
        },
        "train": pooled(train, "window"),
        "holdout": pooled(holdout, "window"),
        "train_free_run": pooled(train, "free_run"),
        "holdout_free_run": pooled(holdout, "free_run"),
        "not_identifiable": [p.name for p in fit.parameters if not p.identifiable],
        "at_bound": [p.name for p in fit.parameters if p.at_bound],
        "ties": list(fit.ties),
        "missed": [{**vars(one), "advice": one.sentence} for one in missed],
        "holdout_missed": [{**vars(one), "advice": one.held_sentence} for one in held_missed],
        "noise": {role: {"sd": number(sd), "unit": units.get(role)} for role, sd in fit.noise.items()},
        "profiles": {
            p.name: {
                "unit": p.unit,
                "ci95": [number(p.low), number(p.high)],
                "limit": number(p.limit),
                "value": p.value,
                "fit_ci95": [number(end) for end in p.linear],
                "values": p.values.tolist(),
                "deviance": p.deviance.tolist(),
                "words": p.sentence,
            }
            for p in profiles
        },
        "certificate_sound": bool(fit.certificate.sound),
        "seconds": number(fit.seconds),
    }


def number(value: float) -> float | None:
    """A number for JSON: None for one that is not finite."""
    return float(value) if math.isfinite(value) else None


def _over_all(predictions: Sequence[Prediction], role: str, kind: str) -> tuple[float, float]:
    errors = spread = count = 0.0
    for one in predictions:
        error = residual(one.frame, role, kind)
        known = np.isfinite(error)
        if not known.any():
            continue
        measured = np.asarray(one.frame[role], dtype=np.float64)[known]
        errors += float(np.sum(error[known] ** 2))
        spread += float(np.sum((measured - measured.mean()) ** 2))
        count += float(known.sum())
    percent = 100 * (1 - math.sqrt(errors / spread)) if spread > 0 else math.nan
    return percent, math.sqrt(errors / count) if count else math.nan
