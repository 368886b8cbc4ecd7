"""What a batch fit promises, on a cart whose motion is known in closed form."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from optid.errors import InputError, NotIdentifiable
from optid.estimation.multiple_shooting import FitOptions, fit
from optid.estimation.result import Outcome
from tests.estimation.cart import FREE, RATE, SD, TRUTH, moved, record, recording, rig

BOTH_GAINS = 'gain = { bounds = ["0.1 m/s**2", "50 m/s**2"] }\nshare = { bounds = [0.1, 10] }'


def estimates(result):
    return {e.name: e for e in result.parameters}


def test_several_recordings_each_from_its_own_start(tmp_path):
    rng = np.random.default_rng(1)
    u = np.repeat(rng.uniform(-1, 1, 12), 100)
    other = moved(u, 1 / RATE, x=0.4, v=-2.0) + SD * rng.standard_normal(len(u))
    data = [recording(rng), record(u, other, "other.csv")]
    result = fit(rig(tmp_path), data)
    assert result.outcome is Outcome.CONVERGED
    assert result.certificate.sound
    for name, truth in TRUTH.items():
        assert estimates(result)[name].low < truth < estimates(result)[name].high
    heads = result.certificate.frame.drop_duplicates("recording").index
    assert result.states[heads] == pytest.approx(np.array([[0.0, 0.0], [0.4, -2.0]]), abs=0.02)
    assert result.noise["position"] == pytest.approx(SD, rel=0.05)


def test_missing_samples_count_for_nothing(tmp_path):
    cart, whole = rig(tmp_path), recording(np.random.default_rng(2))
    x = np.array(whole["position"].values)
    gone = np.random.default_rng(3).random(len(x)) < 0.3
    gone[400:700] = True
    holed = record(whole["command"].values, np.where(gone, np.nan, x))
    result = fit(cart, [holed])
    assert result.outcome is Outcome.CONVERGED
    for name, truth in TRUTH.items():
        assert estimates(result)[name].low < truth < estimates(result)[name].high


def test_robust_loss_forgives_outliers(tmp_path):
    cart, rng = rig(tmp_path), np.random.default_rng(4)
    clean = recording(rng)
    x = np.array(clean["position"].values)
    hit = rng.random(len(x)) < 0.03
    x[hit] += 0.3 * np.sign(clean["command"].values[hit])
    spoilt = [record(clean["command"].values, x)]
    options = FitOptions(process_noise=0.0)
    plain = fit(cart, spoilt, options)
    robust = fit(cart, spoilt, FitOptions(process_noise=0.0, huber=1.345))
    errors = {
        name: (abs(plain.values[name] - truth), abs(robust.values[name] - truth))
        for name, truth in TRUTH.items()
    }
    assert all(good < 0.1 * bad for bad, good in errors.values()), errors


def test_a_prior_weighs_as_its_standard_deviation_says(tmp_path):
    """Two sources of one number combine by their precisions."""
    only = 'gain = { bounds = ["0.1 m/s**2", "50 m/s**2"] }'
    data, options = [recording(np.random.default_rng(5), seconds=2.0)], FitOptions(process_noise=0.0)
    alone = estimates(fit(rig(tmp_path, only, drag=2.0), data, options))["gain"]
    sd = 1.0 / np.sqrt(_information(rig(tmp_path, only, drag=2.0), data, alone.value))
    believed = only.replace(" }", f', sd = "{sd} m/s**2" }}')
    start = alone.value + 4 * sd
    result = estimates(fit(rig(tmp_path, believed, gain=start, drag=2.0), data, options))["gain"]
    assert result.value == pytest.approx((alone.value + start) / 2, abs=0.05 * sd)


def _information(cart, data, gain):
    """On the gain with known noise and start at rest: the sum of squared slopes over the variance."""
    u = data[0]["command"].values
    slope = moved(u, 1 / RATE, gain=gain + 0.5) - moved(u, 1 / RATE, gain=gain - 0.5)
    free = np.column_stack([np.ones(len(u)), (1 - np.exp(-2.0 * data[0].time)) / 2.0])
    rest = slope - free @ np.linalg.lstsq(free, slope, rcond=None)[0]  # the start state is not known
    return float(rest @ rest) / SD**2


def test_intervals_count_what_a_stand_in_is_known_to_shift(tmp_path):
    """Its share of the value stands beside the standard deviation of the noise, as squares."""
    cart = rig(tmp_path)
    data = [recording(np.random.default_rng(8))]
    plain = estimates(fit(cart, data))
    known = replace(cart, model=replace(cart.model, biases={"drag": 0.05}))
    wide = estimates(fit(known, data))
    sds = [(found["drag"].high - found["drag"].low) / 2 / 1.959964 for found in (plain, wide)]
    assert wide["drag"].value == plain["drag"].value
    assert sds[1] == pytest.approx(np.hypot(sds[0], 0.05 * plain["drag"].value), rel=1e-5)
    assert (wide["gain"].low, wide["gain"].high) == (plain["gain"].low, plain["gain"].high)


def test_a_bound_is_met_and_said(tmp_path):
    free = 'gain = { bounds = ["0.1 m/s**2", "2.5 m/s**2"] }\ndrag = { bounds = ["0.01 1/s", "50 1/s"] }'
    result = fit(rig(tmp_path, free), [recording(np.random.default_rng(6))], FitOptions(process_noise=0.0))
    assert estimates(result)["gain"].at_bound
    assert estimates(result)["gain"].value == 2.5
    assert not estimates(result)["drag"].at_bound


def test_parameters_that_appear_only_as_a_product_are_said_to(tmp_path):
    result = fit(
        rig(tmp_path, f"{BOTH_GAINS}\n{FREE.splitlines()[1]}"), [recording(np.random.default_rng(7))]
    )
    assert result.ties == ("gain and share appear only as a product: fix one of them",)
    found = estimates(result)
    assert not found["gain"].identifiable
    assert not found["share"].identifiable
    assert found["drag"].identifiable
    assert found["gain"].value * found["share"].value == pytest.approx(TRUTH["gain"], rel=0.01)
    assert found["drag"].low < TRUTH["drag"] < found["drag"].high


def test_a_parameter_without_influence_is_refused(tmp_path):
    coasting = record(np.zeros(400), moved(np.zeros(400), 1 / RATE, v=1.0))
    with pytest.raises(NotIdentifiable, match="gain: without influence"):
        fit(rig(tmp_path), [coasting])


def test_nothing_freed_is_refused(tmp_path):
    with pytest.raises(InputError, match="nothing to fit"):
        fit(rig(tmp_path, ""), [recording(np.random.default_rng(8))])


def test_the_time_limit_keeps_the_best_point(tmp_path):
    cart, data = rig(tmp_path), [recording(np.random.default_rng(9))]
    seen = []
    result = fit(cart, data, FitOptions(time_limit=1e-9, starts=5), seen.append)
    assert result.outcome is Outcome.TIME_LIMIT
    assert {report.stage.split(",")[0] for report in seen} == {"start 1 of 5"}
    assert abs(result.values["gain"] - TRUTH["gain"]) < abs(2.0 - TRUTH["gain"])


def test_starts_are_drawn_from_their_seed_and_agree(tmp_path):
    cart, data = rig(tmp_path), [recording(np.random.default_rng(10), seconds=2.0)]
    seen = []
    first = fit(cart, data, FitOptions(starts=4, seed=3), seen.append)
    again = fit(cart, data, FitOptions(starts=4, seed=3))
    one = fit(cart, data)
    begins = {report.stage[:12]: report.parameters["gain"] for report in reversed(seen)}
    assert len(begins) == 4
    assert first.values == again.values
    for name in TRUTH:
        assert first.values[name] == pytest.approx(one.values[name], rel=1e-4)


def test_a_checkpoint_of_another_fit_is_not_read(tmp_path):
    data, kept = [recording(np.random.default_rng(11), seconds=2.0)], tmp_path / "kept.json"
    free = FREE.splitlines()[0]
    fit(rig(tmp_path, free, drag=2.0), data, FitOptions(checkpoint=kept))
    assert kept.is_file()
    heavier = rig(tmp_path, free, drag=4.0)
    assert fit(heavier, data, FitOptions(checkpoint=kept)).values["drag"] == 4.0
    kept.write_text('{"schema": "half a fi')
    assert fit(heavier, data, FitOptions(checkpoint=kept)).outcome is Outcome.CONVERGED


def optid_fit(folder, out, environment):
    arguments = ("fit", folder / "cart.toml", folder / "cart.csv", "--starts", "5", "--out", folder / out)
    return subprocess.Popen(
        [sys.executable, "-m", "optid.cli", *map(str, arguments)],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def fitted(folder, out):
    content = json.loads((folder / out / "fit.json").read_text())
    assert content["outcome"] == "converged"
    return {name: entry["value"] for name, entry in content["parameters"].items()}


@pytest.mark.full
@pytest.mark.skipif(os.name == "nt", reason="kill -9 is a POSIX signal")
def test_a_killed_fit_goes_on_to_the_same_answer(tmp_path, own_cache):
    rig(tmp_path)
    data = recording(np.random.default_rng(12))
    table = {"t": data.time, "u": data["command"].values, "x": data["position"].values}
    pd.DataFrame(table).to_csv(tmp_path / "cart.csv", index=False)
    environment = dict(os.environ)

    running = optid_fit(tmp_path, "out", environment)
    while not (kept := list(own_cache.glob("optid/fits/*.json"))) and running.poll() is None:
        time.sleep(0.005)
    running.send_signal(signal.SIGKILL)
    assert running.wait() == -signal.SIGKILL
    assert not list((tmp_path / "out").glob("*.json"))  # no result, whatever was tried before
    assert json.loads(kept[0].read_text())["number"] < 4

    assert optid_fit(tmp_path, "out", environment).wait() == 0
    assert not kept[0].exists()
    assert optid_fit(tmp_path, "unbroken", environment).wait() == 0
    assert fitted(tmp_path, "out") == pytest.approx(fitted(tmp_path, "unbroken"), rel=1e-6)
