"""A spool that follows its command as a mass on a spring: second order, from a few milliseconds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

TIME = Parameter(
    "time_constant",
    "s",
    5e-3,
    "1 / natural frequency of the spool",
    "usual: 40 to 150 Hz, 1 to 15 ms",
    0.0,
    (0.0, 0.05),
)
DAMPING = Parameter(
    "damping_ratio",
    "1",
    0.8,
    "damping ratio of the spool; large ones make a first-order lag",
    "usual: 0.5 to 1",
    0.8,
    (0.2, 3.0),
    logarithmic=True,
)
LINEAR = Parameter(
    "linear_range",
    "1",
    0.3,
    "lag behind the command up to which the spool's speed still grows, as a share of full command; 2: no limit",
    "usual: spools reach 0.1 to 2 m/s",
    2.0,
    (0.02, 2.0),
    logarithmic=True,
)
FLOOR = 3e-4  # s: keeps the equations from becoming stiff at the null


class ValveLag(Effect):
    """(1 + 2 z t0 p + (t0 p)^2) / (1 + 2 z t p + (t p)^2) with p = d/dt, t = time constant + t0: 1 at the null.

    t0 falls from FLOOR with the square of the time constant: a lag of usual size is the plain second-order one.
    The drive saturates: the force on the spool stops growing at a lag of `linear_range`.
    """

    name = "valve_lag"
    sites = ("valve.command",)
    equation = "3-6"
    parameters = (TIME, DAMPING, LINEAR)
    strength = {"time_constant": 3e-4}
    usual = (
        {"time_constant": 2e-3, "damping_ratio": 0.8, "linear_range": 2.0},
        {"time_constant": 6e-3, "damping_ratio": 0.8, "linear_range": 2.0},
        {"time_constant": 4e-3, "damping_ratio": 2.0, "linear_range": 2.0},
        {"time_constant": 2e-3, "damping_ratio": 2.0, "linear_range": 0.3},
    )
    law = "t^2 s'' + 2 z t s' = command - s, where command - s is limited to the linear range"
    says = (
        "the spool follows its command with a time constant of {time_constant} (damping ratio {damping_ratio}); "
        "its speed is limited to that at a lag of {linear_range}"
    )
    depends_on = ("command_rate",)
    needs = "commands that change fast: steps, reversals, a binary sequence"
    ahead_of = ("valve_rate_limit", "valve_saturation")
    look_alikes = ("input_delay", "sensor_lag", "valve_hysteresis")
    experiment = (
        "record the spool's position signal, or steps of the command with pressures measured at 5 kHz"
    )
    source = "Richer and Hurmuzlu, J. Dyn. Sys. Meas. Control 122(3), 2000; valve catalogues"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """Position of the spool, a share of full travel."""
        z = sheet.param(DAMPING)
        floor = FLOOR * ca.fmax(1, z)  # the faster of two poles of an overdamped spool is at 2 z / t
        time = sheet.param(TIME)
        t0 = floor * (floor / (time + floor)) ** 2
        t = time + t0
        s = sheet.state("spool", "1", 0.1, spread=0.3)
        w = sheet.state("spool_rate", "1", 0.1, spread=0.3)  # t s'
        behind = nominal - s
        most = sheet.param(LINEAR)
        sheet.rate(s, w / t)
        sheet.rate(w, (ca.fmin(ca.fmax(behind, -most), most) - 2 * z * w) / t)
        share = t0 / t
        stands = s + 2 * z * share * w + share**2 * (behind - 2 * z * w)
        stop = ca.fmax(1, ca.fabs(nominal))  # an overshoot is limited by the spool's travel
        return ca.fmin(ca.fmax(stands, -stop), stop)
