"""Profile likelihood: the fit's own interval where the model is straight, lopsided or open where it is not."""

import json
import math

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from optid.cli import cli
from optid.errors import InputError, NotIdentifiable
from optid.estimation.multiple_shooting import FitOptions, fit
from optid.estimation.profile import profile
from tests.estimation.cart import TRUTH, recording, rig

SIMULATION = FitOptions(process_noise=0.0)


def test_of_a_well_known_parameter_is_the_interval_of_the_fit(tmp_path):
    cart, data = rig(tmp_path), [recording(np.random.default_rng(1))]
    result = fit(cart, data, SIMULATION)
    found = profile(cart, data, result, "gain", SIMULATION)
    low, high = found.linear
    assert found.low == pytest.approx(low, abs=0.03 * (high - low))
    assert found.high == pytest.approx(high, abs=0.03 * (high - low))
    assert found.low < TRUTH["gain"] < found.high
    assert found.deviance.min() >= -1e-3
    assert np.all(np.diff(found.values) > 0)
    assert "as symmetric" in found.sentence
    # Along the valley a stronger push goes with a stronger drag.
    assert found.others["drag"].is_monotonic_increasing


def test_follows_a_valley_that_bends(tmp_path):
    """Data know the product share * gain, a prior the gain: the ends of share's interval follow by hand."""
    free = (
        'gain = { bounds = ["0.1 m/s**2", "50 m/s**2"], sd = "0.6 m/s**2" }\nshare = { bounds = [0.1, 10] }'
    )
    cart = rig(tmp_path, free, gain=TRUTH["gain"], drag=TRUTH["drag"])
    data = [recording(np.random.default_rng(2), sd=1e-4)]
    result = fit(cart, data, SIMULATION)
    found = profile(cart, data, result, "share", SIMULATION)
    reach = 0.6 * math.sqrt(found.limit)
    assert found.low == pytest.approx(TRUTH["gain"] / (TRUTH["gain"] + reach), rel=0.02)
    assert found.high == pytest.approx(TRUTH["gain"] / (TRUTH["gain"] - reach), rel=0.02)
    assert found.linear[0] == pytest.approx(1 - reach / TRUTH["gain"], rel=0.02)
    assert "times as far upwards" in found.sentence


def test_is_refused_where_there_is_no_valley(tmp_path):
    free = 'gain = { bounds = ["0.1 m/s**2", "2.5 m/s**2"] }'
    cart, data = rig(tmp_path, free, drag=TRUTH["drag"]), [recording(np.random.default_rng(3))]
    result = fit(cart, data, SIMULATION)
    assert result.parameters[0].at_bound
    with pytest.raises(NotIdentifiable, match="gain lies at its bound"):
        profile(cart, data, result, "gain", SIMULATION)
    with pytest.raises(InputError, match='"drag" is not fitted'):
        profile(cart, data, result, "drag", SIMULATION)
    (gain,) = result.parameters
    assert math.isinf(gain.high) and math.isfinite(gain.low)  # nothing is known beyond the bound


def test_on_the_command_line(tmp_path, own_cache):
    rig(tmp_path)
    data = recording(np.random.default_rng(4), seconds=2.0)
    table = {"t": data.time, "u": data["command"].values, "x": data["position"].values}
    pd.DataFrame(table).to_csv(tmp_path / "cart.csv", index=False)
    call = ["fit", f"{tmp_path}/cart.toml", f"{tmp_path}/cart.csv", "--out", f"{tmp_path}/out"]
    result = CliRunner().invoke(cli, [*call, "--profile", "drag", "--profile", "drag"])
    assert result.exit_code == 0, result.output
    assert result.output.count("drag: 95 % of the profile likelihood within") == 1
    found = json.loads((tmp_path / "out" / "fit.json").read_text())["profiles"]
    assert list(found) == ["drag"]
    low, high = found["drag"]["ci95"]
    assert abs(TRUTH["drag"] - (low + high) / 2) < high - low  # four sd: one noise is no study of coverage
    assert len(found["drag"]["values"]) == len(found["drag"]["deviance"])
    assert "Profile likelihood" in (tmp_path / "out" / "report.html").read_text()
    result = CliRunner().invoke(cli, [*call, "--profile", "share"])
    assert result.exit_code == 2
    assert '"share" is not fitted' in result.stderr
