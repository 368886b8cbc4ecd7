"""Baseline: brute force. Every effect of the catalogue alone, refitted with all parameters; BIC chooses."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # finds the studies beside it from any folder

from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.errors import OptidError
from optid.fit.batch import FitOptions, fit
from optid.fit.prediction import predict
from optid.fit.result import Fit
from optid.rigs.rigfile import Rig, with_effects
from studies.baselines.task import Said, Task, asked, deliver, finding, parameters, window_rmse

OPTIONS = FitOptions(time_limit=120.0)


def bic(task: Task, rig: Rig, found: Fit) -> float:
    """From the windowed predictions of the recordings that were fitted, every sample counted as news."""
    total = len(found.parameters) * math.log(sum(len(r) for r in task.train))
    for recording in task.train:
        scores = predict(rig, recording, found.values, found.process_noise).scores["window"]
        total += sum(2 * len(recording) * math.log(score.rmse) for score in scores.values())
    return total


def attempt(task: Task, effect: Effect) -> tuple[float, Fit, Rig, Effect] | None:
    """The effect's refit from its first usual point; None if it comes to nothing."""
    rig = with_effects(task.rig, (effect,), effect.qualified(effect.usual[0]))
    try:
        found = fit(rig, task.train, OPTIONS)
        return bic(task, rig, found), found, rig, effect
    except (OptidError, np.linalg.LinAlgError):
        return None


def main() -> None:
    """Answer the task."""
    task = asked()
    base = fit(task.rig, task.train, OPTIONS)
    plain, before = bic(task, task.rig, base), window_rmse(task.rig, task.holdout, base)
    tried = [a for effect in admitted(task.rig.model) if (a := attempt(task, effect)) is not None]
    best = min(tried, key=lambda a: a[0], default=None)
    if best is None or best[0] >= plain:
        deliver(task, Said("consistent", (), parameters(base), before, before))
        return
    _, found, rig, effect = best
    values = parameters(found)
    own = {name: values[full] for full in values if (name := full.removeprefix(f"{effect.name}.")) != full}
    after = window_rmse(rig, task.holdout, found)
    named = finding(effect.name, effect.site, own)
    deliver(task, Said("missing-physics", (named,), parameters(base), before, after))


if __name__ == "__main__":
    main()
