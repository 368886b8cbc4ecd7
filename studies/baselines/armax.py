"""Baseline: a black box. An ARMAX model from command to position, its order by BIC; it predicts and names nothing."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # finds the studies beside it from any folder

from optid.armax.batch import fit_batch
from optid.armax.model import Armax
from optid.armax.prediction import predict
from optid.armax.structure import Orders
from optid.core.recording import Recording
from studies.baselines.task import Said, asked, deliver

ORDERS = (2, 3, 4, 5)
WINDOW = 0.5  # s


def window_rmse(model: Armax, recording: Recording) -> float:
    """Of the position over windows whose outputs the model does not see, m; the first 0.5 s are none."""
    y, u = recording["position"].values, recording["command"].values
    length = round(WINDOW / recording.interval)
    squares: list[np.ndarray] = []
    for begin in range(length, len(y), length):
        end = min(begin + length, len(y))
        unseen = y[:end].copy()
        unseen[begin:] = np.nan  # predicted values stand in, one after the other
        squares.append((y[begin:end] - predict(model, unseen, u[:end])[begin:]) ** 2)
    return float(np.sqrt(np.nanmean(np.concatenate(squares))))


def main() -> None:
    """Answer the task."""
    task = asked()
    records = [(r["position"].values, r["command"].values) for r in task.train]
    fits = [fit_batch(records, Orders.of(n, n, n, 1), task.train[0].interval) for n in ORDERS]
    best = min(fits, key=lambda f: f.samples * np.log(f.loss) + np.log(f.samples) * f.model.orders.parameters)
    deliver(task, Said("consistent", (), {}, None, window_rmse(best.model, task.holdout)))


if __name__ == "__main__":
    main()
