"""The coverage study: its table counts right, and a repeat of it runs from rig to interval."""

import numpy as np
import pandas as pd
import pytest

from studies.interval_coverage import OWN, TRUTH, coverage, repeat


def test_the_table_of_exact_intervals_says_so():
    rng = np.random.default_rng(1)
    n, rows = 4000, []
    for name, truth in TRUTH.items():
        sd = 1e-3 * truth
        value = truth + sd * rng.standard_normal(n)
        low, high = value - 1.96 * sd, value + 1.96 * sd
        held = (low <= truth) & (truth <= high)
        row = {"parameter": name, "truth": truth, "value": value, "low": low, "high": high, "held": held}
        rows.append(pd.DataFrame(row))
    table = coverage(pd.concat(rows))
    assert table["coverage"].to_numpy() == pytest.approx(95.0, abs=1.2)
    assert table["z_mean"].to_numpy() == pytest.approx(0.0, abs=0.06)
    assert table["z_sd"].to_numpy() == pytest.approx(1.0, abs=0.05)
    assert table.loc["viscous_friction", "half_width"] == pytest.approx(0.196)  # percent of the truth


@pytest.mark.parametrize(("colour", "seconds"), [(0.0, 2.0), (0.8, 4.0)])  # coloured noise says less a second
def test_a_repeat_finds_the_rig(colour, seconds):
    rows = pd.DataFrame(repeat(0, seconds=seconds, colour=colour))
    assert set(rows["parameter"]) == set(TRUTH)
    assert (rows["outcome"] == "CONVERGED").all()
    half = (rows["high"] - rows["low"]) / 2
    error = (rows["value"] - rows["parameter"].map(TRUTH)).abs()
    assert (error < 3 * half).all()
    assert (half < 0.1 * rows["value"]).all()


@pytest.mark.parametrize("plant", ["rotary-axis", "servo-hydraulic"])
def test_other_axes_are_found_within_two_percent(plant):
    rows = pd.DataFrame(repeat(3, seconds=2.0, plant=plant, seed=11))
    assert set(rows["parameter"]) == set(OWN[plant])
    assert (rows["outcome"] == "CONVERGED").all()
    error = (rows["value"] - rows["truth"]).abs()
    assert (error < 0.02 * rows["truth"]).all()
    assert (error < 1.5 * (rows["high"] - rows["low"])).all()
