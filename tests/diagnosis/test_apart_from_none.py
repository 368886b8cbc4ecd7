"""An interval agrees with the test that rules out that there is none of an effect."""

from dataclasses import replace

import pytest

from optid.diagnosis.intervals import apart_from_none
from optid.effects.library import built_in
from optid.estimation.result import Estimate

CUSHION, LEAK = built_in()["end_cushioning"], built_in()["ambient_leakage"]


def estimate(name, value, low, high):
    return Estimate(name, "1", value, low, high, 0.0, False, True)


def test_a_strength_that_trades_with_its_shape_ends_where_the_test_puts_it():
    """A cushion of a blind draw: 24.8 times narrower, 0 to 55.2 by its sd; none has p = 0.0006 (3.24 sd, one-sided)."""
    given = [estimate("mass", 1.0, 0.9, 1.1), estimate("end_cushioning.throttling", 24.8, 0.0, 55.2)]
    mass, found = apart_from_none(given, CUSHION, 6e-4, True)
    assert mass == given[0]
    assert found.low == pytest.approx(24.8 * (1 - 1.96 / 3.24), rel=0.01)
    assert (found.value, found.high) == (24.8, 55.2)


def test_a_test_that_rules_nothing_out_changes_nothing():
    given = (estimate("end_cushioning.throttling", 24.8, 0.0, 55.2),)
    assert apart_from_none(given, CUSHION, 0.2, True) == given


def test_where_one_strength_is_sure_no_other_is_touched():
    """The test is of all of them together: the second chamber may well leak nothing."""
    given = (
        estimate("ambient_leakage.area_a", 1.5e-7, 1.4e-7, 1.6e-7),
        estimate("ambient_leakage.area_b", 1e-10, 0.0, 1e-9),
    )
    assert apart_from_none(given, LEAK, 1e-6, True) == given


def test_beyond_the_noise_a_strength_must_exceed_its_own_sd():
    """The static friction demo: a ratio of 2.5, by its sd 1 to 4.9. A rise that fills its bounds is no size."""
    ratio = estimate("stribeck_friction.breakaway_ratio", 2.5, 1.0, 4.9)
    (found,) = apart_from_none([ratio], built_in()["stribeck_friction"], 1e-4, False)
    assert found.low == pytest.approx(1.0 + 1.5 * (1 - 1.96 / 3.72), rel=0.01)
    (rise,) = apart_from_none([replace(ratio, high=9.0)], built_in()["stribeck_friction"], 1e-4, False)
    assert rise.low == 1.0
    given = [
        estimate(f"position_dependent_friction.{name}", *values)
        for name, values in {"rise": (-0.5, -0.95, 10.0), "slope_ahead": (0.2, -15.0, 15.0)}.items()
    ]
    assert apart_from_none(given, built_in()["position_dependent_friction"], 1e-4, False) == tuple(given)
