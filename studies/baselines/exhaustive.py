"""Baseline: brute force. Every effect of the catalogue alone, refitted with all parameters; BIC chooses.

Forty fits of all recordings are long: they are fits of the simulation error, of recordings averaged down to 250 Hz, and
each begins where the base model was fitted. Where the form of an effect does not show in a recording, its strength
alone is refitted.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # finds the studies beside it from any folder

from optid.core.decimation import decimated
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.errors import NotIdentifiable, OptidError
from optid.estimation.multiple_shooting import FitOptions, fit
from optid.estimation.prediction import predict
from optid.estimation.result import Fit
from optid.rigs.rigfile import Rig, with_effects
from studies.baselines.task import Said, Task, asked, deliver, finding, parameters, window_rmse

OPTIONS = FitOptions(process_noise=0.0, time_limit=120.0)
RATE = 250.0  # Hz


def slower(task: Task) -> Task:
    """The same with recordings to fit of `RATE`, whose noise is not the rig file's; what is held out stays."""
    commands = [port.role for port in task.rig.model.recorded]
    train = tuple(decimated(one, commands, RATE) for one in task.train)
    channels = {role: replace(channel, sd=None) for role, channel in task.rig.channels.items()}
    return replace(task, rig=replace(task.rig, channels=channels), train=train)


def beginning_at(task: Task, base: Fit) -> Task:
    """The same with what was fitted as start values."""
    return replace(task, rig=replace(task.rig, parameters={**task.rig.parameters, **base.values}))


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
    strengths = [f"{effect.name}.{name}" for name in effect.strength]
    known = tuple(one for one in rig.freed if one in task.rig.freed or one.name in strengths)
    for tried in (rig, replace(rig, freed=known)):
        try:
            found = fit(tried, task.train, OPTIONS)
            return bic(task, tried, found), found, tried, effect
        except NotIdentifiable:
            continue
        except (OptidError, np.linalg.LinAlgError):
            return None
    return None


def main() -> None:
    """Answer the task."""
    task = slower(asked())
    base = fit(task.rig, task.train, OPTIONS)
    plain, before = bic(task, task.rig, base), window_rmse(task.rig, task.holdout, base)
    begun = beginning_at(task, base)
    tried = [a for effect in admitted(task.rig.model) if (a := attempt(begun, effect)) is not None]
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
