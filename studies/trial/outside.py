"""Physics that no name of the contract's list stands for: a diagnosis should say where, and that it is unexplained."""

from __future__ import annotations

from studies.trial.case import Hidden, Region
from studies.trial.named import Make
from studies.trial.sizes import Draw


def supply_pulsation(d: Draw) -> Hidden:
    """A compressor that is heard in the supply."""
    fields = {"pulsation": d.sized(0.02, 0.15), "pulsation_frequency": d.between(2.0, 15.0)}
    return Hidden("supply_pulsation", "flow", d.size, fields)


def flow_force(d: Draw) -> Hidden:
    """The jet closes the spool: openings shrink with the pressure drop."""
    return Hidden("flow_force", "valve", d.size, {"flow_force": d.sized(0.15, 0.8)}, also=("flow",))


def spool_stiction(d: Draw) -> Hidden:
    """A spool that stays until the command has gone so far, and then jumps."""
    return Hidden("spool_stiction", "valve", d.size, {"valve_stiction": d.sized(5e-3, 4e-2)})


def detent(d: Draw) -> Hidden:
    """A latch that pulls the piston into one place."""
    place, width = d.evenly(-0.06, 0.06), d.evenly(0.006, 0.015)
    fields = {"detent": d.sized(8.0, 60.0), "detent_place": place, "detent_width": width}
    return Hidden(
        "detent", "force", d.size, fields, {}, Region("position", place - 2 * width, place + 2 * width, "m")
    )


def relief_leak(d: Draw) -> Hidden:
    """A seal of chamber A that leaks above a pressure only."""
    above = d.evenly(4e5, 4.6e5)
    fields = {"relief": d.sized(1.5e-7, 2e-6), "relief_pressure": above}
    return Hidden("relief_leak", "flow", d.size, fields, {}, Region("pressure_a", above, 7e5, "Pa"))


def tube_creep(d: Draw) -> Hidden:
    """Tubes that widen under pressure, in their own time."""
    return Hidden(
        "tube_creep", "flow", d.size, {"creep": d.sized(5e-11, 6e-10), "creep_time": d.between(0.1, 1.0)}
    )


def dwell_friction(d: Draw) -> Hidden:
    """Break-away that grows with the time at rest."""
    fields = {"dwell_gain": d.sized(0.3, 1.5), "dwell_time": d.evenly(0.3, 1.0)}
    return Hidden("dwell_friction", "force", d.size, fields)


def side_load(d: Draw) -> Hidden:
    """Friction in the bearing that grows with the air's force and towards the ends."""
    return Hidden("side_load", "force", d.size, {"side_load": d.sized(0.15, 0.7)})


def sensor_crosstalk(d: Draw) -> Hidden:
    """The command couples into the sensor's cable."""
    return Hidden("sensor_crosstalk", "sensor", d.size, {"crosstalk": d.sign() * d.sized(5e-4, 5e-3)})


def wiper_bounce(d: Draw) -> Hidden:
    """A potentiometer's wiper that chatters on its track above a speed."""
    speed = d.evenly(0.08, 0.2)
    fields = {"bounce": d.sized(2e-4, 2e-3), "bounce_speed": speed}
    return Hidden("wiper_bounce", "sensor", d.size, fields)


OUTSIDE: dict[str, Make] = {
    make.__name__: make
    for make in (
        supply_pulsation,
        flow_force,
        spool_stiction,
        detent,
        relief_leak,
        tube_creep,
        dwell_friction,
        side_load,
        sensor_crosstalk,
        wiper_bounce,
    )
}
