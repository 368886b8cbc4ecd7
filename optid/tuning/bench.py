"""The same controller on the full physical model of a rig: friction, dead band and all that no discrete model knows."""

from __future__ import annotations

from typing import Any

import numpy as np

from optid.core.compiled import compiled as machine_code
from optid.core.kernel import advance, at, call
from optid.core.model import CLOCK, INTERVAL, Array
from optid.core.threads import spread
from optid.errors import InputError
from optid.pid.controller import Gains, Settings
from optid.pid.law import GAINS, LAST_COMMAND, MEMORY, law
from optid.rigs.rigfile import Rig
from optid.tuning.criterion import Criterion
from optid.tuning.demand import Episode
from optid.tuning.machine import compiled
from optid.tuning.score import Response, response

SEED = 1  # of the sensor's noise
TOLERANCE = 1e-6  # local error as a share of each state's size: micrometres in a second


class PhysicalBench:
    """Runs gains on a rig's model.

    With a sensor's noise, always the same one: an axis that just sticks or just slips in a clean simulation does the
    other on a bench, and gains must not live on that.

    Args:
        rig: with one command; its file says what a full command is.
        episodes: to run, distances from where the rig starts.
        output: role of the controlled output.
        noise: sd of what the controller's sensor adds, output's unit.

    Raises:
        InputError: the rig has no such output, or not one command.
    """

    def __init__(
        self, rig: Rig, episodes: tuple[Episode, ...], output: str = "position", noise: float = 0.0
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
        self.rig, self._episodes, self._column = rig, episodes, roles.index(output)
        self._parameters = np.ascontiguousarray(rig.model.vector(rig.parameters), dtype=float)
        shape = (len(episodes), max((episode.reference.size for episode in episodes), default=0))
        self._noise = noise * np.random.default_rng(SEED).standard_normal(shape)
        self._per_unit = rig.channels[recorded[0]].per_unit
        self._start = np.array(rig.model.start(self._parameters)[0], dtype=float).ravel()
        # What each input of the model is fed: the command so many samples ago, or -1 the interval, -2 the clock.
        self._feeds = np.array([
            {INTERVAL: -1, CLOCK: -2}.get(port.role, port.ago) for port in rig.model.inputs
        ], dtype=np.int64)  # fmt: skip

    def __call__(self, gains: Gains, settings: Settings) -> tuple[Response, ...]:
        """One response an episode; NaN from where the equations leave the numbers."""
        vector = np.r_[gains.vector, settings.vector]
        runs = (self._run(vector, settings, e, n) for e, n in zip(self._episodes, self._noise, strict=True))
        return tuple(
            response(episode, y, u, settings.sample_time)
            for episode, (y, u) in zip(self._episodes, runs, strict=True)
        )

    def costs(self, gains: Array, settings: Settings, criterion: Criterion, command_size: float) -> Array:
        """Of gains (n, GAINS), shape (n,): the weighted sum over the episodes."""
        found = np.empty(len(gains))

        def run(first: int, last: int) -> None:
            for i in range(first, last):
                runs = self(Gains(*gains[i].tolist()), settings)
                costs = (r.episode.weight * criterion.of(r, settings.sample_time, command_size) for r in runs)
                found[i] = sum(costs)

        spread(len(gains), run)
        return found

    def _run(self, vector: Array, settings: Settings, episode: Episode, noise: Array) -> tuple[Array, Array]:
        n = episode.reference.size
        y, u = np.full(n, np.nan), np.full(n, np.nan)
        scales = TOLERANCE * np.asarray(self.rig.model.scales, dtype=float)
        outputs = len(self.rig.model.outputs)
        machine_code(self.rig.model).run(
            _closed, vector, settings.sample_time, self._start, self._parameters, self._feeds, 1.0 / self._per_unit,
            scales, episode.reference, episode.load, noise, outputs, self._column, y, u,
        )  # fmt: skip
        return y, u


@compiled
def _closed(
    code: Any, s: Any, T: Any, start: Any, p: Any, feeds: Any, share: Any, tolerance: Any, reference: Any, load: Any,
    noise: Any, outputs: Any, column: Any, y: Any, u: Any,
) -> None:  # fmt: skip
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
