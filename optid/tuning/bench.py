"""The same controller on the full physical model of a rig, with friction, dead band and other nonlinearities."""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np

from optid.core.jit import compiled as machine_code
from optid.core.jit import compiled_lanes
from optid.core.kernel import advance, at, call
from optid.core.llvm_simd import LANES
from optid.core.model import CLOCK, INTERVAL, Array
from optid.core.threads import parallel_for
from optid.errors import InputError
from optid.pid.controller import Gains, Settings
from optid.pid.pid_step import GAINS, LAST_COMMAND, MEMORY, law
from optid.rigs.rigfile import Rig
from optid.tuning.criterion import Criterion
from optid.tuning.loop import HUNTING, PARTS
from optid.tuning.machine import compiled
from optid.tuning.response_metrics import Response, response
from optid.tuning.scenarios import Episode
from optid.tuning.simulation_lanes import measured

SEED = 1  # of the sensor's noise
EXPLICIT = 1e-5  # largest tolerance of single runs
TOLERANCE = 1e-6  # local error as a share of each state's size: micrometres in a second


class Bench:
    """Runs gains on an axis of any kind: the result of `_run` for an episode is measured and summed here."""

    def __init__(self, episodes: tuple[Episode, ...]) -> None:
        self._episodes = episodes
        self._hunting_alone = False

    @property
    def episodes(self) -> tuple[Episode, ...]:
        """That are run."""
        return self._episodes

    def __call__(self, gains: Gains, settings: Settings) -> tuple[Response, ...]:
        """One response per episode; NaN from where the simulation diverges."""
        vector, found = np.r_[gains.vector, settings.vector], {}

        def run(first: int, last: int) -> None:
            for e in range(first, last):
                found[e] = response(
                    self._episodes[e], *self._run(vector, settings, self._episodes[e]), settings.sample_time
                )

        parallel_for(len(self._episodes), run)
        return tuple(found[e] for e in range(len(self._episodes)))

    def costs(self, gains: Array, settings: Settings, criterion: Criterion, command_size: float) -> Array:
        """Of gains (n, GAINS), shape (n,): the weighted sum over the episodes."""
        return self.judged(gains, settings, criterion, command_size)[0]

    def judged(
        self,
        gains: Array,
        settings: Settings,
        criterion: Criterion,
        command_size: float,
        bar: Array | None = None,
        rest: float = math.inf,
    ) -> tuple[Array, Array]:
        """Of gains (n, GAINS): their costs, the weighted sum over the episodes, and their largest hunting, each (n,).

        Args:
            gains: candidates.
            settings: of the controller.
            criterion: what is summed.
            command_size: unit of the command's total variation.
            bar: shape (n,); a candidate whose sum exceeds it is stopped, and its cost is the sum so far.
            rest: peak to peak at rest beyond which an episode's cost grows quadratically.
        """
        cost, hunting = np.zeros(len(gains)), np.zeros(len(gains))
        T, lock = settings.sample_time, threading.Lock()

        def run(first: int, last: int) -> None:
            for job in range(first, last):
                i, e = divmod(job, len(self._episodes))
                if bar is not None and not cost[i] <= bar[i]:
                    continue
                vector = np.r_[gains[i], settings.vector]
                episode = self._episodes[e]
                one = response(episode, *self._run(vector, settings, episode), T)
                with lock:
                    times = float(_times(np.array(one.hunting), rest)) - self._hunting_alone
                    if times > 0.0:
                        cost[i] += episode.weight * criterion.of(one, T, command_size) * times
                    hunting[i] = max(hunting[i], one.hunting)

        parallel_for(len(gains) * len(self._episodes), run)
        return cost, hunting

    def against_hunting(self) -> Bench:
        """The same, whose cost is only what hunting adds to it."""
        guard = copy(self)
        guard._hunting_alone = True
        return guard

    def only(self, chosen: Sequence[int]) -> Bench:
        """The same with some of its episodes, by number."""
        part = copy(self)
        part._episodes = tuple(self._episodes[e] for e in chosen)
        return part

    def _run(self, vector: Array, settings: Settings, episode: Episode) -> tuple[Array, Array]:
        """Output and command of one episode, each (samples,), of gains and settings in one vector."""
        raise NotImplementedError


def _times(swings: Array, rest: float) -> Array:
    """Factor on the cost of episodes that oscillate at rest by `swings`, of the same shape; 1 for no limit.

    Squared, so that gains that hunt once in a hundred steps do not win by being slightly faster in the others.
    """
    return np.maximum(swings / rest, 1.0) ** 2 if math.isfinite(rest) else np.ones_like(swings)


class PhysicalBench(Bench):
    """Runs gains on a rig's model.

    With a fixed realisation of sensor noise: an axis that just sticks or just slips in a noise-free simulation may do
    the other on the rig, and gains must not depend on that.

    Args:
        rig: with one command, whose full scale its file states.
        episodes: to run, distances from where the rig starts.
        output: role of the controlled output.
        noise: sd of sensor noise added to all episodes, output's unit, in addition to their own noise.
        variants: parameter values by name in place of the rig's, SI: episodes of variant k > 0 run with the k-th.
        tolerance: local error of the integration as a share of each state's size.

    Raises:
        InputError: the rig has no such output, or not one command.
    """

    def __init__(
        self,
        rig: Rig,
        episodes: tuple[Episode, ...],
        output: str = "position",
        noise: float = 0.0,
        variants: tuple[Mapping[str, float], ...] = (),
        tolerance: float = TOLERANCE,
    ) -> None:
        recorded = [port.role for port in rig.model.recorded]
        roles = [port.role for port in rig.model.outputs]
        if len(recorded) != 1:
            raise InputError(
                f"inputs {', '.join(recorded)}", where=rig.path, field="model", expected="one command"
            )
        if output not in roles:
            raise InputError(
                f'no output "{output}"', where=rig.path, field="model", expected=", ".join(roles)
            )
        super().__init__(tuple(_noisier(e, k, noise, episodes) for k, e in enumerate(episodes)))
        self.rig, self._column = rig, roles.index(output)
        values = [rig.parameters, *({**rig.parameters, **variant} for variant in variants)]
        self._parameters = np.array([rig.model.vector(one) for one in values], dtype=float)
        self._starts = np.array(
            [np.array(rig.model.start(p)[0], dtype=float).ravel() for p in self._parameters]
        )
        self._per_unit = rig.channels[recorded[0]].per_unit
        self._scales = tolerance * np.asarray(rig.model.scales, dtype=float)
        # A single run uses explicit steps, which must be finer for the same cost.
        self._finer = min(tolerance, EXPLICIT) * np.asarray(rig.model.scales, dtype=float)
        # The source of each input of the model: the command, delayed by this many samples, or -1 the interval, -2 the
        # clock.
        self._feeds = np.array(
            [{INTERVAL: -1, CLOCK: -2}.get(port.role, port.ago) for port in rig.model.inputs], dtype=np.int64
        )

    def judged(
        self,
        gains: Array,
        settings: Settings,
        criterion: Criterion,
        command_size: float,
        bar: Array | None = None,
        rest: float = math.inf,
    ) -> tuple[Array, Array]:
        """As for any bench, several runs at a time; a user's own criterion needs trajectories, one by one."""
        if criterion.own is not None:
            return super().judged(gains, settings, criterion, command_size, bar, rest)
        cost, hunting = np.zeros(len(gains)), np.zeros(len(gains))
        groups, lock = -(-len(self._episodes) // LANES), threading.Lock()

        def run(first: int, last: int) -> None:
            for job in range(first, last):
                i, group = divmod(job, groups)
                if bar is not None and not cost[i] <= bar[i]:
                    continue
                chosen = range(LANES * group, min(LANES * (group + 1), len(self._episodes)))
                parts = self._parts(np.r_[gains[i], settings.vector], settings, criterion, chosen)
                parts[:, 1] /= command_size
                weights = np.array([self._episodes[e].weight for e in chosen])
                swings = np.nan_to_num(parts[:, HUNTING], nan=np.inf)
                with lock:
                    cost[i] += float(weights @ (criterion.combined(parts) * _times(swings, rest)))
                    hunting[i] = max(hunting[i], float(swings.max()))

        parallel_for(len(gains) * groups, run)
        return cost, hunting

    def _parts(self, vector: Array, settings: Settings, criterion: Criterion, chosen: Sequence[int]) -> Array:
        """Parts of the cost of some episodes, shape (chosen, PARTS); infinite where a loop diverges."""
        lanes = [chosen[min(lane, len(chosen) - 1)] for lane in range(LANES)]
        found = self._together(vector, settings, criterion, lanes)
        if found is None:  # one of them has diverged: run each alone
            alone = [self._together(vector, settings, criterion, [e] * LANES) for e in chosen]
            return np.array([np.full(PARTS, np.inf) if one is None else one[0] for one in alone])
        return found[: len(chosen)]

    def _together(
        self, vector: Array, settings: Settings, criterion: Criterion, lanes: Sequence[int]
    ) -> Array | None:
        """Parts (LANES, PARTS) of the episodes in the lanes; None where they cannot advance together."""
        T, every = settings.sample_time, [self._episodes[e] for e in lanes]
        sets = [min(one.variant, len(self._parameters) - 1) for one in every]
        plant = (
            self._starts[sets],
            self._parameters[sets],
            self._scales,
            len(self.rig.model.outputs),
            self._column,
        )
        weights = [criterion.measure.weights(one.clock, T) for one in every]
        arrays = (
            *(np.array([getattr(one, name) for one in every]) for name in ("reference", "load", "noise")),
            np.array(weights),
            np.array([one.rise for one in every]),
            np.array([float(one.rest) for one in every]),
        )
        parts = np.empty((LANES, PARTS))
        lanes_code = compiled_lanes(self.rig.model)  # owns the machine code while it runs
        done = measured(
            lanes_code.code,
            np.tile(vector, (LANES, 1)),
            T,
            plant,
            self._feeds,
            np.array([one.gain for one in every]) / self._per_unit,
            arrays,
            criterion.measure.power == 2,
            parts,
        )
        return parts if done else None

    def _run(self, vector: Array, settings: Settings, episode: Episode) -> tuple[Array, Array]:
        n = episode.reference.size
        y, u = np.full(n, np.nan), np.full(n, np.nan)
        variant = min(episode.variant, len(self._parameters) - 1)
        machine_code(self.rig.model).run(
            _closed,
            vector,
            settings.sample_time,
            self._starts[variant],
            self._parameters[variant],
            self._feeds,
            episode.gain / self._per_unit,
            self._finer,
            episode.reference,
            episode.load,
            episode.noise,
            len(self.rig.model.outputs),
            self._column,
            y,
            u,
        )
        return y, u


def _noisier(episode: Episode, number: int, noise: float, every: tuple[Episode, ...]) -> Episode:
    """With the bench's own noise added to the episode's."""
    if noise == 0.0:
        return episode
    longest = max(one.reference.size for one in every)
    rows = np.random.default_rng(SEED).standard_normal((len(every), longest))
    return replace(episode, noise=episode.noise + noise * rows[number, : episode.reference.size])


@compiled
def _closed(
    code: Any,
    s: Any,
    T: Any,
    start: Any,
    p: Any,
    feeds: Any,
    share: Any,
    tolerance: Any,
    reference: Any,
    load: Any,
    noise: Any,
    outputs: Any,
    column: Any,
    y: Any,
    u: Any,
) -> None:
    """One episode: sample, control, hold; distances from the output at the start."""
    x, held, k = start.copy(), np.zeros(feeds.size), np.empty(start.size + 1)
    c, out, m = np.empty(code.hoisted), np.empty(outputs + 1), np.zeros(MEMORY)
    m[LAST_COMMAND] = min(max(0.0, s[GAINS + 1]), s[GAINS + 2])
    past = np.full(max(feeds.max(), 0) + 1, m[LAST_COMMAND] * share)
    call(code.constants, (at(p, 0), at(c, 0)))
    none, h, zero = at(k, 0), 0.1 * T, 0.0
    for n in range(reference.size):
        for j in range(feeds.size):
            held[j] = T if feeds[j] == -1 else (n + 0.5) * T if feeds[j] == -2 else past[feeds[j]]
        call(code.sensors, (at(x, 0), none, at(held, 0), at(c, 0), at(out, 0), none))
        if n == 0:
            zero = out[column]
        y[n] = out[column] - zero
        u[n] = law(s, m, reference[n], y[n] + noise[n])
        for j in range(past.size - 1, 0, -1):
            past[j] = past[j - 1]
        past[0] = (u[n] + load[n]) * share
        for j in range(feeds.size):
            if feeds[j] >= 0:
                held[j] = past[feeds[j]]
        h = advance(
            code.rates,
            code.step,
            code.half,
            at(x, 0),
            none,
            at(held, 0),
            at(c, 0),
            k,
            none,
            at(tolerance, 0),
            T,
            min(h, T),
        )
        if h < 0.0:
            y[n + 1 :] = np.nan
            u[n + 1 :] = np.nan
            return
