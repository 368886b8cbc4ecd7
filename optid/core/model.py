"""A frozen model: named states, inputs, outputs and parameters with CasADi functions over them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from optid.core.axis import Axis
from optid.core.clock import CLOCK as CLOCK
from optid.core.clock import INTERVAL as INTERVAL
from optid.core.parameter import Parameter
from optid.errors import PlantError, nearest

if TYPE_CHECKING:
    from optid.core.casadi_functions import CasadiFunctions
    from optid.core.linearise import Linear

Array = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """A state variable; `scale` is its usual size in `unit`."""

    name: str
    unit: str
    scale: float


@dataclass(frozen=True)
class Port:
    """An input or output: its role, which a recording's channel can take, its SI unit, and its delay in samples.

    `idle` is the input at which the plant stays at rest, where there is one such value.
    """

    role: str
    unit: str
    ago: int = 0
    idle: float | None = None


@dataclass(frozen=True, eq=False)
class Constraint:
    """A condition on parameters without which they describe nothing that can be built.

    Attributes
    ----------
    words : str
        what must hold, as a sentence: "the rod is thinner than the bore".
    parameters : tuple[str, ...]
        names of the parameters in it.
    margin : ca.Function
        p -> a number that is positive where it holds.
    """

    words: str
    parameters: tuple[str, ...]
    margin: ca.Function

    def holds(self, p: Array) -> bool:
        """Whether it holds at these parameters."""
        return bool(float(self.margin(p)) > 0.0)


@dataclass(frozen=True, eq=False)
class Model:
    """Equations of a plant in SI units.

    Attributes
    ----------
    name : str
        of the plant.
    states, inputs, outputs, parameters : tuple
        in the order of x, u, y and p: each with its name or role, and its unit.
    effects : tuple[str, ...]
        names of those that act in it.
    sites : tuple[str, ...]
        where effects can act.
    sizes : tuple[float, ...]
        usual size of the signal at each site, SI; 0 where the signal is zero without an effect.
    site_units : tuple[str, ...]
        SI unit of the signal at each site; "" where the plant does not state it.
    near : tuple[tuple[str, ...], ...]
        names of the signals that the plant declares near each site.
    rates : ca.Function
        (x, u, p) -> dx/dt.
    sensors : ca.Function
        (x, u, p) -> y.
    start : ca.Function
        p -> (mean, spread) of the state at the start of a recording, without data.
    halves : ca.Function | None
        (x, u, p, half) -> dx/dt of the two halves, 0 and 1, of a hold in which an input switches, each half
        stretched to take as long as the other; None where inputs change at samples only. `rates` then holds the
        mean of what is held before and after.
    form_error : float | None
        share of the squared error that named effects may leave: the right effects, in another functional form, leave
        more in at most one of 20 blind cases; None where this was not measured.
    suspects : tuple[tuple[str, ...], ...]
        groups of sites at which unknown physics may act; a diagnosis estimates an unknown input there.
    scalable : tuple[str, ...]
        sites of a magnitude whose sign is set elsewhere, as that of dry friction.
    biases : Mapping[str, float]
        share by which a smooth approximation of a discontinuous law may bias a fitted parameter, by name.
    constraints : tuple[Constraint, ...]
        conditions on the parameters.
    axis : Axis | None
        unit and size of travel and effort, where the plant states them.
    reach : Mapping[str, ca.Function]
        output -> p -> (from, to): its possible range, where the plant states it.
    """

    name: str
    states: tuple[State, ...]
    inputs: tuple[Port, ...]
    outputs: tuple[Port, ...]
    parameters: tuple[Parameter, ...]
    sites: tuple[str, ...]
    effects: tuple[str, ...]
    rates: ca.Function
    sensors: ca.Function
    start: ca.Function
    halves: ca.Function | None = None
    sizes: tuple[float, ...] = ()
    site_units: tuple[str, ...] = ()
    near: tuple[tuple[str, ...], ...] = ()
    form_error: float | None = None
    suspects: tuple[tuple[str, ...], ...] = ()
    scalable: tuple[str, ...] = ()
    biases: Mapping[str, float] = field(default_factory=dict)
    constraints: tuple[Constraint, ...] = ()
    axis: Axis | None = None
    reach: Mapping[str, ca.Function] = field(default_factory=dict)

    @property
    def recorded(self) -> tuple[Port, ...]:
        """The inputs that a recording must hold, each once."""
        held = {
            port.role: port for port in self.inputs if port.role not in (INTERVAL, CLOCK) and not port.ago
        }
        return tuple(held.values())

    @cached_property
    def unobservable(self) -> frozenset[str]:
        """States that influence no output, directly or through others (structurally), by name."""
        x, u, p = (ca.SX.sym("s", *self.rates.size_in(k)) for k in range(3))
        rates, sensors = (
            np.array(ca.DM(ca.jacobian_sparsity(f(x, u, p), x), 1.0)) != 0.0
            for f in (self.rates, self.sensors)
        )
        seen = sensors.any(axis=0)
        for _ in self.states:
            seen = seen | rates[seen].any(axis=0)
        return frozenset(state.name for state, shown in zip(self.states, seen, strict=True) if not shown)

    @property
    def scales(self) -> Array:
        """Usual sizes of the states, shape (states,)."""
        return np.array([state.scale for state in self.states])

    def to_casadi(self, substeps: int = 10) -> CasadiFunctions:
        """The equations as CasADi functions: right-hand side, outputs, and one step of a held input.

        Parameters
        ----------
        substeps : int
            Runge-Kutta steps within one step.

        Returns
        -------
        CasadiFunctions
            The functions, with names and units of their arguments.
        """
        from optid.core.casadi_functions import casadi_functions

        return casadi_functions(self, substeps)

    def to_control(
        self,
        parameters: Mapping[str, float],
        held: Mapping[str, float],
        moving: Sequence[str] = (),
        near: Mapping[str, float] | None = None,
    ) -> Linear:
        """Linearised at an operating point, as a named state space of python-control: see `linearise`.

        Parameters
        ----------
        parameters : Mapping[str, float]
            name -> SI value.
        held : Mapping[str, float]
            state or input -> SI value to linearise at.
        moving : Sequence[str]
            states whose rate need not vanish: the position of an axis at constant speed.
        near : Mapping[str, float] | None
            guesses for the other states and inputs, SI.

        Returns
        -------
        Linear
            the linear system, with a note where it does not hold.
        """
        from optid.core.linearise import linearise

        return linearise(self, parameters, held, moving, near)

    def index(self, name: str) -> int:
        """Position of a parameter in the vector p.

        Parameters
        ----------
        name : str
            of a parameter.

        Returns
        -------
        int
            its place in the vector p.

        Raises
        ------
        PlantError
            no such parameter; names the nearest one.
        """
        names = [parameter.name for parameter in self.parameters]
        if name not in names:
            raise PlantError(f'no parameter "{name}"', where=self.name, hint=nearest(name, names))
        return names.index(name)

    def vector(self, values: Mapping[str, float]) -> Array:
        """The parameter vector p from named SI values, with defaults where `values` is silent.

        Parameters
        ----------
        values : Mapping[str, float]
            name -> SI value; defaults where absent.

        Returns
        -------
        Array
            the vector p, (parameters,).

        Raises
        ------
        PlantError
            an unknown name, or a required parameter without a value.
        """
        for name in values:
            self.index(name)
        absent = [q.name for q in self.parameters if q.name not in values and q.default is None]
        if absent:
            raise PlantError(f"no value for {', '.join(absent)}", where=self.name)
        return np.array([float(values.get(q.name, q.default)) for q in self.parameters])  # type: ignore[arg-type]

    def known_bias(self, free: Sequence[int], values: Array) -> Array:
        """What smooth approximations of discontinuous laws may bias parameters by.

        Parameters
        ----------
        free : Sequence[int]
            their places in the vector p.
        values : Array
            theirs, SI, (free,).

        Returns
        -------
        Array
            a standard uncertainty of type B (GUM, 4.3) each, SI, (free,).
        """
        shares = [self.biases.get(self.parameters[i].name, 0.0) for i in free]
        return np.asarray(np.array(shares) * np.abs(values))

    def vector_from(self, smaller: Model, p: Array, values: Mapping[str, float]) -> Array:
        """The vector p with the values of a smaller model of the same plant; the other parameters by name.

        Parameters
        ----------
        smaller : Model
            a model whose parameters are among this one's.
        p : Array
            its vector, (parameters of the smaller,).
        values : Mapping[str, float]
            name -> SI value, of the others.

        Returns
        -------
        Array
            the vector p, (parameters,).

        Raises
        ------
        PlantError
            as `vector`; a parameter of the smaller model is not here.
        """
        found = self.vector(values)
        found[[self.index(q.name) for q in smaller.parameters]] = p
        return found
