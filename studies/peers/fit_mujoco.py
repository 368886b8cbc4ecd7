"""A rotary axis in MuJoCo, fitted by MuJoCo's own system identification (`pip install "mujoco[sysid]"`).

Gear, armature and winding are reflected to the joint: the actuator's gain is N K_t / R, its bias the back-emf. Dry
friction is MuJoCo's `frictionloss`, a soft constraint, which creeps where a bristle or true stick holds.
"""

from __future__ import annotations

import contextlib
import importlib.util
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MODEL = """
<mujoco>
  <option timestep="{step}" gravity="0 0 -9.80665" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="shaft" type="hinge" axis="0 -1 0" damping="{viscous_friction}"
        frictionloss="{coulomb_friction}" armature="{reflected}"/>
      <inertial pos="0 0 {below}" mass="{payload_mass}" diaginertia="{load_inertia} {load_inertia} {load_inertia}"/>
    </body>
  </worldbody>
  <actuator>
    <general name="motor" joint="shaft" gaintype="fixed" biastype="affine"
      gainprm="{gain}" biasprm="0 0 -{back_emf}"/>
  </actuator>
  <sensor><jointpos name="angle" joint="shaft"/></sensor>
</mujoco>
"""


@dataclass(frozen=True)
class Record:
    """Times (s), held voltage (V) and measured angle (rad), one value a sample each."""

    time: Array
    voltage: Array
    angle: Array


@dataclass(frozen=True)
class Found:
    """Values by the rig file's names, SI, and half-widths of their 95 % intervals."""

    values: dict[str, float]
    half_widths: dict[str, float]


def available() -> bool:
    """Whether MuJoCo and its identification are installed."""
    return importlib.util.find_spec("mujoco") is not None and importlib.util.find_spec("plotly") is not None


def fit(
    parameters: Mapping[str, float],
    bounds: Mapping[str, tuple[float, float]],
    records: Sequence[Record],
    steps: int = 1,
) -> Found:
    """Fit a rotary axis to recordings of the voltage and the angle.

    Args:
        parameters: all of the axis by the rig file's names, SI; those in `bounds` are starts.
        bounds: of payload_mass, load_inertia, viscous_friction and coulomb_friction, SI.
        records: each starts at rest at its first angle.
        steps: of the integration in each sample.
    """
    import mujoco
    from mujoco import sysid

    step = float(records[0].time[1] - records[0].time[0]) / steps
    spec = mujoco.MjSpec.from_string(_xml(parameters, step))
    model = spec.compile()
    asked = sysid.ParameterDict()
    for name, (low, high) in bounds.items():
        least = max(low, 1e-9)  # a body must have some mass and inertia
        asked.add(sysid.Parameter(name, parameters[name], least, high, modifier=MODIFIERS[name]))
    sequences = sysid.ModelSequences(
        "arm",
        spec,
        [f"record {number}" for number in range(len(records))],
        [sysid.create_initial_state(model, one.angle[:1], np.zeros(1)) for one in records],
        [
            sysid.TimeSeries.from_control_names(
                one.time[0] + step * np.arange(steps * len(one.time)), held(one.voltage, steps), model
            )
            for one in records
        ],
        [sysid.TimeSeries.from_names(one.time, one.angle[:, None], model) for one in records],
    )
    residual = sysid.build_residual_fn(models_sequences=[sequences])
    with contextlib.redirect_stdout(io.StringIO()):  # it tells every iteration
        values, outcome = sysid.optimize(asked, residual, verbose=False)
    missed, _, _ = residual(outcome.x, values)
    _, widths = sysid.calculate_intervals(missed, outcome.jac)
    return Found(
        dict(zip(bounds, map(float, outcome.x), strict=True)), dict(zip(bounds, widths, strict=True))
    )


def held(voltage: Array, steps: int) -> Array:
    """The voltage at every step, held between its samples, (steps, 1)."""
    return np.repeat(voltage, steps)[:, None]


def _xml(p: Mapping[str, float], step: float) -> str:
    k = p["gear_ratio"] * p["torque_constant"]
    return MODEL.format(
        step=step,
        reflected=p["gear_ratio"] ** 2 * p["armature"],
        below=-p["arm_length"],
        gain=k / p["resistance"],
        back_emf=k**2 / p["resistance"],
        **{name: p[name] for name in MODIFIERS},
    )


def _viscous(spec: Any, q: Any) -> None:
    joint = spec.joint("shaft")  # newer versions hold a polynomial of the speed
    linear = float(q.value[0])
    joint.damping = linear if np.ndim(joint.damping) == 0 else np.r_[linear, np.zeros(len(joint.damping) - 1)]


def _coulomb(spec: Any, q: Any) -> None:
    spec.joint("shaft").frictionloss = float(q.value[0])


def _mass(spec: Any, q: Any) -> None:
    spec.body("arm").mass = float(q.value[0])


def _inertia(spec: Any, q: Any) -> None:
    spec.body("arm").inertia = np.full(3, float(q.value[0]))


MODIFIERS = {
    "load_inertia": _inertia,
    "payload_mass": _mass,
    "viscous_friction": _viscous,
    "coulomb_friction": _coulomb,
}
