"""A servo-hydraulic axis: four-edge valve, cylinder of unequal areas, oil with entrained air, pump and accumulator.

Merritt, Hydraulic Control Systems, 1967, and Jelali and Kroll, Hydraulic Servo-systems, 2003. An edge passes, with s
its opening as a share of full command and Q_N its flow at the pressure drop p_N,

    Q = Q_N s sqrt(|p_1 - p_2| / p_N) sign(p_1 - p_2),   s = max(+-u - lap, 0)
    p' = E(p) / V (Q - A v - Q_leak)                     in each chamber

Pressures are absolute. A positive command opens A to supply. Oil does not bear tension: at its vapour pressure p_v it
boils, and the vapour, (p_v / p)^4 of the oil's volume, keeps the pressure nearly there until oil has filled it again
(a smooth form of the constant vapour pressure in Gholizadeh, Burton and Schoenau, 2012).
"""

from __future__ import annotations

import math
from typing import Any, Literal

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.smooth import signed_root, soft_floor
from optid.rigs.end_stops import SAMPLING_SKEW, end_stops
from optid.rigs.friction import COULOMB_FRICTION, dry_friction

MERRITT = "Merritt, Hydraulic Control Systems, 1967"
JELALI = "Jelali and Kroll, Hydraulic Servo-systems, 2003"
GHOLIZADEH = "Gholizadeh, Burton and Schoenau, Fluid bulk modulus: comparison of low pressure models, 2012"
POSITIVE, FEW = (1e-30, math.inf), (0.0, 1e-6)
TRAVEL, EFFORT = 0.1, 1e4  # m, N: usual sizes of a bench cylinder
REFERENCE = 1e5  # Pa: absolute pressure at which air contents are stated
STEEPNESS = 4  # exponent of the vapour's volume: at 2 bar it softens the oil by 1 in 60 000

SUPPLY_PRESSURE = Parameter(
    "supply_pressure",
    "Pa",
    1e7,
    "absolute pressure that the pump keeps",
    MERRITT,
    bounds=(1e5, 1e9),
    daily=0.03,
)
TANK_PRESSURE = Parameter(
    "tank_pressure", "Pa", 1e5, "absolute pressure of the return line", MERRITT, 1e5, (1e3, 1e8)
)
ATMOSPHERIC_PRESSURE = Parameter(
    "atmospheric_pressure", "Pa", 1e5, "absolute ambient pressure on the rod", MERRITT, 1e5, (1e3, 1e7)
)
RATED_FLOW = Parameter(
    "rated_flow",
    "m**3/s",
    5e-4,
    "flow Q_N of one edge, fully open, at the rated drop",
    JELALI,
    bounds=POSITIVE,
)
RATED_DROP = Parameter(
    "rated_pressure_drop", "Pa", 35e5, "drop p_N over one edge", "data sheets: 35 bar", 35e5, (1e3, 1e9)
)
VALVE_LAP = Parameter(
    "valve_lap",
    "1",
    0.01,
    "overlap of each edge as a share of full command; negative: underlap",
    MERRITT,
    0.0,
    (-0.5, 0.5),
)
BULK_MODULUS = Parameter(
    "bulk_modulus", "Pa", 1.4e9, "E of the oil without air, with what hoses give", MERRITT, 1.4e9, (1e6, 1e11)
)
AIR_CONTENT = Parameter(
    "air_content", "1", 5e-3, "undissolved air at 1 bar, share of the volume", JELALI, 0.0, (0.0, 0.5)
)
AIR_EXPONENT = Parameter(
    "air_exponent", "1", 1.4, "polytropic exponent n of that air", JELALI, 1.4, (1.0, 1.7)
)
VAPOUR_PRESSURE = Parameter(
    "vapour_pressure", "Pa", 1e3, "absolute pressure p_v at which the oil boils", GHOLIZADEH, 1e3, (1.0, 1e5)
)
OIL_DENSITY = Parameter("oil_density", "kg/m**3", 870.0, "density", "mineral oil HLP 46", 870.0, (1.0, 1e5))
BORE_DIAMETER = Parameter("bore_diameter", "m", 40e-3, "bore", JELALI, bounds=POSITIVE)
ROD_DIAMETER = Parameter(
    "rod_diameter", "m", 28e-3, "rod on the side of chamber B", JELALI, bounds=(0.0, math.inf)
)
STROKE = Parameter("stroke", "m", 0.2, "stroke L", JELALI, bounds=POSITIVE)
DEAD_VOLUME = Parameter("dead_volume", "m**3", 5e-5, "line and end of each chamber", JELALI, bounds=POSITIVE)
INTERNAL_LEAKAGE = Parameter(
    "internal_leakage", "m**3/(s Pa)", 1e-12, "laminar, past the piston", MERRITT, 0.0, FEW
)
EXTERNAL_LEAKAGE = Parameter(
    "external_leakage", "m**3/(s Pa)", 1e-13, "laminar, from each chamber to tank", MERRITT, 0.0, FEW
)
PAYLOAD_MASS = Parameter("payload_mass", "kg", 100.0, "moving mass", JELALI, bounds=POSITIVE)
LOAD_FORCE = Parameter("load_force", "N", 1e3, "constant force on the piston", JELALI, 0.0)
VISCOUS_FRICTION = Parameter("viscous_friction", "N s/m", 1e3, "viscous friction", JELALI, bounds=(-1e6, 1e8))
FLOW_WIDTH = Parameter(
    "flow_width",
    "Pa",
    1e4,
    "drop below which an edge's flow is laminar",
    # A wider one is felt far above it: of 1e5 Pa 0.2 % of the flow is missing at 10 bar, and friction is fitted for it.
    MERRITT,
    1e4,
    (1e2, 1e7),
)
PUMP_FLOW = Parameter("pump_flow", "m**3/s", 5e-4, "largest flow of the pump", JELALI, bounds=POSITIVE)
PUMP_DROOP = Parameter(
    "pump_droop",
    "Pa",
    1e6,
    "pressure below that kept at which it gives its largest flow",
    JELALI,
    1e6,
    (1e3, 1e8),
)
GAS_VOLUME = Parameter("accumulator_volume", "m**3", 1e-3, "gas volume at precharge", JELALI, bounds=POSITIVE)
PRECHARGE = Parameter(
    "precharge_pressure",
    "Pa",
    5e6,
    "absolute pressure of the accumulator's gas when empty",
    JELALI,
    bounds=POSITIVE,
)
# As in optid/rigs/friction.py.
STICK_BIAS = {"bulk_modulus": 1.5e-4, "viscous_friction": 1.2e-3, "coulomb_friction": 1.2e-3}


def servo_hydraulic(
    s: Sheet,
    *,
    supply: Literal["constant", "accumulator"] = "constant",
    friction: Literal["bristle", "smooth"] = "bristle",
) -> None:
    """Command -> spool -> flows -> chamber pressures -> piston.

    Args:
        supply: "constant" pressure, or that of an "accumulator" which a pressure-compensated pump fills.
        friction: "bristle" (Dahl's law: sticks) or "smooth" (tanh over `friction_width`: creeps).
    """
    s.axis("m", TRAVEL, "N", EFFORT)
    for site in ("valve.command", "flow.chamber_a", "flow.chamber_b", "force.external", "sensor.position"):
        s.suspect(site)
    s.suspect("flow.chamber_a", "flow.chamber_b")
    P_s, P_t, L = s.param(SUPPLY_PRESSURE), s.param(TANK_PRESSURE), s.param(STROKE)
    s.require("the supply pressure is above the tank pressure", P_s - P_t)
    s.require("the rod is thinner than the bore", s.param(BORE_DIAMETER) - s.param(ROD_DIAMETER))
    A_a = math.pi / 4 * s.param(BORE_DIAMETER) ** 2
    A_rod = math.pi / 4 * s.param(ROD_DIAMETER) ** 2
    A_b = A_a - A_rod

    x, v = s.state("position", "m", 0.01), s.state("velocity", "m/s", 0.2)
    middle = (P_s + P_t) / 2
    P_a = s.state("pressure_a", "Pa", 1e6, start=middle * A_b / A_a, spread=middle / 2)
    P_b = s.state("pressure_b", "Pa", 1e6, start=middle, spread=middle / 2)

    command = s.site(
        "valve.command", s.site("valve.input", s.input("command", "1", idle=0.0), unit="1"), unit="1"
    )
    u = s.site("valve.spool", command, unit="1", command=command)
    P_p = _pressure_line(s) if supply == "accumulator" else P_s
    from_supply_a, to_tank_a = _edge(s, u, P_p, P_a), _edge(s, -u, P_a, P_t)
    from_supply_b, to_tank_b = _edge(s, -u, P_p, P_b), _edge(s, u, P_b, P_t)
    if supply == "accumulator":
        _charge(s, P_p, from_supply_a + from_supply_b)

    across = s.param(INTERNAL_LEAKAGE) * (P_a - P_b)
    out_a, out_b = (s.param(EXTERNAL_LEAKAGE) * (P - P_t) for P in (P_a, P_b))
    density = s.param(OIL_DENSITY)
    leak_a = s.site(
        "flow.leak_a", -across - out_a, unit="m**3/s", size=0.0, P=P_a, other=P_b, drain=P_t, density=density
    )
    leak_b = s.site(
        "flow.leak_b", across - out_b, unit="m**3/s", size=0.0, P=P_b, other=P_a, drain=P_t, density=density
    )
    near_a, near_b = {"P": P_a, "other_P": P_b, "spool": u}, {"P": P_b, "other_P": P_a, "spool": u}
    Q_a = s.site("flow.chamber_a", from_supply_a - to_tank_a + leak_a, unit="m**3/s", size=0.0, **near_a)
    Q_b = s.site("flow.chamber_b", from_supply_b - to_tank_b + leak_b, unit="m**3/s", size=0.0, **near_b)

    dead = s.param(DEAD_VOLUME)
    V_a = soft_floor(A_a * (L / 2 + x) + dead, dead / 4, dead / 8)
    V_b = soft_floor(A_b * (L / 2 - x) + dead, dead / 4, dead / 8)
    c_a, c_b = (
        s.site("flow.compressibility", _compressibility(s, P), unit="1/Pa", size=0.0, P=P) for P in (P_a, P_b)
    )
    # What flows into vapour is oil: it fills more than as much of the mixture would.
    into_a, into_b = (Q * (1 + _vapour(s, P)) for Q, P in ((Q_a, P_a), (Q_b, P_b)))
    rate_a, rate_b = (into_a - A_a * v) / (V_a * c_a), (into_b + A_b * v) / (V_b * c_b)
    s.rate(P_a, s.site("flow.pressure_rate_a", rate_a, unit="Pa/s", size=0.0, P=P_a, v=v))
    s.rate(P_b, s.site("flow.pressure_rate_b", rate_b, unit="Pa/s", size=0.0, P=P_b, v=v))

    drive = A_a * P_a - A_b * P_b - A_rod * s.param(ATMOSPHERIC_PRESSURE)
    viscous = s.site("force.viscous", s.param(VISCOUS_FRICTION) * v, unit="N", size=EFFORT / 10, v=v, x=x)
    dry = dry_friction(s, v, friction, x=x, L=L, P_a=P_a, P_b=P_b, drive=drive)
    if friction == "bristle":
        s.biased(**STICK_BIAS)
    s.require("the supply overcomes Coulomb friction", (P_s - P_t) * A_a - s.param(s.sized(COULOMB_FRICTION)))
    drag = s.site("force.friction", viscous + dry, unit="N", size=EFFORT / 10, x=x, v=v, P_a=P_a, P_b=P_b)
    external = s.param(LOAD_FORCE) + end_stops(s, x, v, L)
    external = s.site("force.external", external, unit="N", size=EFFORT / 10, x=x, v=v, L=L)
    M = s.param(PAYLOAD_MASS)
    net = drive - drag + external
    a = s.site("force.acceleration", net / M, unit="m/s**2", size=10.0, net=net, mass=M, x=x, v=v)
    s.rate(x, v)
    s.rate(v, a)

    shown = x - s.param(SAMPLING_SKEW) * v
    position = s.site("sensor.position", shown, unit="m", size=TRAVEL, x=x, v=v, a=a, L=L)
    s.output("position", "m", position, within=(-L / 2, L / 2))
    s.output("pressure_a", "Pa", s.site("sensor.pressure_a", P_a, unit="Pa", size=1e7))
    s.output("pressure_b", "Pa", s.site("sensor.pressure_b", P_b, unit="Pa", size=1e7))


def _edge(s: Sheet, way: Any, P_from: Any, P_to: Any) -> Any:
    """Flow of one edge, m3/s, opened by a spool at `way`: turbulent, laminar at small pressure drops."""
    opening = ca.fmax(way - s.param(VALVE_LAP), 0)
    drop = s.param(RATED_DROP)
    root = signed_root((P_from - P_to) / drop, s.param(FLOW_WIDTH) / drop)
    return s.param(RATED_FLOW) * opening * root


def _above_vacuum(s: Sheet, P: Any) -> Any:
    """A chamber's pressure, Pa, away from 0, where no volume of vapour would be enough."""
    return ca.fmax(P, s.param(VAPOUR_PRESSURE) / 10)


def _vapour(s: Sheet, P: Any) -> Any:
    """Volume of the vapour over that of the oil; nothing but near the vapour pressure."""
    squared = (s.param(VAPOUR_PRESSURE) / _above_vacuum(s, P)) ** 2
    return squared * squared


def _compressibility(s: Sheet, P: Any) -> Any:
    """1 / E(p) of oil with vapour and with bubbles compressed polytropically (Jelali and Kroll, section 3.2), 1/Pa."""
    air, n = s.param(AIR_CONTENT), s.param(AIR_EXPONENT)
    P = _above_vacuum(s, P)
    squeezed = ca.exp(-ca.log(P / REFERENCE) / n)  # volume of the bubbles over that at 1 bar
    oil, vapour = 1 - air, _vapour(s, P)
    gas = air * squeezed / (n * P) + STEEPNESS * vapour / P
    return (oil / s.param(BULK_MODULUS) + gas) / (oil + air * squeezed + vapour)


def _pressure_line(s: Sheet) -> Any:
    """Pressure before the valve, Pa."""
    full = s.param(SUPPLY_PRESSURE)
    return s.state("supply_line", "Pa", 1e6, start=full, spread=full / 20)


def _charge(s: Sheet, P_p: Any, taken: Any) -> None:
    """Pump and accumulator: the gas follows p V^n, the pump delivers more at lower pressure, up to its largest flow."""
    n, V_0, P_0 = s.param(AIR_EXPONENT), s.param(GAS_VOLUME), s.param(PRECHARGE)
    s.require("the precharge is below the supply pressure", s.param(SUPPLY_PRESSURE) - P_0)
    P = ca.fmax(P_p, 1e4)
    gas = V_0 * ca.exp(ca.log(P_0 / ca.fmax(P, P_0)) / n)
    low = ca.fmin(ca.fmax((s.param(SUPPLY_PRESSURE) - P_p) / s.param(PUMP_DROOP), 0), 1)
    s.rate(P_p, n * P / gas * (s.param(PUMP_FLOW) * low - taken))
