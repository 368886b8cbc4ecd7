"""A fit that nothing should be built on is a loud failure; one that leaves more than the noise says what to do."""

import json
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner

from optid import cli
from optid.estimation.result import Estimate, Fit, Outcome
from optid.report.scores import misses

AXIS = """
from optid.core.parameter import Parameter
GAIN = Parameter("gain", "m/(s V)", 0.1, "a gain", "none", bounds=(0.0, 10.0))
LEAK = Parameter("leak", "1/s", 1.0, "a leak", "none", bounds=(0.0, 100.0))
def axis(s):
    s.require("the leak is slower than 20 1/s", 20.0 - s.param(LEAK))
    x = s.state("x", "m", 0.1)
    s.rate(x, s.param(GAIN) * s.input("u", "V") - s.param(LEAK) * x)
    s.output("position", "m", s.site("sensor.position", x))
"""
RIG = """
model = "axis.py:axis"
[parameters]
gain = "0.15 m/(s V)"
leak = "2 1/s"
[fit]
gain = {{ bounds = ["{low} m/(s V)", "{high} m/(s V)"] }}
{more}
[channels]
time = {{ column = "t", unit = "s" }}
u = {{ column = "u", unit = "V" }}
position = {{ column = "x", unit = "m" }}
"""


def record(path, gain, leak, bend=0.0):
    """An axis whose leak may grow with its deflection, integrated finely; 0.1 mm of noise."""
    rng = np.random.default_rng(1)
    t = np.arange(1500) * 2e-3
    u = np.sign(np.sin(7.0 * t)) + 0.5 * np.sin(3.0 * t)
    x, at = np.zeros(len(t)), 0.0
    for k in range(len(t)):
        x[k] = at
        for _ in range(20):
            at += 1e-4 * (gain * u[k] - leak * at - bend * at * abs(at))
    np.savetxt(
        path,
        np.column_stack([t, u, x + 1e-4 * rng.normal(size=len(t))]),
        delimiter=",",
        header="t,u,x",
        comments="",
    )


def fitted(folder, low, high, more="", held=None, **truth):
    (folder / "axis.py").write_text(AXIS)
    (folder / "rig.toml").write_text(RIG.format(low=low, high=high, more=more))
    record(folder / "run.csv", **truth)
    call = ["fit", folder / "rig.toml", folder / "run.csv", "--out", folder / "out", "--no-resume"]
    call += ["--holdout", held] if held else []
    result = CliRunner().invoke(cli.cli, [str(word) for word in call], prog_name="optid")
    assert (folder / "out" / "fit.json").exists(), result.output
    return result, json.loads((folder / "out" / "fit.json").read_text())


def test_everything_at_its_bounds_is_a_failure_with_one_sided_intervals(tmp_path):
    result, document = fitted(tmp_path, 0.1, 0.2, gain=0.3, leak=2.0)
    assert result.exit_code == 1
    assert "every fitted parameter lies at a bound" in result.stderr
    assert document["outcome"] == "at_bounds"
    assert document["at_bound"] == ["gain"]
    low, high = document["parameters"]["gain"]["ci95"]
    assert high is None
    assert 0.1 <= low < 0.2


def test_a_right_model_says_nothing_and_one_that_lacks_something_what_to_do(tmp_path):
    for name, bend in (("right", 0.0), ("bent", 20.0)):
        (tmp_path / name).mkdir()
        result, document = fitted(tmp_path / name, 0.01, 1.0, gain=0.3, leak=2.0, bend=bend)
        assert result.exit_code == 0, result.output
        low, high = document["parameters"]["gain"]["ci95"]
        assert low < document["parameters"]["gain"]["value"] < high
        assert ("run `optid diagnose`" in result.stdout) == bool(bend)
        assert bool(document["missed"]) == bool(bend)


def test_what_was_held_out_and_fits_nothing_is_a_failure_too(tmp_path):
    """The axis held out has the other sign: the training says nothing of it."""
    held = tmp_path / "held.csv"
    record(held, gain=-0.3, leak=2.0)
    result, document = fitted(tmp_path, 0.01, 1.0, held=held, gain=0.3, leak=2.0)
    assert document["outcome"] == "converged"
    assert document["missed"] == []
    assert result.exit_code == 1
    assert "held out, it predicts worse than the mean of the measurement" in result.stderr
    record(held, gain=0.31, leak=2.0)
    result, document = fitted(tmp_path, 0.01, 1.0, held=held, gain=0.3, leak=2.0)
    assert result.exit_code == 0, result.output
    assert "held out, the model misses" in result.stdout


def test_values_that_contradict_each_other_are_kept_and_called_a_failure(tmp_path):
    free = 'leak = { bounds = ["0.1 1/s", "90 1/s"] }'
    result, document = fitted(tmp_path, 0.01, 9.0, more=free, gain=3.0, leak=40.0)
    assert result.exit_code == 1
    assert document["outcome"] == "contradiction"
    assert document["parameters"]["leak"]["value"] == pytest.approx(40.0, rel=0.1)
    assert (tmp_path / "out" / "rig.toml").exists()


def estimate(name, at_bound):
    return Estimate(name, "1", 1.0, 0.0, 2.0, 1.0, at_bound, True)


def made(*bounds):
    estimates = tuple(estimate(name, at_bound) for name, at_bound in bounds)
    return Fit(
        Outcome.CONVERGED, estimates, {}, np.zeros((0, 0)), {}, np.zeros(0), np.zeros(0), (), None, 0.0
    )


@pytest.mark.parametrize(
    ("fit", "percents", "sound", "outcome"),
    [
        (made(("a", False), ("b", True)), [90.0, None], True, Outcome.CONVERGED),
        (made(("a", False)), [90.0, -0.1], True, Outcome.BELOW_MEAN),
        (made(("a", True), ("helper", False)), [90.0], True, Outcome.AT_BOUNDS),
        (made(("a", False), ("helper", True)), [90.0], True, Outcome.CONVERGED),
        (made(("a", False)), [90.0], False, Outcome.CONTRADICTION),
    ],
)
def test_the_outcome_is_corrected_by_what_the_fit_is_good_for(fit, percents, sound, outcome):
    judged = fit.judged(["a", "b"], percents, sound)
    assert judged.outcome is outcome
    assert judged.outcome.failed == (outcome is not Outcome.CONVERGED)


@pytest.mark.parametrize(
    ("percent", "rmse", "sd", "missed"),
    [
        (87.0, 5e-3, None, True),
        (87.0, 5e-3, 4e-3, False),
        (99.5, 5e-3, None, False),
        (None, 5e-3, None, False),
    ],
)
def test_only_what_is_far_above_the_noise_is_missed(percent, rmse, sd, missed):
    score = SimpleNamespace(fit_percent=np.nan if percent is None else percent, rmse=rmse, unit="m")
    prediction = SimpleNamespace(scores={"window": {"position": score}})
    noise = 1e-4 * np.random.default_rng(0).normal(size=2000)
    found = misses([prediction], [{"position": SimpleNamespace(values=noise, sd=sd)}])
    assert bool(found) == missed
    if missed:
        assert found[0].sentence.startswith("the model misses 13 %: run `optid diagnose` (position: 5 mm rms")
