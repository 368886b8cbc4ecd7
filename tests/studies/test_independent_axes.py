"""The independent rotary and hydraulic rigs: nothing of optid in them, energy and content balance, true stick; fits."""

import ast
from pathlib import Path

import numpy as np
import pytest

from optid.core.readers import read_recording
from optid.estimation.multiple_shooting import fit
from optid.rigs.rigfile import read_rig
from studies import independent_axes
from studies.independent_axes import Hydraulic, Rotary, simulate
from studies.independent_axes.hydraulic import VAPOUR, content_at, filled, pressure
from studies.independent_axes.loop import axis_of, table
from studies.independent_rig import Controller
from studies.references import REFERENCES

DATA = Path(__file__).parents[2] / "data"
OPEN = Controller(kp=0.0, ki=0.0, kd=0.0)


def test_it_imports_nothing_of_optid():
    files = sorted(Path(independent_axes.__file__).parent.glob("*.py"))
    assert len(files) > 5
    for path in files:
        tree = ast.parse(path.read_text())
        modules = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        modules += [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
        assert not [name for name in modules if name.split(".")[0] == "optid"], path


def test_what_a_chamber_holds_gives_back_its_pressure():
    rig = np.array([tuple(Hydraulic())], dtype=[(name, "f8") for name in Hydraulic._fields])[0]
    for P in (3e5, 4e6, 9e6):
        assert pressure(rig, 2e-4, content_at(rig, 2e-4, P)) == pytest.approx(P, rel=1e-9)


@pytest.mark.parametrize("air", [0.0, 5e-3])
def test_oil_that_is_pulled_apart_boils(air):
    rig = np.array([tuple(Hydraulic(air=air))], dtype=[(name, "f8") for name in Hydraulic._fields])[0]
    content = content_at(rig, 2e-4, 1e6)
    least = content * filled(rig, VAPOUR)
    assert pressure(rig, 1.5 * least, content) == VAPOUR
    assert pressure(rig, (1 - 1e-6) * least, content) > VAPOUR
    assert pressure(rig, 2e-4, content) == pytest.approx(1e6, rel=1e-9)


def test_an_arm_that_falls_loses_what_friction_takes():
    """With the winding open, that is at a resistance beyond measure, nothing else acts."""
    rig = Rotary(resistance=1e9)
    start = np.zeros(18)
    start[[0, 2, 9]] = 2.0
    run = simulate(rig, np.zeros(1850), np.random.default_rng(0), controller=OPEN, noise=0.0, start=start)
    inertia = rig.gear**2 * rig.armature + rig.inertia + rig.mass * rig.arm**2
    w = run.momentum / inertia
    energy = inertia * w**2 / 2 - rig.mass * 9.80665 * rig.arm * np.cos(run.position)
    power = rig.viscous * w**2 + rig.coulomb * np.abs(w)
    lost = np.r_[0.0, np.cumsum((power[1:] + power[:-1]) / 2 * 1e-3)]
    assert lost[-1] > 0.5
    assert np.abs(energy + lost - energy[0]).max() < 2e-3
    assert run.way[-500:].any() == 0.0 and np.ptp(run.position[-500:]) == 0.0


@pytest.mark.full
@pytest.mark.parametrize(
    "rig", [Rotary(mass=0.45, viscous=0.06, coulomb=0.1), Hydraulic(bulk=1.4e9, coulomb=380.0)]
)
def test_a_fit_ends_at_the_truth(rig, tmp_path):
    names = {
        "Rotary": ("rotary_axis", ("payload_mass", "mass")),
        "Hydraulic": ("servo_hydraulic", ("bulk_modulus", "bulk")),
    }
    file, (name, own) = names[type(rig).__name__]
    rng = np.random.default_rng(3)
    wanted = REFERENCES["mixed"](3.0, 1e-3, rng, 0.1) * axis_of(rig).reach / 0.1
    table(simulate(rig, wanted, rng), rig).to_csv(tmp_path / "run.csv", index=False)
    found = fit(read := read_rig(DATA / f"{file}.toml"), [read_recording(tmp_path / "run.csv", read)])
    truth = {name: getattr(rig, own), "viscous_friction": rig.viscous, "coulomb_friction": rig.coulomb}
    for estimate in found.parameters:
        if estimate.name in truth:
            assert estimate.value == pytest.approx(truth[estimate.name], rel=0.02), estimate.name
        if estimate.name in (name, "coulomb_friction"):
            off = (
                1e-3 * truth[estimate.name]
            )  # the bristle that stands in for true stick shifts less than that
            assert estimate.low - off <= truth[estimate.name] <= estimate.high + off, estimate.name
