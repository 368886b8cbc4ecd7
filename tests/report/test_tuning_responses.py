"""What a tuning's page draws: the plant that judged comes first, and a loop that only friction holds is not drawn."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.report import tuning_page
from optid.tuning.response_metrics import response
from optid.tuning.scenarios import step


def tuning(on_bench, stable):
    episode = step(0.05, 200, 1e-3)
    swinging = 0.05 + 0.03 * np.sin(np.arange(200) / 5.0)
    on_model, on_rig = (
        response(episode, y, np.full(200, u), 1e-3) for y, u in ((swinging, 5.0), (episode.reference, 1.0))
    )
    found = SimpleNamespace(stable=stable, responses=(on_model,), bench=(on_rig,))
    return SimpleNamespace(on_bench=on_bench, found=found, baselines=())


@pytest.mark.parametrize(
    ("on_bench", "stable", "drawn"),
    [(True, False, [True]), (True, True, [True, False]), (False, False, [False, True])],
)
def test_the_plant_that_judged_comes_first(monkeypatch, on_bench, stable, drawn):
    monkeypatch.setattr(tuning_page.figures, "responses", lambda *given: f"on the rig: {given[-1]}")
    problem = SimpleNamespace(
        bench=object(), judged_on="the identified linear model", output_unit="m", command_unit="V"
    )
    [entry] = tuning_page._episodes(tuning(on_bench, stable), problem)
    assert [picture for _, picture in entry["pictures"]] == [f"on the rig: {rig}" for rig in drawn]
    for (said, _), rig in zip(entry["pictures"], drawn, strict=True):
        assert ("the rig's physical model" in said) == rig
        assert ("overshoot 0 %" in said) == rig
