"""The studies on the paper: figures, claims, the print's missing force."""

from __future__ import annotations

import numpy as np
import pytest

from optid.armax.table2 import last_value
from studies import physical_rows
from studies.independent_rig import Rig
from studies.paper import draw_all
from studies.paper_claims import claims
from studies.print_diagnosed import PRINT, judge, missing_force
from studies.table2 import impulse_experiment


@pytest.mark.full
def test_every_figure_is_drawn_once(tmp_path):
    paths = draw_all(tmp_path, quick=True)
    assert [int(path.stem.removeprefix("figure_")) for path in paths] == [*range(1, 5), *range(6, 17)]
    assert all(path.stat().st_size > 5000 for path in paths)


@pytest.mark.full
def test_claims_are_judged_with_numbers():
    from optid.armax.plan import Plan
    from optid.armax.survey import survey

    experiment = impulse_experiment(np.random.default_rng(0), seconds=1.0)
    found = survey(experiment.y, experiment.u, 1e-3, Plan((3, 4), (1,), delay=1, horizons=False))
    said = claims(experiment.y, experiment.u, 1e-3, found)
    assert len(said) == 3
    for sentence in said:
        assert "stand" in sentence
        assert any(character.isdigit() for character in sentence)


def test_the_physical_model_predicts_ten_samples_a_tenth_as_wrong_as_the_last_value(monkeypatch):
    monkeypatch.setattr(physical_rows, "SHARES", (1e-2,))
    monkeypatch.setattr(physical_rows, "MOST_LOOKS", 1)
    experiment = impulse_experiment(np.random.default_rng(0), seconds=1.4)
    found = physical_rows.physical_entries(experiment.y, experiment.u, 1e-3)
    moving = slice(physical_rows.REST, round(0.7 * experiment.y.size))
    still = np.nanstd((experiment.y - last_value(experiment.y, 10))[moving])
    assert found["in sample"][10] < 0.1 * still
    assert found["in sample"][1] < 2.0 * 100 * physical_rows.NOISE


def test_the_force_that_the_print_leaves_out_by_hand():
    assert missing_force(Rig()) == pytest.approx(20.106, abs=5e-4)
    assert "rod_force = false" in PRINT
    force = {"effect": "constant_force", "site": "force", "equation": "11"}
    held = {
        "findings": [force | {"parameters": {"force": {"value": -20.0, "unit": "N", "ci95": [-21.0, -19.0]}}}]
    }
    assert "which holds 20.11 N" in judge(held, missing_force(Rig()))
    wide = {
        "findings": [force | {"parameters": {"force": {"value": -9.0, "unit": "N", "ci95": [-10.0, -8.0]}}}]
    }
    assert "does not hold" in judge(wide, missing_force(Rig()))
    assert "not named" in judge({"findings": []}, 20.1)
