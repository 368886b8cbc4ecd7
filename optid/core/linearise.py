"""A model near an operating point as a linear state space with named states, inputs and outputs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from optid.core.clock import CLOCK, INTERVAL
from optid.errors import PlantError, SolveError, nearest

if TYPE_CHECKING:
    import control

    from optid.core.model import Array, Model

STEADY = 1e-9  # 1/s: largest rate of a state, as a share of its usual size, that counts as zero
STRIDE = 0.5  # usual sizes: the longest step of the search, so that it cannot reach negative pressures
PROBE = 1e-6  # of a usual size: the step to each side that detects a kink
KINK = 1e-3  # relative difference of the slopes on both sides beyond which it is a kink
# Of its largest slope: with a smaller own slope, a contact's state follows the motion like a spring.
RELAXES = 1e-3


@dataclass(frozen=True, eq=False)
class Linear:
    """A linearisation; all numbers in SI units, the system's signals being distances from the point.

    Attributes
    ----------
    system : control.StateSpace
        continuous time; states, inputs and outputs carry the model's names. An input taken some
        samples ago is an input of its own, "command@3".
    states : Mapping[str, float]
        the operating point, by name; `inputs` and `outputs` likewise.
    rates : Mapping[str, float]
        1/s times the state's unit; zero but for the states declared `moving`.
    kinks : tuple[str, ...]
        names with respect to which the slope jumps at this point (a valve that is just closed); the system has the
        mean of both sides.
    elastic : tuple[str, ...]
        dimensionless states that only follow a speed here, as the contact of dry friction does at rest, where
        it is a spring.
    """

    system: control.StateSpace
    states: Mapping[str, float]
    inputs: Mapping[str, float]
    outputs: Mapping[str, float]
    rates: Mapping[str, float]
    kinks: tuple[str, ...]
    elastic: tuple[str, ...] = ()

    @property
    def note(self) -> str:
        """Why the linear model is valid for very small motion only, in words; empty otherwise."""
        said = []
        if self.elastic:
            said.append(
                f"Friction holds the axis here: its contact ({', '.join(self.elastic)}) is a spring, and this system "
                "describes the elastic motion before it slides only. Hold a speed and declare the position moving for "
                "the system of the axis as it slides."
            )
        if self.kinks:
            said.append(
                f"The slopes to {', '.join(self.kinks)} jump at this very point: the mean of both sides is held."
            )
        return " ".join(said)


def linearise(
    model: Model,
    parameters: Mapping[str, float],
    held: Mapping[str, float],
    moving: Sequence[str] = (),
    near: Mapping[str, float] | None = None,
) -> Linear:
    """Find the operating point nearest to a guess and linearise there.

    A closed pneumatic axis rests anywhere and at any balanced pair of pressures, so the point is specified by what is
    `held`; all other states and inputs are moved as little as possible (in usual sizes) from their guesses until all
    rates are zero.

    Parameters
    ----------
    model : Model
        the plant.
    parameters : Mapping[str, float]
        SI values by name; the model's defaults elsewhere (a fit's `values`, a rig's `parameters`).
    held : Mapping[str, float]
        states and inputs with a stated value, SI, by name.
    moving : Sequence[str]
        states whose rate need not vanish: the position of an axis at constant speed.
    near : Mapping[str, float] | None
        guesses for the others; without one a state starts at its usual start value, an input at zero. Where a law
        changes at zero, as a valve's does, the guess chooses the side.

    Returns
    -------
    Linear
        the linear system, with a note where it does not hold.

    Raises
    ------
    PlantError
        an unknown name, or no value for the sampling interval of a model that uses it.
    SolveError
        no equilibrium was found; names the state that still changes.
    """
    names = [state.name for state in model.states] + _input_names(model)
    p = model.vector(parameters)
    guess = np.r_[np.array(model.start(p)[0]).ravel(), np.zeros(len(model.inputs))]
    values = {**dict(zip(names, guess.tolist(), strict=True)), **(near or {}), **held}
    for name in (*values, *moving):
        if name not in names:
            raise PlantError(f'no state or input "{name}"', where=model.name, hint=nearest(name, names))
    if INTERVAL in names and not values[INTERVAL] > 0:
        raise PlantError(
            "the equations use the sampling interval, which is not given",
            where=model.name,
            field=INTERVAL,
            expected="its value in s among `held`",
        )
    at = np.array([values[name] for name in names])
    given = {*held, INTERVAL, CLOCK}
    loose = np.array([name not in given for name in names])
    steady = np.array([state.name not in moving for state in model.states])
    slopes = _slopes(model)
    at = _equilibrium(model, slopes, p, at, loose, steady)
    return _linear(model, names, at, *_kinked(model, slopes, p, at))


def _input_names(model: Model) -> list[str]:
    return [port.role if not port.ago else f"{port.role}@{port.ago}" for port in model.inputs]


def _slopes(model: Model) -> ca.Function:
    """(z, p) -> (rates and outputs, their slopes to z), z being states and inputs in one vector."""
    nx = len(model.states)
    z, p = ca.SX.sym("z", nx + len(model.inputs)), ca.SX.sym("p", len(model.parameters))
    values = ca.vertcat(model.rates(z[:nx], z[nx:], p), model.sensors(z[:nx], z[nx:], p))
    return ca.Function("slopes", [z, p], [values, ca.jacobian(values, z)])


def _evaluated(slopes: ca.Function, at: Array, p: Array) -> tuple[Array, Array]:
    values, jacobian = slopes(at, p)
    return np.array(values).ravel(), np.array(jacobian)


def _sizes(model: Model) -> Array:
    return np.asarray(np.r_[model.scales, np.ones(len(model.inputs))])


def _kinked(model: Model, slopes: ca.Function, p: Array, at: Array) -> tuple[Array, Array, Array]:
    """Values and slopes at a point, and to which columns the slope jumps there (the mean of both sides)."""
    values, jacobian = _evaluated(slopes, at, p)
    units = np.r_[model.scales, np.maximum(np.abs(values[len(model.states) :]), 1e-300)]
    jumps = np.zeros(len(at), dtype=bool)
    for k, size in enumerate(_sizes(model)):
        probe = np.zeros(len(at))
        probe[k] = PROBE * size
        below, above = (_evaluated(slopes, at + sign * probe, p)[1][:, k] for sign in (-1, 1))
        largest = float((np.maximum(np.abs(above), np.abs(below)) / units).max())
        jumps[k] = bool((np.abs(above - below) / units > KINK * max(largest, 1e-300)).any())
        if jumps[k]:
            jacobian[:, k] = (above + below) / 2
    return values, jacobian, jumps


def _elastic(model: Model, jacobian: Array) -> Iterator[str]:
    """Dimensionless states that follow a speed without any slope of their own."""
    nx = len(model.states)
    scaled = np.abs(jacobian[:nx, :nx] * model.scales / model.scales[:, None])
    speeds = [k for k, state in enumerate(model.states) if state.unit == "m/s"]
    for k, state in enumerate(model.states):
        follows = max((scaled[k, j] for j in speeds), default=0.0)
        if state.unit == "1" and follows > 0.0 and scaled[k, k] < RELAXES * follows:
            yield state.name


def _equilibrium(
    model: Model, slopes: ca.Function, p: Array, at: Array, loose: Array, steady: Array
) -> Array:
    """Gauss-Newton with steps of least size, halved while they do not pay."""
    nx, scales, sizes = len(model.states), model.scales, _sizes(model) * loose
    rate = _evaluated(slopes, at, p)[0][:nx] / scales * steady
    for _ in range(200):
        if np.abs(rate).max() <= STEADY:
            return at
        slope = _evaluated(slopes, at, p)[1][:nx] / scales[:, None] * sizes * steady[:, None]
        move = -np.linalg.lstsq(slope, rate, rcond=1e-12)[0]
        step, share = move * sizes, min(1.0, STRIDE / max(float(np.abs(move).max()), 1e-300))
        while share > 1e-6:
            new = _evaluated(slopes, at + share * step, p)[0][:nx] / scales * steady
            if np.linalg.norm(new) < np.linalg.norm(rate):
                break
            share /= 2
        else:
            break
        at, rate = at + share * step, new
    worst = int(np.abs(rate).argmax())
    name = model.states[worst]
    raise SolveError(
        f"no operating point was found: {name.name} still changes by {rate[worst] * scales[worst]:.3g} "
        f"{name.unit}/s; hold "
        "less, guess better (`near`), or declare it moving"
    )


def _linear(
    model: Model,
    names: list[str],
    at: Array,
    values: Array,
    jacobian: Array,
    jumps: Array,
) -> Linear:
    import control

    nx = len(model.states)
    # The clock and the sampling interval are not signals that can be moved.
    real = [j for j, name in enumerate(names) if j >= nx and name not in (INTERVAL, CLOCK)]
    inputs, outputs = [names[j] for j in real], [port.role for port in model.outputs]
    system: Any = control.ss(
        jacobian[:nx, :nx],
        jacobian[:nx][:, real],
        jacobian[nx:, :nx],
        jacobian[nx:][:, real],
        states=names[:nx],
        inputs=inputs,
        outputs=outputs,
        name=model.name,
    )
    return Linear(
        system,
        dict(zip(names[:nx], at[:nx].tolist(), strict=True)),
        {names[j]: float(at[j]) for j in real},
        dict(zip(outputs, values[nx:].tolist(), strict=True)),
        dict(zip(names[:nx], values[:nx].tolist(), strict=True)),
        tuple(name for name, jump in zip(names, jumps, strict=True) if jump),
        tuple(_elastic(model, jacobian)),
    )
