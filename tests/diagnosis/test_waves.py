"""A wave describes what goes on by itself, over time with a phase in every recording, or over a position."""

import math
from dataclasses import replace

import numpy as np
import pytest

from optid.diagnosis import unexplained
from optid.diagnosis.candidate import QUIETER, Data, fit_base
from optid.diagnosis.contest import own_values
from optid.diagnosis.disturbance import locate_at
from optid.diagnosis.lead import Ground
from optid.diagnosis.line import _explained, loudest
from optid.diagnosis.unexplained import listen, look, nameless
from optid.effects.wave import KNOTS, Wave
from optid.estimation.scoring import quieted
from tests.diagnosis.describing import description
from tests.diagnosis.trolley import SD, recording, rig

ACCELERATION, HERTZ, PITCH = 0.8, 1.7, 0.31
PHASES = (0.3, 2.9, 4.4)


def swinging(seed):
    return lambda t, x, v: ACCELERATION * np.sin(2 * np.pi * HERTZ * t + PHASES[seed - 1])


def cogged(seed):
    return lambda t, x, v: ACCELERATION * np.sin(2 * np.pi * x / PITCH + 0.5)


@pytest.fixture(scope="module", params=[swinging, cogged])
def described(request, tmp_path_factory):
    runs = [recording(seed, f"run_{seed}", beside=request.param(seed)) for seed in (1, 2, 3)]
    data = Data(tuple(runs[:2]), (runs[2],), {"position": SD}, np.random.default_rng(0))
    base = fit_base(rig(tmp_path_factory.mktemp("wave")), data, lambda share, words: None)
    site = locate_at(base, data, "drag.force")
    return request.param, base, data, site, description(base, base, [site], data)


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
    assert values["size"] == pytest.approx(ACCELERATION, rel=0.3)  # so that heights are about 1
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
    best = found.rival.candidate
    repeats = best.answer.p[best.rig.model.index(f"{found.rival.effect.name}.repeats")]
    often = "time of 1.7 Hz" if law is swinging else f"position with {repeats:.3g} periods in its SI unit"
    assert f"a wave over {often} describes it, without a name" in finding.sentence


def grounded(base, data, p=None):
    guide = quieted(base.answer, QUIETER)
    return Ground.of(base.rig, guide, data, base.rig.model, guide.p if p is None else p)


def followed(base, along):
    q = base.answer.question
    return q.problem.time if along == "time" else base.answer.filtered.states[0][:, 0]


def test_a_line_tells_height_and_phase_before_any_refit(described):
    law, base, data, *_ = described
    along, repeats, fastest = ("time", HERTZ, 5.0) if law is swinging else ("position", 1.0 / PITCH, 20.0)
    line = loudest(grounded(base, data), Wave("drag.force", along), followed(base, along), fastest)
    assert line.repeats == pytest.approx(repeats, abs=0.5 / np.ptp(followed(base, along)))
    assert line.height == pytest.approx(
        ACCELERATION, rel=0.25
    )  # though phases differ from recording to recording
    if law is cogged:  # the force of drag is subtracted
        assert math.remainder(line.phase - 0.5 - math.pi, math.tau) == pytest.approx(0.0, abs=0.3)


def test_where_there_is_no_room_or_no_time_there_is_no_line(described):
    _, base, data, *_ = described
    wave, time = Wave("drag.force", "time"), followed(base, "time")
    assert loudest(grounded(base, data), wave, np.zeros_like(time), 5.0) is None
    assert loudest(grounded(base, replace(data, until=0.0)), wave, time, 5.0) is None


def test_waves_are_heard_once_no_form_has_arrived(described):
    law, base, data, site, found = described
    looked = look(base, base, [site], data, lambda words: None)
    assert not looked.arrived and not any(one.effect.name.startswith("wave@") for one in looked.led)
    said = []
    heard = listen(looked, data, said.append)
    name = found.rival.effect.name
    assert heard.led[0].effect.name == name and name in [rival.effect.name for rival in heard.rivals]
    if law is swinging:
        assert heard.arrived and heard.best.effect.name == name
        assert listen(heard, data, said.append) is heard
    assert said[0] == f"following {name}"  # to whom it is told by then
    assert listen(looked, replace(data, until=0.0), said.append) is looked


def test_what_parameters_explain_is_no_wave(tmp_path):
    runs = [recording(seed, f"run_{seed}") for seed in (1, 2, 3)]
    data = Data(tuple(runs[:2]), (runs[2],), {"position": SD}, np.random.default_rng(0))
    base = fit_base(rig(tmp_path), data, lambda share, words: None)
    wave, time = Wave("drag.force", "time"), followed(base, "time")
    right, wrong = (
        loudest(grounded(base, data, p), wave, time, 5.0).gain for p in (base.answer.p, base.answer.p * 1.05)
    )
    assert wrong < 3.0 * right


@pytest.mark.parametrize("recorded", [0, 1])
def test_what_parameters_explain_is_no_wave_in_one_recording_either(tmp_path, recorded):
    runs = [recording(seed, f"run_{seed}") for seed in (1, 2, 3)]
    data = Data(tuple(runs[:2]), (runs[2],), {"position": SD}, np.random.default_rng(0))
    base = fit_base(rig(tmp_path), data, lambda share, words: None)
    wave, some = Wave("drag.force", "time"), np.arange(0.2, 5.0, 0.2)
    right, wrong = (
        max(_explained(grounded(base, data, p), wave, some, [recorded])).gain
        for p in (base.answer.p, base.answer.p * 1.05)
    )
    assert wrong < 3.0 * right


def test_a_wave_may_come_from_another_site_of_the_kind(described, monkeypatch):
    _, base, data, site, found = described
    monkeypatch.setattr(unexplained, "SOURCES", {"sensor": "drag.force"})
    there = description(base, base, [replace(site, sites=("sensor.position",))], data)
    assert there.rival.effect.name == found.rival.effect.name
    assert there.located.sites == ("drag.force",)
    assert there.located.signal == pytest.approx(site.signal)
    finding = nameless(base, [replace(site, sites=("sensor.position",))], there, data)
    assert finding.place == "drag.force"
    assert "an unknown signal at sensor.position explains" in finding.sentence
    assert "describes it at drag.force, without a name" in finding.sentence


def test_a_wave_that_only_speed_brings_about_has_heights_over_it(tmp_path):
    """Nothing below 0.3 m/s, then more with every bit of speed."""

    def beside(t, x, v):
        return 6.0 * max(abs(v) - 0.3, 0.0) * np.sin(2 * np.pi * x / PITCH)

    runs = [recording(seed, f"run_{seed}", beside=beside) for seed in (1, 2, 3)]
    data = Data(tuple(runs[:2]), (runs[2],), {"position": SD}, np.random.default_rng(0))
    base = fit_base(rig(tmp_path), data, lambda share, words: None)
    found = description(base, base, [locate_at(base, data, "drag.force")], data)
    wave, best = found.rival.effect, found.rival.candidate
    assert wave.name == "wave@drag.force@position*velocity"
    before, after = (one.judged.scores["position"].rmse for one in (base, best))
    assert after < 0.1 * before
    own = own_values(wave, best.rig, best.answer)
    heights = own["size"] * np.array([own[f"height_{k + 1}"] for k in range(len(KNOTS))])
    speeds = own["magnitude"] * np.array(KNOTS)
    moving = speeds < 0.8  # what is faster hardly occurs
    # drag is subtracted, and half a turn of the phase turns the sign
    assert np.abs(heights[moving]) == pytest.approx(6.0 * np.maximum(speeds[moving] - 0.3, 0.0), abs=0.25)
