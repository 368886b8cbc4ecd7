"""A wave describes what goes on by itself, over time with a phase in every recording, or over a position."""

import numpy as np
import pytest

from optid.diagnose.candidate import Data, fit_base
from optid.diagnose.disturbance import locate_at
from optid.diagnose.unexplained import describe, nameless
from tests.diagnose.trolley import SD, recording, rig

ACCELERATION, HERTZ, PITCH = 0.8, 1.7, 0.31
PHASES = (0.3, 2.9, 4.4)


def swinging(seed):
    return lambda t, x: ACCELERATION * np.sin(2 * np.pi * HERTZ * t + PHASES[seed - 1])


def cogged(seed):
    return lambda t, x: ACCELERATION * np.sin(2 * np.pi * x / PITCH + 0.5)


@pytest.fixture(scope="module", params=[swinging, cogged])
def described(request, tmp_path_factory):
    runs = [recording(seed, f"run_{seed}", beside=request.param(seed)) for seed in (1, 2, 3)]
    data = Data(tuple(runs[:2]), (runs[2],), {"position": SD}, np.random.default_rng(0))
    base = fit_base(rig(tmp_path_factory.mktemp("wave")), data, lambda share, words: None)
    site = locate_at(base, data, "drag.force")
    return request.param, base, data, site, describe(base, site, data, lambda words: None)


def test_the_wave_is_the_law(described):
    law, base, _, _, found = described
    along, repeats = ("time", HERTZ) if law is swinging else ("position", 1.0 / PITCH)
    assert found.rival.effect.name == f"wave@drag.force@{along}"
    best = found.rival.candidate
    before, after = (one.judged.scores["position"].rmse for one in (base, best))
    assert after < 0.3 * before
    values = {
        q.name.rpartition(".")[2]: v for q, v in zip(best.rig.model.parameters, best.answer.p, strict=True)
    }
    assert values["repeats"] == pytest.approx(repeats, rel=3e-3)
    if law is cogged:
        assert abs(values["size"] * values["height"]) == pytest.approx(ACCELERATION, rel=0.05)
        return
    names = [state.name for state in best.rig.model.states]
    owner = np.repeat(best.answer.question.problem.recording, best.answer.question.problem.counts + 1)
    for number in (0, 1):  # what the filter knows at the end of a recording
        last = best.answer.filtered.states[0][owner == number][-1]
        own = np.exp(1j * values["phase"]) + complex(
            *(last[names.index(f"wave@drag.force@time.{one}")] for one in ("sine", "cosine"))
        )
        # the force of drag is subtracted
        turned = -values["size"] * values["height"] * own / np.exp(1j * PHASES[number])
        assert turned == pytest.approx(ACCELERATION, rel=0.1)


def test_a_finding_tells_of_it_and_stays_without_a_name(described):
    law, base, data, site, found = described
    finding = nameless(base, [site], found, data)
    assert finding.effect is None and finding.evidence is found.rival.against
    along = "time" if law is swinging else "position"
    assert f"a wave over {along} describes it, without a name" in finding.sentence
