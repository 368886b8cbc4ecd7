"""The signal that is missing at a site: in engineering units, with its interval."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from optid.core.sheet import build
from optid.report.diagnosis_figures import missing_signal
from optid.rigs import BUILT_IN, find_plant

TIME = 0.01 * np.arange(200)
FRAME = pd.DataFrame(
    {"recording": "a.csv", "time": TIME, "missing": 2e-3 * np.sin(TIME), "missing_sd": np.full(200, 1e-4)}
)


@pytest.mark.parametrize(
    ("unit", "label", "factor"),
    [
        ("m", "missing at here (mm)", 1e3),
        ("kg/s", "missing at here (g/s)", 1e3),
        ("m**3/s", "missing at here (L/min)", 6e4),
        ("N", "missing at here (N)", 1.0),
        ("1", "missing at here", 1.0),
        ("", "missing at here (SI unit of the signal)", 1.0),
    ],
)
def test_it_is_drawn_in_the_unit_of_the_site_with_its_interval(unit, label, factor):
    axes = missing_signal(FRAME, "here", unit, None, {}).axes[0]
    assert axes.get_ylabel() == label
    drawn = next(line for line in axes.lines if line.get_label() == "estimated without a law")
    np.testing.assert_allclose(drawn.get_ydata(), factor * FRAME["missing"])
    band = np.asarray(axes.collections[0].get_paths()[0].vertices)
    at = np.isclose(band[:, 0], TIME[100])
    middle, half = factor * FRAME["missing"][100], factor * 1.96e-4
    assert sorted(set(band[at, 1])) == pytest.approx([middle - half, middle + half])


@pytest.mark.parametrize("name", list(BUILT_IN))
def test_every_site_of_the_plants_that_come_along_has_a_unit(name):
    model = build(find_plant(name, Path()))
    assert {site: unit for site, unit in zip(model.sites, model.site_units, strict=True) if not unit} == {}
