"""A model as plain CasADi functions with documented arguments, for a user's own problems."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca

from optid.errors import InputError

if TYPE_CHECKING:
    from optid.core.model import Array, Model

SUBSTEPS = 10  # of a step: with a bristle's stiff contact, 0.1 ms each at 1 kHz


@dataclass(frozen=True, eq=False)
class CasadiFunctions:
    """What `Model.to_casadi` returns; all numbers in SI units.

    Attributes
    ----------
    rhs : ca.Function
        (x, u, p) -> xdot, the right-hand side.
    outputs : ca.Function
        (x, u, p) -> y, the sensors' readings.
    step : ca.Function
        (x, u, p, dt) -> x_next, one hold of the input, by Runge-Kutta steps of fourth order.
    start : ca.Function
        p -> (mean, spread) of the state at a record's start.
    states, inputs, parameters, y : Mapping[str, str]
        name -> unit, in the order of x, u, p and y.
    model : Model
        that they belong to.
    """

    rhs: ca.Function
    outputs: ca.Function
    step: ca.Function
    start: ca.Function
    states: Mapping[str, str]
    inputs: Mapping[str, str]
    parameters: Mapping[str, str]
    y: Mapping[str, str]
    model: Model

    def values(self, named: Mapping[str, float]) -> Array:
        """The vector p from named SI values, such as a rig's `parameters` or a fit's `values`; defaults elsewhere.

        Parameters
        ----------
        named : Mapping[str, float]
            name -> SI value.

        Returns
        -------
        Array
            the vector p, (parameters,).
        """
        return self.model.vector(named)

    def __str__(self) -> str:
        rows = (("x", self.states), ("u", self.inputs), ("p", self.parameters), ("y", self.y))
        return "\n".join(
            f"{letter}: {', '.join(f'{k} ({v})' for k, v in named.items())}" for letter, named in rows
        )


def casadi_functions(model: Model, substeps: int = SUBSTEPS) -> CasadiFunctions:
    """See `Model.to_casadi`."""
    if substeps < 1:
        raise InputError(f"{substeps}", field="substeps", expected="at least 1")
    return CasadiFunctions(
        rhs=model.rates,
        outputs=model.sensors,
        step=_step(model, substeps),
        start=model.start,
        states={state.name: state.unit for state in model.states},
        inputs={port.role if not port.ago else f"{port.role}@{port.ago}": port.unit for port in model.inputs},
        parameters={parameter.name: parameter.unit for parameter in model.parameters},
        y={port.role: port.unit for port in model.outputs},
        model=model,
    )


def _step(model: Model, substeps: int) -> ca.Function:
    """One hold; if an input switches inside it, its two halves in sequence."""
    x, u = ca.SX.sym("x", len(model.states)), ca.SX.sym("u", len(model.inputs))
    p, dt = ca.SX.sym("p", len(model.parameters)), ca.SX.sym("dt")
    rates: list[Any] = [lambda at: model.rates(at, u, p)]
    if (halves := model.halves) is not None:
        rates = [lambda at, half=half: halves(at, u, p, half) for half in (0, 1)]
    each = max(1, substeps // len(rates))
    h, end = dt / (each * len(rates)), x
    for rate in rates:
        slope = ca.Function("slope", [x, u, p], [rate(x)])
        move = ca.Function("move", [x, u, p, dt], [_runge_kutta(slope, x, u, p, dt)])
        for _ in range(each):
            end = move(end, u, p, h)
    return ca.Function("step", [x, u, p, dt], [end], ["x", "u", "p", "dt"], ["x_next"])


def _runge_kutta(slope: ca.Function, x: Any, u: Any, p: Any, h: Any) -> Any:
    a = slope(x, u, p)
    b = slope(x + h / 2 * a, u, p)
    c = slope(x + h / 2 * b, u, p)
    d = slope(x + h * c, u, p)
    return x + h / 6 * (a + 2 * b + 2 * c + d)
