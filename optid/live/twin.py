"""The physical model in parallel with the rig, advanced one sample at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from optid.core.jit import compiled
from optid.core.kernel import advance, at, call
from optid.core.kernel import compiled as compiled_loop
from optid.core.model import CLOCK, INTERVAL, Array, Model

# Local error as a share of each state's size: half a micrometre per second compared with Radau.
TOLERANCE = 1e-6


class Twin:
    """A model that runs in parallel; its state is one array.

    Args:
        model: with one recorded input.
        parameters: SI, shape (parameters,).
        start: state, shape (states,); the model's own start state if absent.
    """

    def __init__(self, model: Model, parameters: Array, start: Array | None = None) -> None:
        self.model, p = model, np.ascontiguousarray(parameters, dtype=float)
        self._machine = compiled(model)
        self._code: Any = self._machine.code
        nx, ny = len(model.states), len(model.outputs)
        self._c, self._k, self._y = np.empty(self._code.hoisted), np.empty(nx + 1), np.empty(ny + 1)
        _prepare(self._code, p, self._c)
        self._tolerance, self._u = TOLERANCE * model.scales, np.zeros(len(model.inputs))
        self._past = [0.0] * (1 + max((port.ago for port in model.inputs), default=0))
        made = (INTERVAL, CLOCK)
        self._held = [(j, port.ago) for j, port in enumerate(model.inputs) if port.role not in made]
        self._made = [(j, port.role) for j, port in enumerate(model.inputs) if port.role in made]
        mean, self._spread = (np.asarray(part, dtype=float).ravel() for part in model.start(p))
        self._first = np.array(mean if start is None else start, dtype=float)
        self.x = np.empty(nx)
        self._begin()
        self.advance(0.0, 1e-6)  # compiles or loads now, so that no sample waits for it
        self._begin()

    def _begin(self) -> None:
        self.x[:], self.time, self._h = self._first, 0.0, 1e-3
        _sense(self._code, self.x, self._u, self._c, self._y)

    def advance(self, command: float, span: float) -> bool:
        """Hold a command, in the model's unit, for `span` seconds; False where the simulation diverges."""
        self._input(command, span)
        h = _hold(
            self._code, self.x, self._u, self._c, self._k, self._tolerance, span, min(self._h, span), self._y
        )
        return self._sane(h, span)

    def outputs(self) -> Array:
        """The outputs at the end of the last hold, shape (outputs,); valid until the next call."""
        return self._y[:-1]

    def copy(self, other: Twin) -> None:
        """Continue from another twin of the same model."""
        self.x[:], self._y[:] = other.x, other._y
        self.time, self._past[:] = other.time, other._past

    def _input(self, command: float, span: float) -> None:
        past = self._past
        if len(past) > 1:
            past.insert(0, command)
            past.pop()
        past[0] = command
        for j, ago in self._held:
            self._u[j] = past[ago]
        for j, role in self._made:
            self._u[j] = span if role == INTERVAL else self.time + span / 2

    def _sane(self, h: float, span: float) -> bool:
        self.time += span
        if h < 0.0:
            self.x[:], self._h = self._first, 1e-3
            _sense(self._code, self.x, self._u, self._c, self._y)
            return False
        self._h = h
        return True


@compiled_loop
def _prepare(code, p, c):  # type: ignore[no-untyped-def]
    """The constants of a set of parameters."""
    call(code.constants, (at(p, 0), at(c, 0)))


@compiled_loop
def _hold(code, x, u, c, k, tolerance, span, h, y):  # type: ignore[no-untyped-def]
    """One hold and the outputs at its end; the next step size, negative on failure."""
    here, none = at(x, 0), at(k, 0)  # the placeholder for slopes is never used
    h = advance(
        code.rates, code.step, code.half, here, none, at(u, 0), at(c, 0), k, none, at(tolerance, 0), span, h
    )
    call(code.sensors, (here, none, at(u, 0), at(c, 0), at(y, 0), none))
    return h


@compiled_loop
def _sense(code, x, u, c, y):  # type: ignore[no-untyped-def]
    """The outputs."""
    call(code.sensors, (at(x, 0), at(x, 0), at(u, 0), at(c, 0), at(y, 0), at(x, 0)))
