"""What a case is: the rig that is concealed, the conditions it was recorded in, and what an answer must say."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any

from studies.independent_rig import Controller, Rig, Sensors

SIZES = ("small", "medium", "large")
KINDS = ("nothing", "single", "pair", "outside")
NOMINAL = {
    "viscous": 78.0,
    "coulomb": 83.0,
    "discharge": 0.8,
    "residual_length": 12e-3,
}  # what the rig file states


@dataclass(frozen=True)
class Region:
    """Where in the plant's states an effect acts: a variable as diagnoses name it, and its range, SI."""

    variable: str
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class Hidden:
    """One concealed effect.

    Attributes:
        name: of the contract's list, or of physics outside it.
        site: valve, flow, force or sensor.
        size: small, medium or large.
        fields: of `Rig` (or of `Sensors`) that make it.
        quantities: what means the same in any form of the effect: name -> SI value.
        region: where it acts, if that is one part of the states.
        also: other sites at which it may rightly be placed.
    """

    name: str
    site: str
    size: str
    fields: dict[str, float]
    quantities: dict[str, float] = field(default_factory=dict)
    region: Region | None = None
    also: tuple[str, ...] = ()


@dataclass(frozen=True)
class Case:
    """One case of the draw, complete: `seed` makes its references, of that style and reach (m), and its noise."""

    name: str
    kind: str
    seed: int
    base: dict[str, float]
    hidden: tuple[Hidden, ...]
    with_pressures: bool
    noise: str
    sensors: Sensors
    controller: Controller
    reach: float
    style: str = "lively"
    variant: dict[str, float] = field(default_factory=dict)

    @property
    def plain(self) -> Rig:
        """The rig with nothing missing."""
        return Rig(**self.base, **self.variant)

    @property
    def rig(self) -> Rig:
        """The rig as it is."""
        return with_effects(self.plain, self.hidden)

    @property
    def recorded_with(self) -> Sensors:
        """The sensors as they are: the clocks' drift is an effect that acts there."""
        own = {k: v for effect in self.hidden for k, v in effect.fields.items() if k not in Rig._fields}
        return replace(self.sensors, **own)

    def stated(self) -> dict[str, Any]:
        """Everything as a JSON object."""
        return asdict(self)


def with_effects(rig: Rig, hidden: tuple[Hidden, ...]) -> Rig:
    """The rig with these effects in it."""
    for effect in hidden:
        rig = rig._replace(**{k: v for k, v in effect.fields.items() if k in Rig._fields})
    return rig


def case_from(stated: dict[str, Any]) -> Case:
    """The case that `stated` wrote."""
    hidden = tuple(_hidden_from(h) for h in stated["hidden"])
    sensors, controller = Sensors(**stated["sensors"]), Controller(**stated["controller"])
    return Case(**{**stated, "hidden": hidden, "sensors": sensors, "controller": controller})


def _hidden_from(stated: dict[str, Any]) -> Hidden:
    region = None if stated["region"] is None else Region(**stated["region"])
    return Hidden(**{**stated, "region": region, "also": tuple(stated["also"])})
