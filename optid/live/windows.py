"""One-step estimates from a session's own log: short windows of the physical model from the observer's states.

The observer of the loop (`optid.live.observer`) runs over the stretch; from its state before each window the model is
simulated with the applied command, and again with each parameter, and each effect, moved a little. A linear regression
gives the moves that explain the windows' errors best, as for a fleet's night (`optid.monitoring.one_step`, whose
fixed-gain filter diverges from an axis at rest for long).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from statistics import fmean, stdev

import numpy as np

from optid.core.model import Array, Model
from optid.core.recording import Recording
from optid.effects.effect import Effect
from optid.estimation.problem import HORIZON
from optid.live.commissioning import DRAWS
from optid.live.observer import Observer
from optid.live.settings import Wiring
from optid.live.twin import Twin
from optid.monitoring.one_step import NUDGE, Quantity, WindowErrors, explained, points, share
from optid.rigs.rigfile import Rig, with_effects

RATE = 250.0  # Hz at most: the rate at which windows hold their commands
WINDOW = HORIZON  # s
SETTLED = 2  # windows after which the observer knows where the rig stands


@dataclass(frozen=True, eq=False)
class Stretch:
    """The data on which the model is run.

    Attributes:
        commands: over each hold, in the model's unit, shape (samples,).
        spans: length of each hold, s, (samples,).
        measured: at the end of each hold, SI, (samples, outputs); NaN is missing.
        starts: holds with which windows begin, (windows,).
        states: of the model there, (windows, states).
        sd: by which errors are scaled, (outputs,).
    """

    commands: Array
    spans: Array
    measured: Array
    starts: list[int]
    states: list[Array]
    sd: Array


def estimates(
    rig: Rig, wiring: Wiring, recording: Recording, effects: Sequence[Effect], pull: float
) -> dict[str, Quantity]:
    """Estimates of each fitted parameter and of each strength of each effect from a stretch, SI.

    An observer lags and friction is no straight line, so the estimates are off even on a rig that is as its file says.
    By how much, and how that scatters, is seen on such rigs: simulated along the same path with the sensors' noise
    (parametric bootstrap; Efron and Tibshirani, An Introduction to the Bootstrap, 1993, ch. 6). Their mean is taken
    off, their scatter is the least sd, and what they explain without being any different explains nothing.

    Args:
        rig: its model is simulated.
        wiring: of the session.
        recording: the stretch of the log.
        effects: that the plant admits.
        pull: what is added to the command for each m that the simulated rig is off the path, V/m.
    """
    p = rig.model.vector(rig.parameters)
    fine, *holds = _holds(rig, wiring, recording)
    stretch = _observed(rig, wiring, holds, p)
    real = _one_step(rig, stretch, p, effects)
    same = []
    for seed in range(DRAWS):
        steered = _steered(rig, wiring, stretch, (p, fine, pull), np.random.default_rng(seed))
        same.append(_one_step(rig, _observed(rig, wiring, steered, p, stretch.states[0]), p, effects))
    stated = dict(rig.parameters) | {k: v for one in effects for k, v in one.qualified(one.at_null()).items()}
    shared = [name for name in real if name in stated and all(name in draw for draw in same)]
    return {name: _beside(real[name], [draw[name] for draw in same], stated[name]) for name in shared}


def _beside(real: Quantity, same: Sequence[Quantity], stated: float) -> Quantity:
    """An estimate beside those of rigs that are as stated."""
    values = [one.value for one in same]
    sd = max(real.sd, stdev(values)) * math.sqrt(1.0 + 1.0 / len(values))
    explained = real.explained - max(one.explained for one in same)
    return Quantity(real.value - fmean(values) + stated, sd, real.unit, max(explained, 0.0))


def _one_step(rig: Rig, stretch: Stretch, p: Array, effects: Sequence[Effect]) -> dict[str, Quantity]:
    """What one regression each says."""
    base = _run(rig.model, rig.model, p, stretch)
    scaled = (base - stretch.measured) / stretch.sd
    known = np.isfinite(scaled) & (stretch.starts[0] <= np.arange(len(scaled)))[:, None]
    window = np.searchsorted(stretch.starts, np.arange(len(scaled)), side="right")
    cluster = np.broadcast_to(window[:, None], known.shape)[known]

    def slope(model: Model, vector: Array, step: float) -> Array:
        moved: Array = ((_run(rig.model, model, vector, stretch) - base) / stretch.sd)[known] / step
        return np.nan_to_num(moved)

    names = [one.name for one in rig.model.parameters]
    free = [names.index(one.name) for one in rig.freed if one.name in rig.parameters]
    slopes = []
    for i in free:
        step = NUDGE * max(abs(p[i]), abs(rig.model.parameters[i].typical))
        slopes.append(slope(rig.model, p + step * (np.arange(len(p)) == i), step))
    errors = WindowErrors(
        scaled[known], np.column_stack(slopes) if slopes else np.zeros((known.sum(), 0)), cluster
    )
    moved, sd = explained(errors, errors.slopes)
    found = {
        names[i]: Quantity(
            float(p[i] + moved[k]), float(sd[k]), rig.model.parameters[i].unit, share(errors, slopes[k])
        )
        for k, i in enumerate(free)
    }
    for effect in effects:
        wide, null = _with(rig, effect), effect.at_null()
        units = {one.name: one.unit for one in effect.parameters}
        for name, point, step in points(effect):
            vector = wide.model.vector({**rig.parameters, **effect.qualified(point)})
            column = slope(wide.model, vector, step)
            moved, sd = explained(errors, np.column_stack([errors.slopes, column]))
            if sd[-1] > 0.0:
                value, part = null[name] + float(moved[-1]), share(errors, column)
                found[f"{effect.name}.{name}"] = Quantity(value, float(sd[-1]), units[name], part)
    return found


@lru_cache(maxsize=128)
def _with(rig: Rig, effect: Effect) -> Rig:
    """Cached, so that the model is compiled once."""
    return with_effects(rig, (effect,))


def _holds(rig: Rig, wiring: Wiring, recording: Recording) -> tuple[Array, Array, Array, Array]:
    """Commands as put in each hold, (holds, several), their means, the holds' lengths, s, and the measured ends."""
    roles, time = [port.role for port in rig.model.outputs], recording.time
    every = max(1, math.ceil((len(time) - 1) / (time[-1] - time[0]) / RATE - 1e-6))
    command = recording[wiring.command.role].values
    holds = len(time) // every * every - every
    at = np.arange(every, holds + 1, every)
    measured = np.full((len(at), len(roles)), np.nan)
    for channel in wiring.measured:
        measured[:, roles.index(channel.role)] = recording[channel.role].values[at]
    fine = command[:holds].reshape(-1, every)
    return (
        fine,
        np.nanmean(fine, axis=1),
        np.diff(np.r_[time[0], time[at]]),
        measured,
    )


def _observed(
    rig: Rig, wiring: Wiring, holds: Sequence[Array], p: Array, start: Array | None = None
) -> Stretch:
    """The observer over the whole of it, and where it stood before each window."""
    (commands, spans, measured), roles = holds, [port.role for port in rig.model.outputs]
    noise = np.full(len(roles), np.nan)
    for channel in wiring.measured:
        noise[roles.index(channel.role)] = math.nan if channel.sd is None else channel.sd
    observer, starts, states, following, time = Observer(rig.model, p, noise, start), [], [], 0.0, 0.0
    for k, span in enumerate(spans):
        if time + span >= following:
            following += WINDOW
            starts.append(k)
            states.append(observer.x.copy())
        observer.advance(float(commands[k]), float(span))
        observer.correct(measured[k])
        time += span
    sd = np.where(observer.noise > 0.0, observer.noise, 1.0)
    return Stretch(commands, spans, measured, starts[SETTLED:], states[SETTLED:], sd)


def _steered(
    rig: Rig,
    wiring: Wiring,
    stretch: Stretch,
    how: tuple[Array, Array, float],
    rng: np.random.Generator,
) -> tuple[Array, Array, Array]:
    """Holds of a rig that is as its file says, from where the observer stood on, kept on the path of the real one.

    Args:
        rig, wiring, stretch: as observed.
        how: its parameters, the commands as they were put in each hold, (holds, several), and the pull.
        rng: of the sensors' noise.
    """
    p, fine, pull = how
    twin, first = Twin(rig.model, p, stretch.states[0]), stretch.starts[0]
    position = [port.role for port in rig.model.outputs].index(wiring.measured[0].role)
    commands, spans = stretch.commands[first:].copy(), stretch.spans[first:]
    measured, off = np.full_like(stretch.measured[first:], np.nan), 0.0
    for k, real in enumerate(stretch.measured[first:]):
        puts = fine[first + k] + pull * off / wiring.command.per_unit
        commands[k] = np.nanmean(puts)  # the windows know no more
        known = np.nan_to_num(puts, nan=commands[k])
        if not all(twin.advance(float(u), float(spans[k]) / len(puts)) for u in known):
            break
        outputs = np.asarray(twin.outputs(), dtype=float)
        off = float(np.nan_to_num(real[position] - outputs[position]))
        measured[k] = outputs + np.where(np.isnan(real), np.nan, stretch.sd * rng.standard_normal(len(real)))
    return commands, spans, measured


def _run(base: Model, model: Model, vector: Array, stretch: Stretch) -> Array:
    """Outputs of a model at the end of each hold, windows from the states of the base model, (samples, outputs)."""
    twin, names = Twin(model, vector), [one.name for one in model.states]
    places = [names.index(one.name) for one in base.states]
    outputs = np.full(stretch.measured.shape, np.nan)
    ends = [*stretch.starts[1:], len(outputs)]
    first = twin.x.copy()
    for start, end, state in zip(stretch.starts, ends, stretch.states, strict=True):
        twin.x[:] = first
        twin.x[places] = state
        past = [float(stretch.commands[max(start - 1 - ago, 0)]) for ago in range(len(twin._past))]
        twin._past[:] = past
        for k in range(start, end):
            if not twin.advance(float(stretch.commands[k]), float(stretch.spans[k])):
                break
            outputs[k] = twin.outputs()
    return outputs
