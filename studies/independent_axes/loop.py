"""An axis in its loop: sampled, controlled and held, with every stop and break-away at its own instant."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from studies.independent_axes import hydraulic
from studies.independent_axes.machine import closed_loop
from studies.independent_axes.states import COUNT, WAY, A, B, E, F, P, X
from studies.independent_rig.recording import unit_noise
from studies.independent_rig.rig import Array, Controller

DT, STEP = 1e-3, 2e-5  # s


@dataclass(frozen=True)
class Axis:
    """What the loop needs to know of a kind of axis.

    Attributes:
        controller: that follows its references.
        noise: sd of the position and of what else is measured, SI.
        reach: of its references, SI.
    """

    controller: Controller
    noise: tuple[float, float]
    reach: float


ROTARY = Axis(Controller(kp=40.0, ki=40.0, kd=2.0, limit=12.0, quantum=24.0 / 4096), (3e-4, 0.0), 1.2)
HYDRAULIC = Axis(Controller(kp=120.0, ki=50.0, kd=0.5, limit=10.0, quantum=20.0 / 65536), (2e-5, 2e4), 0.08)
KINDS = {"Rotary": ROTARY, "Hydraulic": HYDRAULIC}


@dataclass(frozen=True)
class Run:
    """True signals at the samples, SI: `other` is what is measured beside the position, (n, 2)."""

    t: Array
    command: Array
    reference: Array
    position: Array
    momentum: Array
    way: Array
    measured: Array
    other: Array


def axis_of(rig: Any) -> Axis:
    """The kind of axis that a rig is."""
    return KINDS[type(rig).__name__]


def simulate(
    rig: Any,
    reference: Array,
    rng: np.random.Generator,
    controller: Controller | None = None,
    noise: float = 1.0,
    step: float = STEP,
    start: Array | None = None,
) -> Run:
    """Let an axis follow a reference.

    Args:
        rig: a Rotary or a Hydraulic.
        reference: wanted positions, SI, one a sample of 1 ms.
        rng: of the sensors' noise.
        controller: the kind's own if absent.
        noise: times the usual one.
        step: of the integration, s.
        start: states; at rest if absent.
    """
    axis = axis_of(rig)
    c = controller or axis.controller
    n, steps = len(reference), round(DT / step)
    record = np.array([tuple(rig)], dtype=[(name, "f8") for name in rig._fields])[0]
    y = at_rest(rig, float(reference[0])) if start is None else start.copy()
    position_noise = noise * axis.noise[0] * rng.normal(size=n)
    out, signals = np.empty((n, COUNT)), np.empty((n, 4))
    gains = (c.kp, c.ki, c.kd, c.filter_time, c.limit, c.quantum, rig.full / c.limit)
    clock = (DT, steps, round(getattr(rig, "delay", 0.0) / step))
    closed_loop(record, gains, reference, position_noise, clock, y, out, signals)
    other = signals[:, 2:] + noise * axis.noise[1] * np.column_stack([unit_noise(n, 0.0, rng) for _ in "ab"])
    t = np.arange(n) * DT
    return Run(t, signals[:, 0], reference, out[:, X], out[:, P], out[:, WAY], signals[:, 1], other)


def at_rest(rig: Any, x: float) -> Array:
    """States of an axis that rests at x; a cylinder with both chambers in balance."""
    y = np.zeros(COUNT)
    y[[X, 2, 9]] = x
    if type(rig).__name__ == "Hydraulic":
        a, b = hydraulic.areas(rig)
        V_a, V_b = hydraulic.volumes(rig, x)
        P_b = (rig.supply + rig.tank) / 2.0
        P_a = (b * P_b + (a - b) * rig.room) / a
        y[A], y[B] = (
            hydraulic.content_at(rig, V_a + rig.creep * P_a, P_a),
            hydraulic.content_at(rig, V_b + rig.creep * P_b, P_b),
        )
        y[E], y[F] = P_a, P_b
    return y


def table(run: Run, rig: Any) -> pd.DataFrame:
    """What a data acquisition writes: t (s), u (V), x, r (deg or mm), and pa, pb (bar) of a cylinder."""
    turns = type(rig).__name__ == "Rotary"
    length = 180.0 / math.pi if turns else 1e3
    columns = {"t": run.t, "u": run.command, "x": length * run.measured, "r": length * run.reference}
    if not turns:
        columns |= {"pa": run.other[:, 0] / 1e5, "pb": run.other[:, 1] / 1e5}
    return pd.DataFrame(columns).round({"t": 4, "u": 6, "x": 5, "r": 5, "pa": 4, "pb": 4})
