"""A name is told only if its interval, the test and every output agree."""

import numpy as np
import pytest

from optid.diagnosis.agreement import disagreement
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.evaluation import Evaluation
from optid.diagnosis.testing import Evidence
from optid.effects.generic.power_law import PowerLaw
from optid.effects.library import built_in
from optid.estimation.result import Estimate, Score

NOISE = {"position": 1e-5, "pressure_a": 500.0}
EFFECT = built_in()["valve_deadband"]
STRENGTH = next(iter(EFFECT.strength))
NULL = EFFECT.at_null()[STRENGTH]


def estimate(low, high):
    return Estimate(STRENGTH, "1", (low + high) / 2, low, high, NULL, False, True)


def evaluation(**times_noise):
    """Windows that err by so many times the noise, by output."""
    rows = 400
    rng = np.random.default_rng(0)
    measured = np.zeros((rows, 2))
    errors = np.column_stack([times_noise[role] * NOISE[role] * rng.standard_normal(rows) for role in NOISE])
    scores = {role: Score.of(measured[:, j], errors[:, j], "m") for j, role in enumerate(NOISE)}
    blocks, zero = np.arange(rows) // 20, np.zeros((rows, 2))
    time = np.arange(rows) / 1e3
    return Evaluation(0.5, blocks, errors, zero, measured, time, blocks * 0, scores, zero)


def told(low=NULL + 0.02, high=NULL + 0.03, evidence=None, before=None, after=None, effect=EFFECT, own=None):
    return disagreement(
        effect,
        [own or estimate(low, high)],
        evidence or Evidence(1e-5, 3.0, 0.5),
        before or evaluation(position=40.0, pressure_a=3.0),
        after or evaluation(position=1.0, pressure_a=1.0),
        NOISE,
        Criteria(),
    )


def test_a_name_for_which_everything_speaks_is_told():
    assert told() == ""


@pytest.mark.parametrize("p", [0.02, float("nan")])
def test_the_hold_out_must_confirm_it(p):
    assert "does not confirm" in told(evidence=Evidence(p, 3.0, 0.5))


def test_an_output_must_gain():
    assert "no output" in told(evidence=Evidence(1e-5, 0.0, 0.0))


def test_its_interval_must_exclude_that_there_is_none_of_it():
    assert "includes an effect of no size" in told(low=NULL, high=NULL + 0.03)
    assert "includes an effect of no size" in told(low=NULL - 0.01, high=NULL + 0.03)


@pytest.mark.parametrize(
    ("effect", "name", "value", "why"),
    [
        (
            PowerLaw("drive.speed", 1.0),
            "exponent",
            0.2,
            "its exponent lies at an end of the plausible range, at 0.2",
        ),
        (PowerLaw("drive.speed", 1.0), "exponent", 0.3, ""),
        (built_in()["valve_saturation"], "loss", 1.0, ""),  # of a share this end is meant
    ],
)
def test_a_size_at_an_end_of_its_range_is_not_told(effect, name, value, why):
    own = Estimate(name, "1", value, value - 0.01, value + 0.01, 0.5, value in (0.2, 1.0), True)
    assert told(effect=effect, own=own) == why


def test_no_output_may_be_predicted_worse_than_before():
    """A description that halves one output's error and doubles another's is no answer."""
    assert "pressure a is predicted worse" in told(after=evaluation(position=1.0, pressure_a=6.0))
    assert told(after=evaluation(position=1.0, pressure_a=2.9)) == ""


def test_an_output_at_the_noise_is_not_worse():
    assert told(before=evaluation(position=40.0, pressure_a=0.9)) == ""
