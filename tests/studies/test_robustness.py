"""The robustness study: its recordings are as bad as it says, and a row tells right from wrong."""

from types import SimpleNamespace

import numpy as np
import pytest

from studies import robustness
from studies.robustness import CONDITIONS, RIGS, Condition, recorded, rig_file


@pytest.mark.parametrize("name", ["250_Hz", "missing_2_percent", "12_bits", "4_s"])
def test_recordings_are_as_bad_as_they_are_called(name):
    condition = CONDITIONS[name]
    one = recorded(RIGS["sound"][0], condition)[0]
    x = one["position"].values
    assert one.interval == pytest.approx(1.0 / condition.rate)
    assert len(one) == condition.rate * condition.seconds
    assert np.isnan(x).any() == (name == "missing_2_percent")
    if name == "12_bits":
        steps = x / (0.26 / 4096)
        assert np.abs(steps - np.round(steps)).max() < 2e-3  # the table has a tenth of a micrometre


def test_recordings_may_begin_at_rest_in_the_midst_of_motion():
    whole = recorded(RIGS["sound"][0], Condition(seconds=10.0))
    for one, run in zip(recorded(RIGS["sound"][0], Condition(seconds=1.0, running=3.0)), whole, strict=True):
        x = one["position"].values
        assert len(one) == 1000 and one.time[0] == 0.0
        assert np.ptp(x[:80]) < 3e-4  # ten times the noise
        places = run["position"].values[3000:9000]
        assert np.ptp(run["position"].values[1000:3000]) > 2e-3
        assert np.abs(places - x[0]).min() < 1e-3


def test_start_values_are_wrong_within_their_bounds():
    usual, low = (rig_file(CONDITIONS[name]) for name in ("usual", "start_values_50_percent_low"))
    for freed in usual.freed:
        wanted = max(0.5 * usual.parameters[freed.name], freed.low)
        assert low.parameters[freed.name] == pytest.approx(wanted)
    assert low.parameters["viscous_friction"] == pytest.approx(0.5 * usual.parameters["viscous_friction"])


@pytest.mark.parametrize(
    ("rig", "names", "verdict", "result"),
    [
        ("sound", [], "consistent", "right"),
        ("sound", [], "unexplained", "silent"),
        ("sound", ["valve_lag"], "missing-physics", "wrong name"),
        ("leaking", ["ambient_leakage"], "missing-physics", "right"),
        ("leaking", ["ambient_leakage", "valve_lag"], "missing-physics", "wrong name"),
        ("leaking", [], "consistent", "silent"),
    ],
)
def test_a_row_tells_right_from_silent_and_wrong(rig, names, verdict, result, monkeypatch):
    findings = [SimpleNamespace(effect=SimpleNamespace(name=name)) for name in names]
    said = SimpleNamespace(
        findings=findings, verdict=SimpleNamespace(value=verdict), test=SimpleNamespace(error_over_noise=1.0)
    )
    monkeypatch.setattr(robustness, "recorded", lambda *others: [None, None])
    monkeypatch.setattr(robustness, "diagnose", lambda *others, **more: said)
    assert robustness.row(("usual", rig)).result == result
