"""What a plant declares: states, inputs, outputs and parameters, each once, with the symbols that stand for them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca

from optid.core.axis import Axis
from optid.core.model import CLOCK, INTERVAL, Port, State
from optid.core.parameter import Parameter
from optid.errors import PlantError, nearest

Expression = Any  # casadi.SX or a number: CasADi's operators are not typed
# Before the label, in the role of the input that says whether a recording belongs to the group.
GROUP = "group "


def member(name: str, label: str) -> str:
    """Name of a group's own parameter."""
    return f"{name}[{label}]"


def group_role(label: str) -> str:
    """Role of the input that is 1 in recordings of a group, and 0 in others."""
    return f"{GROUP}{label}"


class Declarations:
    """The declarations of a plant, in the order in which it writes them.

    Parameters
    ----------
    name : str
        of the plant.
    groups : Mapping[str, Sequence[str]] | None
        name of a parameter with a value per group of recordings -> the groups.
    """

    def __init__(self, name: str, groups: Mapping[str, Sequence[str]] | None = None) -> None:
        self.name = name
        self._groups = dict(groups or {})
        self._members: dict[str, ca.SX] = {}  # names of parameters with values per recording
        self._tells: dict[str, ca.SX] = {}  # inputs that say to which group a recording belongs
        self._states: dict[str, State] = {}
        self._state_symbols: dict[str, ca.SX] = {}
        self._rates: dict[str, Expression] = {}
        self._starts: dict[str, tuple[Expression, Expression]] = {}
        self._inputs: dict[str, tuple[Port, ca.SX]] = {}
        self._outputs: dict[str, tuple[Port, Expression]] = {}
        self._reach: dict[str, tuple[Expression, Expression]] = {}
        self._parameters: dict[str, tuple[Parameter, ca.SX]] = {}
        self._axis: Axis | None = None
        self._prefix = ""  # of the effect that is writing

    def state(
        self,
        name: str,
        unit: str,
        scale: float,
        *,
        start: Expression = 0.0,
        spread: Expression | None = None,
    ) -> ca.SX:
        """Declare a state; `scale` is its usual size, `start` and `spread` its mean and sd at the start of a recording.

        Parameters
        ----------
        name : str
            of the state.
        unit : str
            SI.
        scale : float
            a usual size, in that unit.
        start : Expression
            its mean at the start of a recording, without data.
        spread : Expression | None
            sd of the start.

        Returns
        -------
        ca.SX
            symbol of the sheet.
        """
        name = self._prefix + name
        self._fresh(name, self._states)
        self._states[name] = State(name, unit, float(scale))
        self._starts[name] = (start, 10.0 * scale if spread is None else spread)
        self._state_symbols[name] = ca.SX.sym(name)
        return self._state_symbols[name]

    def input(self, role: str, unit: str, *, idle: float | None = None) -> ca.SX:
        """Declare a recorded input; with unit "1" a channel in volts needs a `full_scale`.

        `idle` is the value at which the plant stays at rest: it is assumed before a recording that begins at rest.

        Parameters
        ----------
        role : str
            of the channel that it is read from.
        unit : str
            SI.
        idle : float | None
            value at which the plant stays at rest, if there is one.

        Returns
        -------
        ca.SX
            symbol of the sheet.
        """
        self._fresh(role, self._inputs)
        return self._port(role, Port(role, unit, idle=idle))

    def past(self, role: str, samples: int) -> ca.SX:
        """A declared input some samples ago; before the recording it is idle, or equal to its first sample.

        Parameters
        ----------
        role : str
            of an input.
        samples : int
            how many ago.

        Returns
        -------
        ca.SX
            symbol of the sheet.
        """
        port, now = self._inputs[role]
        return self._port(f"{role}@{samples}", replace(port, ago=samples)) if samples else now

    def input_at(self, signal: ca.SX) -> str | None:
        """The declared input that a signal is, if it is one, unchanged.

        Parameters
        ----------
        signal : ca.SX
            at a site.

        Returns
        -------
        str | None
            its role; ``None`` if it is none of them.
        """
        return next((role for role, (_, now) in self._inputs.items() if ca.is_equal(now, signal)), None)

    def signal(self, name: str) -> ca.SX:
        """A state or an input that the plant has declared, for an effect that can depend on any of them.

        Parameters
        ----------
        name : str
            of a state or an input.

        Returns
        -------
        ca.SX
            symbol of the sheet.

        Raises
        ------
        PlantError
            the plant has not declared it before.
        """
        known = {**self._state_symbols, **{role: symbol for role, (_, symbol) in self._inputs.items()}}
        if name not in known:
            raise PlantError(
                f'no state or input "{name}" has been declared so far',
                where=self.name,
                hint=nearest(name, known),
            )
        return known[name]

    def interval(self) -> ca.SX:
        """The time for which the present sample is held, s.

        Returns
        -------
        ca.SX
            symbol of the sheet, s.
        """
        return self._port(INTERVAL, Port(INTERVAL, "s"))

    def clock(self) -> ca.SX:
        """Time since the record began, s, taken at the middle of the present sample's hold.

        Returns
        -------
        ca.SX
            symbol of the sheet, s.
        """
        return self._port(CLOCK, Port(CLOCK, "s"))

    def _port(self, key: str, port: Port) -> ca.SX:
        if key not in self._inputs:
            self._inputs[key] = (port, ca.SX.sym(key))
        return self._inputs[key][1]

    def param(self, parameter: Parameter) -> ca.SX:
        """Use a parameter; the same object may be used again. An effect's parameter is prefixed with the effect's name.

        Parameters
        ----------
        parameter : Parameter
            with name, unit and bounds.

        Returns
        -------
        ca.SX
            symbol of the sheet.
        """
        if self._prefix:
            parameter = replace(parameter, name=self._prefix + parameter.name)
        if parameter.name in self._groups:
            return self._of_groups(parameter)
        if parameter.name in self._parameters:
            known, symbol = self._parameters[parameter.name]
            if known != parameter:
                raise PlantError(
                    f'parameter "{parameter.name}" is declared twice, with different attributes',
                    where=self.name,
                )
            return symbol
        self._parameters[parameter.name] = (parameter, ca.SX.sym(parameter.name))
        return self._parameters[parameter.name][1]

    def _of_groups(self, q: Parameter) -> ca.SX:
        """The parameter of the recording's group, whose input is 1; the mean of all groups where there is none."""
        if q.name not in self._members:
            labels = self._groups[q.name]
            own = [ca.SX.sym(member(q.name, label)) for label in labels]
            for label, symbol in zip(labels, own, strict=True):
                self._parameters[symbol.name()] = (replace(q, name=symbol.name()), symbol)
                role = group_role(label)
                self._tells[role] = self._port(role, Port(role, "1"))
            mean = ca.sum1(ca.vertcat(*own)) / len(own)
            chosen = mean
            for label, value in zip(labels, own, strict=True):
                chosen = chosen + self._tells[group_role(label)] * (value - mean)
            self._members[q.name] = chosen
        return self._members[q.name]

    def axis(self, travel_unit: str, travel: float, effort_unit: str, effort: float) -> None:
        """State unit and size of the axis's travel and of its driving force; a plant calls this first.

        Laws of the catalogue, stated for a slide of 0.1 m and 100 N, then have its units, and sizes in proportion.

        Parameters
        ----------
        travel_unit : str
            "m" or "rad".
        travel : float
            usual half of its travel, in that unit.
        effort_unit : str
            "N" or "N m".
        effort : float
            usual size of the driving force or torque, in that unit.
        """
        self._axis = Axis(travel_unit, travel, effort_unit, effort)

    def sized(self, parameter: Parameter) -> Parameter:
        """A parameter of a law stated for a slide, converted to the plant's axis.

        Parameters
        ----------
        parameter : Parameter
            as the law states it.

        Returns
        -------
        Parameter
            with the axis's unit and sizes; the same where the plant states no axis.
        """
        return self._axis.sized(parameter) if self._axis else parameter

    def length(self, value: float) -> float:
        """A length of a law stated for a slide, m, converted to the plant's axis.

        Parameters
        ----------
        value : float
            m.

        Returns
        -------
        float
            in the unit of the axis's travel.
        """
        return self._axis.length(value) if self._axis else value

    def plant_param(self, name: str) -> ca.SX:
        """A parameter that the plant has declared, for an effect that needs it.

        Parameters
        ----------
        name : str
            of a parameter of the plant.

        Returns
        -------
        ca.SX
            symbol of the sheet.

        Raises
        ------
        PlantError
            the plant has not declared such a parameter before.
        """
        if name in self._members:
            return self._members[name]
        if name not in self._parameters:
            raise PlantError(
                f'no parameter "{name}" has been declared so far',
                where=self.name,
                hint=nearest(name, self._parameters),
            )
        return self._parameters[name][1]

    def rate(self, state: ca.SX, expression: Expression) -> None:
        """Write d(state)/dt.

        Parameters
        ----------
        state : ca.SX
            its symbol.
        expression : Expression
            its unit per second.
        """
        name = state.name()
        if name not in self._states:
            raise PlantError(
                f'rate of "{name}", which is no state; {nearest(name, self._states)}',
                where=self.name,
            )
        self._fresh(name, self._rates)
        self._rates[name] = expression

    def output(
        self,
        role: str,
        unit: str,
        expression: Expression,
        *,
        within: tuple[Expression, Expression] | None = None,
    ) -> None:
        """Write the equation of a sensor.

        Parameters
        ----------
        role : str
            of the channel that measures it.
        unit : str
            SI.
        expression : Expression
            the sensor's reading.
        within : tuple[Expression, Expression] | None
            lowest and highest value it can reach, from the parameters; a recording beyond is not of this plant.
        """
        self._fresh(role, self._outputs)
        if within is not None:
            self._reach[role] = within
        self._outputs[role] = (Port(role, unit), expression)

    def _fresh(self, name: str, known: Mapping[str, object]) -> None:
        if name in known:
            raise PlantError(f'"{name}" is declared twice', where=self.name)
