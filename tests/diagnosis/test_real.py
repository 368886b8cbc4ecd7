"""Real recordings: the overflow of the cascaded tanks and the direction-dependent friction of EMPS are named."""

from dataclasses import replace
from pathlib import Path

import pytest

from optid.core.readers import read_recording
from optid.diagnosis.pipeline import diagnose
from optid.diagnosis.result import Verdict
from optid.rigs.rigfile import read_rig

DATA = Path(__file__).parents[2] / "data"


@pytest.mark.xfail(
    strict=True, reason="windows of fifty samples show the overflow less than a simulation did"
)
def test_the_overflow_of_the_real_tanks_is_named(shared):
    path = shared / "recordings" / "cascaded_tanks" / "dataBenchmark.csv"
    if not path.is_file():
        pytest.skip(f"{path.name} is not there")
    rig = read_rig(DATA / "cascaded_tanks.toml")
    other = {"command": "uVal", "level": "yVal"}
    channels = {role: replace(c, column=other.get(role, c.column)) for role, c in rig.channels.items()}
    train, held = read_recording(path, rig), read_recording(path, replace(rig, channels=channels))
    found = diagnose(rig, [train], [held])
    assert found.verdict is Verdict.MISSING_PHYSICS
    assert found.findings[0].effect.name == "overflow"
    assert found.test.base.horizon == 200.0  # s: fifty samples, half a second would hold none
    before, after = (one.scores["level"].rmse for one in (found.test.base, found.test.best))
    assert after < 0.3 < before  # V; the best published grey box simulates the record within 0.18 V


@pytest.mark.full
@pytest.mark.xfail(
    reason="its viscous part comes out at -0.21 where -0.18 is published, and its twin is not met"
)
def test_the_friction_of_the_real_axis_is_named(shared):
    """By whole records: of these the effect, led from afar, first ends on a lower top than from where the model is."""
    folder = shared / "recordings" / "emps"
    if not folder.is_dir():
        pytest.skip("the EMPS recordings are not there")
    rig = read_rig(DATA / "emps.toml")
    train, held = (read_recording(folder / f"{n}.mat", rig) for n in ("DATA_EMPS", "DATA_EMPS_PULSES"))
    found = diagnose(rig, [train], [held])
    assert found.verdict is Verdict.MISSING_PHYSICS
    (finding,) = found.findings
    assert finding.effect.name == "asymmetric_friction"
    # Published: 166.7 forwards and 240.4 N s/m backwards, half their difference -0.181 of their mean.
    viscous = {e.name: e for e in finding.parameters}["viscous_asymmetry"]
    assert viscous.value == pytest.approx(-0.181, abs=0.03)
    # The published model has a constant force beside it, which is what its dry part amounts to.
    assert "constant_force" in finding.indistinguishable
    assert "cannot distinguish it from constant_force" in found.summary
    before, after = (one.scores["position"].rmse for one in (found.test.base, found.test.best))
    assert after < 0.8 * before
