"""Fits against truth from outside: rigs simulated by code that shares nothing with optid."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from optid.core.parameter import Nuisance
from optid.core.readers import read_recording
from optid.core.units import to_si
from optid.estimation.multiple_shooting import fit
from optid.estimation.prediction import predict
from optid.estimation.profile import profile
from optid.estimation.result import Outcome
from optid.rigs import friction
from optid.rigs.rigfile import read_rig

DATA = Path(__file__).parents[2] / "data"


def test_the_embedded_bench_is_found_again():
    rig = read_rig(DATA / "bench.toml")
    result = fit(rig, [read_recording(DATA / "bench.csv", rig)])
    truth = json.loads((DATA / "bench_truth.json").read_text())
    assert result.outcome is Outcome.CONVERGED
    noise = truth.pop("position_noise")["value"]
    units = {p.name: p.unit for p in result.parameters}
    for name, entry in truth.items():
        exact = to_si(f"{entry['value']} {entry['unit']}", units[name])
        assert result.values[name] == pytest.approx(exact, rel=5e-3), name
    held_out = predict(
        rig, read_recording(DATA / "bench_holdout.csv", rig), result.values, result.process_noise
    )
    assert held_out.scores["window"]["position"].rmse < 1.1 * noise


def test_the_plain_example_is_found_within_its_intervals(shared):
    folder = shared / "examples" / "plain"
    rig = read_rig(folder / "rig.toml")
    result = fit(rig, [read_recording(folder / f"{n}.csv", rig) for n in ("steps", "multisine", "ramps")])
    answer = json.loads((folder / "answer.json").read_text())
    truth = {
        "discharge_coefficient": answer["discharge_coefficient"],
        "residual_length": answer["residual_length_m"],
        "viscous_friction": answer["viscous_friction_N_s_per_m"],
        "coulomb_friction": answer["coulomb_friction_N"],
    }
    assert result.outcome is Outcome.CONVERGED
    for estimate in result.parameters:
        if estimate.name in truth:
            assert estimate.low <= truth[estimate.name] <= estimate.high, estimate
    held_out = predict(rig, read_recording(folder / "mixed.csv", rig), result.values, result.process_noise)
    assert held_out.scores["window"]["position"].rmse <= 1.1 * 30e-6
    assert held_out.scores["free_run"]["position"].rmse <= 1.1 * 30e-6
    assert held_out.frame["position_window"].isna().sum() == 500


def test_elastic_motion_that_is_only_simulated_does_not_bias_the_rest(monkeypatch):
    """The bench sticks truly: a fit goes on below the elastic motion at which its search ended, whatever that was."""
    longer = replace(friction.PRESLIDING_LENGTH, nuisance=Nuisance(low=6e-6))
    monkeypatch.setattr(friction, "PRESLIDING_LENGTH", longer)
    rig = read_rig(DATA / "bench.toml")
    data = [read_recording(DATA / "bench.csv", rig)]
    result = fit(rig, data)
    found = {e.name: e for e in result.parameters}
    assert found["presliding_length"].value < 1e-6
    drag = found["viscous_friction"]
    # Where the search ends it is 0.2 low.
    assert drag.value == pytest.approx(61.3, abs=0.12)
    # A profile starts there as well, not at the bound of the search.
    seen = profile(rig, data, result, "viscous_friction")
    assert seen.value == pytest.approx(drag.value, abs=0.25 * (drag.high - drag.low))
    assert seen.others["presliding_length"].max() < 2e-6
