"""An axis with dry friction is found in its recording: friction, break-away, load, dead zone, nothing where none is."""

import json
import math
from dataclasses import asdict

import numpy as np
import pytest

from optid.armax.files import ArmaxFile, SavedModel, load, save
from optid.armax.model import Armax
from optid.armax.signals import signals
from optid.armax.sliding import axis_shown, mode_frequency, sliding_axis
from optid.errors import InputError

T, W, C, F, GAIN = 1e-3, 80.0, 30.0, 25.0, 0.5
FINE = 20


def moved(
    breakaway=1.0,
    load=0.0,
    width=0.0,
    asymmetry=0.0,
    friction=F,
    sign=1.0,
    seconds=8.0,
    decay=0.0,
    curvature=0.0,
):
    """Position (with 0.03 mm of noise) and command of an axis in a loop, moved about; written out anew."""
    rng = np.random.default_rng(5)
    n, h = round(seconds / T), T / FINE
    goal = np.repeat(rng.uniform(-0.08, 0.08, math.ceil(n / 400)), 400)[:n] + 0.01 * np.sin(
        40.0 * T * np.arange(n)
    )
    noise = 3e-5 * rng.standard_normal(n)
    x = v = force = before = 0.0
    y, u = np.empty(n), np.empty(n)
    for k in range(n):
        y[k] = x + noise[k]
        wish = 25.0 * (goal[k] - y[k]) - 0.2 * (y[k] - before) / T
        before, u[k] = y[k], sign * min(max(wish, -5.0), 5.0)
        passed = math.copysign(max(abs(u[k]) - width, 0.0), u[k]) * sign
        drive = GAIN * W * W * (passed + asymmetry * abs(passed) + load)
        for _ in range(FINE):
            grown = 1.0 + curvature * x * x
            force += h * (grown * (drive - W * W * v) - decay * abs(passed) * force)
            free = v + h * (force - C * v)
            reach = h * friction * (breakaway if v == 0.0 else 1.0)
            v = 0.0 if abs(free) <= reach else free - math.copysign(reach, free)
            x += h * v
    return y, u


def found(**physics):
    return sliding_axis(*moved(**physics), T, 90.0)


def test_a_plain_axis():
    axis = found()
    assert axis.speed_gain == pytest.approx(GAIN, rel=0.03)
    assert axis.frequency == pytest.approx(W, rel=0.05)
    assert axis.damping + axis.dry_friction == pytest.approx(C + F, rel=0.2)
    assert axis.dry_friction == pytest.approx(F, rel=0.25)
    assert axis.breakaway_ratio == 1.0 and axis.load == 0.0 and axis.dead_zone == 0.0
    assert abs(axis.asymmetry) < 0.02 and axis.explained > 0.95


@pytest.mark.parametrize(
    ("physics", "name", "value", "off"),
    [
        ({"breakaway": 1.6}, "breakaway_ratio", 1.45, 0.25),
        ({"load": 0.1}, "load", 0.1, 0.02),
        ({"width": 0.1}, "dead_zone", 0.1, 0.03),
        ({"asymmetry": 0.15}, "asymmetry", 0.15, 0.03),
        ({"sign": -1.0}, "speed_gain", -GAIN, 0.02),
    ],
)
def test_what_is_there_is_found_and_taken_for_nothing_else(physics, name, value, off):
    axis = asdict(found(**physics))
    assert axis.pop(name) == pytest.approx(value, abs=off)
    silent = {"breakaway_ratio": 1.0, "load": 0.0, "dead_zone": 0.0}
    assert all(axis[key] == nothing for key, nothing in silent.items() if key in axis)


def test_dry_friction_is_not_taken_for_damping():
    """Though the force decays through the open valve, and the air is stiffer towards the ends of the stroke."""
    axis = found(decay=8.0, curvature=80.0)
    assert axis.dry_friction == pytest.approx(F, rel=0.15) and axis.damping == pytest.approx(C, rel=0.15)
    assert axis.decay == pytest.approx(8.0, rel=0.3) and axis.half_travel > 0.05
    assert axis.gain_curvature == pytest.approx(80.0, rel=0.3)
    assert axis.stiffness_curvature == pytest.approx(80.0, rel=0.3)
    assert abs(axis.gain_slope) < 0.5 and abs(axis.stiffness_slope) < 0.5
    assert axis.speed_gain == pytest.approx(GAIN, rel=0.05) and axis.frequency == pytest.approx(W, rel=0.05)
    assert found().decay < 1.5


def test_recordings_without_such_an_axis():
    y, u = moved()
    assert sliding_axis(y[:100], u[:100], T, 90.0) is None  # too short
    assert found(friction=0.0) is None  # nothing dry
    rng = np.random.default_rng(1)
    lag, noise = np.zeros(4000), rng.standard_normal(4000)
    for k in range(1, 4000):
        lag[k] = 0.99 * lag[k - 1] + 0.01 * noise[k - 1]
    assert sliding_axis(lag, noise, T, 90.0) is None  # no axis at all


def test_missing_samples_are_left_out():
    y, u = moved()
    gaps = y.copy()
    gaps[1000:1040] = gaps[3000:3010] = np.nan
    assert sliding_axis(gaps, u, T, 90.0).dry_friction == pytest.approx(
        sliding_axis(y, u, T, 90.0).dry_friction, rel=0.1
    )


def test_the_mode_is_the_slowest_pair_beside_the_integrator():
    pair = np.exp(complex(-20.0, 77.0) * T)
    fast = -0.85 + 0.47j  # nearer to the circle, and no mode of an axis
    a = np.real(np.poly([1.0002, pair, pair.conjugate(), fast, fast.conjugate()]))
    model = Armax(tuple(a), ((1e-6,),), (1.0,), (1,), T)
    assert mode_frequency(model) == pytest.approx(math.hypot(20.0, 77.0), rel=1e-6)
    assert mode_frequency(Armax((1.0, -0.5), ((1.0,),), (1.0,), (1,), T)) is None
    y, u = moved()
    assert axis_shown(signals(y, u), model) is not None
    assert axis_shown(signals(y, np.column_stack([u, u])), model) is None


def test_a_model_file_keeps_the_axis(tmp_path):
    path, axis = tmp_path / "armax.json", found(load=0.1)
    model = Armax((1.0, -0.9), ((1.0,),), (1.0,), (1,), T)
    contents = ArmaxFile("command", "position", 1, (SavedModel(model),), axis=axis)
    save(path, contents)
    assert load(path).axis == axis
    document = json.loads(path.read_text())
    for field, value in (("frequency", -1.0), ("breakaway_ratio", 0.5), ("load", "much"), ("damping", None)):
        path.write_text(json.dumps(document | {"axis": document["axis"] | {field: value}}))
        with pytest.raises(InputError, match="axis"):
            load(path)
    path.write_text(json.dumps({k: v for k, v in document.items() if k != "axis"}))
    assert load(path).axis is None
