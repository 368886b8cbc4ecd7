"""Shares and relaxations that describe what has no name: their forms, on one site and on two that share them."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import BSpline

from optid.core.sheet import build
from optid.effects.curve import HEIGHTS, Scaling
from optid.effects.library import admitted, find_effect
from optid.effects.relaxation import Relaxation
from optid.errors import RigError
from optid.rigs.rigfile import read_rig, with_effects, write_rig
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.effects.plants import grown

BOTH = "flow.chamber_a+flow.chamber_b"
LOW, HIGH = 1e5, 7e5


def rates(model, p, command=0.3, **states):
    """Of the axis, by state, elsewhere at rest with 3 bar on either side."""
    usual = {"pressure_a": 3e5, "pressure_b": 3e5, **states}
    x = [usual.get(one.name, 0.0) for one in model.states]
    found = model.rates(x, [command] + [0.0] * (len(model.inputs) - 1), p)
    return {one.name: float(value) for one, value in zip(model.states, np.array(found).ravel(), strict=True)}


def test_a_share_scales_what_passes_each_of_its_sites_by_that_site_s_own_signal():
    share = Scaling(BOTH, "P", low=LOW, high=HIGH, size=0.2)
    plain, model = build(servo_pneumatic), build(servo_pneumatic, [share])
    heights = np.random.default_rng(3).normal(size=HEIGHTS)
    own = {f"{share.name}.height_{k + 1}": h for k, h in enumerate(heights)}
    values = grown("servo-pneumatic").values
    step = (HIGH - LOW) / (HEIGHTS - 3)
    spline = BSpline(LOW + step * np.arange(-3, HEIGHTS + 1), heights, 3)
    P = {"pressure_a": 2.2e5, "pressure_b": 5.1e5}
    before = rates(plain, plain.vector(values), **P)
    after = rates(model, model.vector({**values, **own}), **P)
    for name, pressure in P.items():  # at rest, what flows is all that changes a pressure
        assert after[name] / before[name] == pytest.approx(1.0 + 0.2 * float(spline(pressure)), rel=1e-9)


def test_a_relaxation_acts_as_its_signal_leaves_and_forgets_in_its_time():
    memory = Relaxation(BOTH, "P", size=1e-4, scale=1e5, start=3e5)
    plain, model = build(servo_pneumatic), build(servo_pneumatic, [memory])
    values = grown("servo-pneumatic").values
    own = {f"{memory.name}.height": 2.0, f"{memory.name}.time": 0.4}
    p, P = model.vector({**values, **own}), {"pressure_a": 4e5, "pressure_b": 2.5e5}
    held = {f"{memory.name}.memory_0": 0.25, f"{memory.name}.memory_1": 0.5}
    found, before = rates(model, p, **P, **held), rates(plain, plain.vector(values), **P)
    off = {"pressure_a": (4e5 - 3e5) / 1e5 - 0.25, "pressure_b": (2.5e5 - 3e5) / 1e5 - 0.5}
    for k, way in enumerate(off.values()):
        assert found[f"{memory.name}.memory_{k}"] == pytest.approx(way / 0.4)
    # 2e-4 kg/s less for every scale that the pressure is off: R T / volume of that a second, times K
    area = np.pi / 4 * values["bore_diameter"] ** 2
    area_b = area - np.pi / 4 * values["rod_diameter"] ** 2
    length = values["stroke"] / 2 + values["residual_length"]
    per_flow = 1.4 * values["gas_constant"] * values["supply_temperature"] / length
    for name, bore in (("pressure_a", area), ("pressure_b", area_b)):
        assert found[name] - before[name] == pytest.approx(-2e-4 * off[name] * per_flow / bore, rel=1e-6)


def test_they_are_found_by_name_and_are_no_candidates():
    for name in (f"scaling@{BOTH}@P", f"relaxation@{BOTH}@P", "relaxation@force.external@velocity"):
        effect = find_effect(name, Path())
        assert effect.name == name
        assert effect.sites == tuple(name.split("@")[1].split("+"))
        assert set(effect.strength) <= {q.name for q in effect.fitted}
    catalogue = {effect.name.partition("@")[0] for effect in admitted(build(servo_pneumatic))}
    assert not catalogue & {"scaling", "relaxation"}
    for wrong in ("relaxation@force.external", "scaling@force.external@position@velocity"):
        with pytest.raises(RigError):
            find_effect(wrong, Path())


def test_a_rig_file_holds_them(tmp_path):
    plain = read_rig(Path(__file__).parents[2] / "data" / "table1.toml")
    both = [Scaling(BOTH, "P", low=LOW, high=HIGH, size=0.2), Relaxation(BOTH, "P", size=1e-4, scale=1e5)]
    rig = with_effects(plain, both, {f"{both[1].name}.height": 0.7, f"{both[1].name}.time": 0.3})
    values = {
        q.name: float(v) for q, v in zip(rig.model.parameters, rig.model.vector(rig.parameters), strict=True)
    }
    write_rig(rig, tmp_path / "rig.toml", values)
    again = read_rig(tmp_path / "rig.toml")
    assert [effect.name for effect in again.effects] == [effect.name for effect in both]
    assert again.model.vector(again.parameters) == pytest.approx(rig.model.vector(rig.parameters), rel=1e-11)
