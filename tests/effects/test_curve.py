"""The curve that describes what has no name: its form, and that it stays out of the catalogue."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BSpline

from optid.core.sheet import build
from optid.effects.curve import BENDS, HEIGHTS, Curve
from optid.effects.library import admitted, find_effect
from optid.errors import PlantError, RigError
from optid.rigs.emps import emps
from optid.rigs.rigfile import read_rig, with_effects, write_rig

LOW, HIGH, SIZE, WIDTH = -0.2, 0.6, 40.0, 0.02


def force(curve, position, velocity, heights):
    """What a curve adds to the axis' force, N: from what it does to the acceleration."""
    values = {f"{curve.name}.height_{k + 1}": h for k, h in enumerate(heights)}
    plain = read_rig(Path(__file__).parents[2] / "data" / "emps.toml")
    full = with_effects(plain, [curve], values)
    moving = {"position": position, "velocity": velocity}
    x = [moving.get(one.name, 0.0) for one in plain.model.states]
    row = [one.name for one in plain.model.states].index("velocity")
    with_it, without = (
        float(rig.model.rates(x, [0.0], rig.model.vector(rig.parameters))[row]) for rig in (full, plain)
    )
    return (with_it - without) * plain.parameters["mass"]


@pytest.mark.parametrize("position", [-0.5, LOW, -0.13, 0.2, 0.41, HIGH, 1.0])
@pytest.mark.parametrize("velocity", [-0.015, 0.3])
@pytest.mark.parametrize("speed", ["", "velocity"])
def test_it_is_a_cubic_spline_that_goes_on_straight_and_may_turn_with_a_speed(position, velocity, speed):
    curve = Curve("force.external", "position", speed, low=LOW, high=HIGH, size=SIZE, width=WIDTH)
    heights = np.random.default_rng(3).normal(size=HEIGHTS)
    step = (HIGH - LOW) / (HEIGHTS - 3)
    spline = BSpline(LOW + step * np.arange(-3, HEIGHTS + 1), heights, 3)
    turned = velocity / np.hypot(velocity, WIDTH) if speed else 1.0
    held = min(max(position, LOW), HIGH)
    expected = SIZE * float(spline(held) + (position - held) * spline.derivative()(held)) * turned
    assert force(curve, position, velocity, heights) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_it_is_found_by_its_name_and_is_no_candidate():
    for name in ("curve@force.external@position", "curve@force.external@position@velocity"):
        curve = find_effect(name, Path())
        assert (curve.name, curve.sites) == (name, ("force.external",))
        assert curve.strength.keys() == {q.name for q in curve.fitted}
        assert {"low", "high", "size"} <= {q.name for q in curve.parameters if not q.fitted}
    assert not any(effect.name.startswith("curve") for effect in admitted(build(emps)))
    with pytest.raises(RigError, match="curve"):
        find_effect("curve@force.external", Path())


def test_a_signal_that_the_plant_does_not_have_is_named():
    with pytest.raises(PlantError, match=r'no state or input "positon".*position'):
        build(emps, [Curve("force.external", "positon")])


def test_a_rig_file_states_all_of_its_numbers(tmp_path):
    plain = Path(__file__).parents[2] / "data/emps.toml"
    curve = Curve("force.external", "position", low=LOW, high=HIGH, size=SIZE)
    values = {f"{curve.name}.{q.name}": float(q.default) for q in curve.parameters}
    write_rig(with_effects(read_rig(plain), [curve]), tmp_path / "whole.toml", values)
    assert read_rig(tmp_path / "whole.toml").effects[0].name == curve.name
    lines = (tmp_path / "whole.toml").read_text().splitlines(keepends=True)
    (tmp_path / "cut.toml").write_text("".join(line for line in lines if "height_7" not in line))
    with pytest.raises(RigError, match="no value for height_7") as caught:
        read_rig(tmp_path / "cut.toml")
    assert curve.name in str(caught.value.field)


def test_its_ways_are_a_constant_a_slope_and_bends_of_a_usual_size():
    curve = Curve("force.external", "position", low=LOW, high=HIGH, size=SIZE)
    shapes = [
        [force(curve, x, 0.0, list(way.values())) / SIZE for x in (LOW, (LOW + HIGH) / 2, HIGH)]
        for way in curve.ways
    ]
    inner = (HEIGHTS - 3) / (HEIGHTS - 1)  # its ends lie one knot inside those of the heights
    assert shapes[0] == pytest.approx([1.0, 1.0, 1.0]) and shapes[1] == pytest.approx([-inner, 0.0, inner])
    assert np.linalg.matrix_rank([list(way.values()) for way in curve.ways]) == len(curve.ways) == BENDS
