"""Controller, loop and closed loop as systems of python-control, without limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from optid.armax.loop import Gains as LoopGains
from optid.pid.controller import Gains
from optid.tuning.plant import Plant

if TYPE_CHECKING:
    import control


def open_loop(plant: Plant, gains: Gains) -> control.TransferFunction:
    """Loop gain L(z) of a plant and the feedback part of a controller, as a python-control system."""
    import control

    feedback = LoopGains(gains.kp, gains.ki, gains.kd, gains.derivative_filter)
    C = control.TransferFunction(*feedback.polynomials(plant.sample_time), plant.sample_time)
    return C * control.TransferFunction(plant.b, np.r_[1.0, plant.a], plant.sample_time)


def controller_system(gains: Gains, sample_time: float) -> control.StateSpace:
    """From (setpoint, measured) to command: integral, lagged slope and the last c r - y as states."""
    import control

    kp, ki, kd, lag, b, c = gains.vector
    T, share = sample_time, 1.0 / (lag + sample_time)
    # States: integral part before the sample, slope before the sample, c r - y of the sample before.
    A = np.array([[1.0, 0.0, 0.0], [0.0, lag * share, -share], [0.0, 0.0, 0.0]])
    B = np.array([[ki * T, -ki * T], [c * share, -share], [c, -1.0]])
    C = np.array([[1.0, kd * lag * share, -kd * share]])
    D = np.array([[kp * b + ki * T + kd * c * share, -(kp + ki * T + kd * share)]])
    return control.StateSpace(A, B, C, D, T, inputs=["setpoint", "measured"], outputs=["command"], name="pid")


def plant_system(plant: Plant) -> control.StateSpace:
    """From command to output, observer form."""
    import control

    A = np.eye(plant.a.size, k=1)
    A[:, 0] = -plant.a
    C = np.eye(1, plant.a.size)
    B = plant.b[:, None]
    return control.StateSpace(
        A, B, C, 0.0, plant.sample_time, inputs=["command"], outputs=["output"], name="plant"
    )


def closed_loop(plant: Plant, gains: Gains) -> control.StateSpace:
    """From set-point to output of a plant under a controller."""
    import control

    pid = controller_system(gains, plant.sample_time)
    pid.input_labels = ["setpoint", "output"]
    return control.interconnect([pid, plant_system(plant)], inputs=["setpoint"], outputs=["output"])
