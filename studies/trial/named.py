"""Every named effect as the independent rig has it, at any of three sizes.

Sizes span the usual range. Forms differ from the toolbox's where nature leaves a choice:
Lorentz's curve or a plain exponential for the Stribeck effect, a raised cosine or a one-sided rise for friction
over position, a hardening spring, a drag that is not quite quadratic, a disturbance with a third harmonic, gaps
that leak as laminar flow does, edges that open at four different places, plays in parallel for hysteresis, elements
that yield for presliding, a reservoir with its line instead of a droop law.
"""

from __future__ import annotations

from collections.abc import Callable

from studies.trial.case import Hidden, Region
from studies.trial.sizes import Draw

Make = Callable[[Draw], Hidden]
NOZZLE = 0.5283  # critical pressure ratio of an ideal one, air


def stribeck_friction(d: Draw) -> Hidden:
    """More dry friction at rest and at low speed."""
    ratio, speed = 1.0 + d.sized(0.12, 0.8), d.between(6e-3, 45e-3)
    fields = {"stick_ratio": ratio, "stribeck_speed": speed, "stribeck_form": d.one_of(0.0, 1.0)}
    region = Region("velocity", -2.0 * speed, 2.0 * speed, "m/s")
    return Hidden("stribeck_friction", "force", d.size, fields, {"breakaway_ratio": ratio}, region)


def asymmetric_friction(d: Draw) -> Hidden:
    """More dry friction one way than the other."""
    share = d.sign() * d.sized(0.04, 0.25)
    return Hidden("asymmetric_friction", "force", d.size, {"asymmetry": share}, {"dry_asymmetry": share})


def constant_force(d: Draw) -> Hidden:
    """A weight, a tilt, a pull."""
    force = d.sign() * d.sized(2.5, 30.0)
    return Hidden("constant_force", "force", d.size, {"force": force}, {"force": force})


def position_dependent_friction(d: Draw) -> Hidden:
    """A tight spot, a rise towards one end, or towards both."""
    form, amount = d.one_of(1.0, 2.0, 3.0), d.sized(0.15, 0.8)
    place, width = d.evenly(-0.06, 0.06), d.evenly(0.015, 0.045)
    region: Region | None = Region("position", place - width, place + width, "m")
    if form == 2.0:
        place, width = d.evenly(-0.03, 0.03), 0.09
        region = Region("position", place, 0.13, "m")
    fields = {"place_form": form, "place_amount": amount, "place": place, "place_width": width}
    if form == 3.0:
        region = None
    return Hidden("position_dependent_friction", "force", d.size, fields, {}, region)


def spring_load(d: Draw) -> Hidden:
    """A spring between load and frame that hardens."""
    fields = {"spring": d.sized(60.0, 900.0), "spring_at": d.evenly(-0.06, 0.06)}
    return Hidden("spring_load", "force", d.size, fields)


def quadratic_drag(d: Draw) -> Hidden:
    """Resistance that grows faster than the speed."""
    fields = {"drag": d.sized(15.0, 130.0), "drag_power": d.evenly(1.8, 2.2)}
    return Hidden("quadratic_drag", "force", d.size, fields)


def periodic_disturbance(d: Draw) -> Hidden:
    """A shaking force with a little third harmonic."""
    frequency, force = d.between(0.8, 15.0), d.sized(2.0, 25.0)
    fields = {
        "shake": force,
        "shake_frequency": frequency,
        "shake_phase": d.evenly(0.0, 6.28),
        "shake_third": d.evenly(0.0, 0.25),
    }
    return Hidden("periodic_disturbance", "force", d.size, fields, {"frequency": frequency})


def friction_drift(d: Draw) -> Hidden:
    """Dry friction that a recording changes: warming up or drying out."""
    fields = {"friction_drift": d.sign() * d.sized(0.1, 0.45), "friction_drift_time": d.one_of(0.0, 2.0, 5.0)}
    return Hidden("friction_drift", "force", d.size, fields)


def end_cushioning(d: Draw) -> Hidden:
    """A tapered spear that throttles the air out of the ends."""
    length, side = d.evenly(14e-3, 28e-3), d.one_of(-1.0, 0.0, 0.0, 1.0)
    area = 1.6e-6 / d.sized(1.0, 12.0)
    low, high = (0.13 - length, 0.13) if side >= 0.0 else (-0.13, -0.13 + length)
    fields = {"cushion_length": length, "cushion_area": area, "cushion_side": side}
    region = None if side == 0.0 else Region("position", low, high, "m")
    return Hidden("end_cushioning", "flow", d.size, fields, {}, region)


def compliant_load(d: Draw) -> Hidden:
    """Part of the mass behind a spring."""
    stiffness, share = 3e5 / d.sized(1.0, 30.0), d.evenly(0.3, 0.6)
    damping = 0.1 * (stiffness * 1.9 * share) ** 0.5
    fields = {"load_share": share, "load_stiffness": stiffness, "load_damping": damping}
    return Hidden("compliant_load", "force", d.size, fields)


def cross_leakage(d: Draw) -> Hidden:
    """Air past the piston's seal: a hole or a narrow gap."""
    area, laminar = d.sized(2.5e-8, 4e-7), d.one_of(0.0, 1.0)
    quantities = {} if laminar else {"area": area}
    return Hidden("cross_leakage", "flow", d.size, {"leak_cross": area, "leak_laminar": laminar}, quantities)


def ambient_leakage(d: Draw) -> Hidden:
    """Air out of one chamber: a hole or a narrow gap."""
    area, laminar = d.sized(2.5e-8, 5e-7), d.one_of(0.0, 1.0)
    chamber = "ab"[int(d.one_of(0.0, 1.0))]
    fields = {f"leak_{chamber}": area, "leak_laminar": laminar}
    return Hidden("ambient_leakage", "flow", d.size, fields, {} if laminar else {f"area_{chamber}": area})


def heat_transfer(d: Draw) -> Hidden:
    """Air that warms and cools, with heat from the walls: the full energy balance."""
    return Hidden("heat_transfer", "flow", d.size, {"wall_heat": d.sized(15.0, 250.0)})


def critical_pressure_ratio(d: Draw) -> Hidden:
    """A valve with a long way through: it chokes later than a nozzle."""
    lower = d.sized(0.06, 0.38)
    fields = {"critical_ratio": NOZZLE - lower, "flow_exponent": d.one_of(0.5, d.evenly(0.46, 0.56))}
    same = {"shift": -lower} if fields["flow_exponent"] == 0.5 else {}
    return Hidden("critical_pressure_ratio", "flow", d.size, fields, same)


def supply_droop(d: Draw) -> Hidden:
    """A small reservoir behind a regulator that cannot keep up."""
    fields = {"reservoir": d.between(5e-5, 5e-4), "line_area": 3e-5 / d.sized(1.0, 10.0)}
    return Hidden("supply_droop", "flow", d.size, fields)


def exhaust_restriction(d: Draw) -> Hidden:
    """A clogged silencer behind a small manifold."""
    fields = {"silencer": 2e-5 / d.sized(1.0, 8.0), "manifold": d.between(1e-5, 5e-5)}
    return Hidden("exhaust_restriction", "flow", d.size, fields)


def valve_deadband(d: Draw) -> Hidden:
    """Edges that overlap their ports, each by its own amount; sometimes rounded."""
    width = d.sized(5e-3, 6e-2)
    edges = {f"overlap_{edge}": width * d.evenly(0.85, 1.15) for edge in EDGES}
    region = Region("command", -5.0 * width, 5.0 * width, "V")
    fields = {**edges, "edge_round": d.one_of(0.0, 0.2 * width)}
    return Hidden("valve_deadband", "valve", d.size, fields, {}, region)


def valve_underlap(d: Draw) -> Hidden:
    """Edges that never quite close, each by its own amount; sometimes with a clearance."""
    width = d.sized(3e-3, 3e-2)
    edges = {f"overlap_{edge}": -width * d.evenly(0.85, 1.15) for edge in EDGES}
    region = Region("command", -5.0 * width, 5.0 * width, "V")
    fields = {**edges, "clearance": d.one_of(0.0, 0.1 * width)}
    return Hidden("valve_underlap", "valve", d.size, fields, {}, region, also=("flow",))


EDGES = ("supply_a", "exhaust_a", "supply_b", "exhaust_b")


def valve_offset(d: Draw) -> Hidden:
    """The spool stands off centre at zero command."""
    offset = d.sign() * d.sized(2e-3, 3e-2)
    return Hidden("valve_offset", "valve", d.size, {"valve_offset": offset}, {"offset": offset})


def valve_lag(d: Draw) -> Hidden:
    """A spool of second order, or of first order with a limited rate."""
    time = d.sized(1.2e-3, 12e-3)
    if d.one_of(0.0, 1.0):
        first = {"valve_order": 1.0, "valve_frequency": 1.0 / time, "valve_rate": 150.0}
        return Hidden("valve_lag", "valve", d.size, first)
    fields = {"valve_order": 2.0, "valve_frequency": 1.0 / time, "valve_damping": d.evenly(0.6, 1.0)}
    return Hidden("valve_lag", "valve", d.size, fields, {"time_constant": time})


def input_delay(d: Draw) -> Hidden:
    """Commands that come late."""
    delay = round(d.sized(1e-3, 9e-3), 5)
    return Hidden("input_delay", "valve", d.size, {"delay": delay}, {"delay": delay})


def valve_hysteresis(d: Draw) -> Hidden:
    """Plays of several widths in parallel (Prandtl and Ishlinskii)."""
    return Hidden("valve_hysteresis", "valve", d.size, {"valve_hysteresis": d.sized(2.5e-3, 3e-2)})


def valve_saturation(d: Draw) -> Hidden:
    """A spool that stops short of its full travel, each way at its own place."""
    limit = 0.95 - d.sized(0.1, 0.65)
    fields = {"limit_up": limit * d.evenly(0.95, 1.05), "limit_down": limit * d.evenly(0.95, 1.05)}
    return Hidden("valve_saturation", "valve", d.size, fields)


def sensor_backlash(d: Draw) -> Hidden:
    """Play between rack and pinion."""
    return Hidden("sensor_backlash", "sensor", d.size, {"backlash": d.sized(3e-5, 4e-4)})


def sensor_lag(d: Draw) -> Hidden:
    """A filter of first or second order in the sensor."""
    order, time = d.one_of(1.0, 2.0), d.sized(1e-3, 1e-2)
    fields = {"sensor_order": order, "sensor_time": time / order}
    return Hidden("sensor_lag", "sensor", d.size, fields, {"time_constant": time} if order == 1.0 else {})


def sensor_nonlinearity(d: Draw) -> Hidden:
    """A potentiometer that bends: a sine over position with its second harmonic."""
    fields = {
        "bend": d.sized(2e-4, 2.5e-3),
        "bend_pitch": d.one_of(0.13, 0.2, 0.26),
        "bend_phase": d.evenly(0, 6.28),
    }
    return Hidden("sensor_nonlinearity", "sensor", d.size, fields)


def sensor_drift(d: Draw) -> Hidden:
    """A reading that wanders off during the recording."""
    fields = {"sensor_drift": d.sign() * d.sized(5e-4, 8e-3), "sensor_drift_time": d.one_of(0.0, 2.0, 5.0)}
    return Hidden("sensor_drift", "sensor", d.size, fields)


def clock_drift(d: Draw) -> Hidden:
    """Position and command are sampled by two clocks that drift apart."""
    late = d.sized(3e-4, 3e-3)
    return Hidden("clock_drift", "sensor", d.size, {"clock_drift": -late}, {"rate": late})


def presliding(d: Draw) -> Hidden:
    """A seal that yields before it slides: elements that give way one after the other (Iwan)."""
    return Hidden("presliding", "force", d.size, {"presliding": d.sized(5e-5, 1e-3)})


NAMED: dict[str, Make] = {
    make.__name__: make
    for make in (
        stribeck_friction,
        asymmetric_friction,
        constant_force,
        position_dependent_friction,
        spring_load,
        quadratic_drag,
        periodic_disturbance,
        friction_drift,
        end_cushioning,
        compliant_load,
        cross_leakage,
        ambient_leakage,
        heat_transfer,
        critical_pressure_ratio,
        supply_droop,
        exhaust_restriction,
        valve_deadband,
        valve_offset,
        valve_lag,
        input_delay,
        valve_hysteresis,
        valve_saturation,
        valve_underlap,
        sensor_backlash,
        sensor_lag,
        sensor_nonlinearity,
        sensor_drift,
        clock_drift,
        presliding,
    )
}
