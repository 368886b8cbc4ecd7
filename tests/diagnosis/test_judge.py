"""What a model that lacks nothing may still miss: an axis at rest does not tell the force that will set it moving."""

from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest

from optid.core.parameter import Parameter
from optid.core.recording import Channel, Recording
from optid.core.sheet import build
from optid.diagnosis.judge import EXCESS, excess, judge
from optid.estimation.likelihood import Noise

SD, SPREAD, REST = 1e-4, 0.2, 0.5  # m, of the load at a start, s before the push
DT = 1e-3


def held(s):
    """x' = push + load while that is above zero: at rest nothing tells the load."""
    x, load = s.state("x", "m", 1.0, spread=0.01), s.state("load", "m/s", 1.0, spread=SPREAD)
    push = s.input("command", "m/s")
    s.rate(x, ca.fmax(push + load, 0.0))
    s.rate(load, 0 * load)
    s.output("position", "m", x)


def recording(load, push=2.0, seconds=2.0):
    """Pulled back until REST, pushed from there on."""
    t = DT * np.arange(round(seconds / DT))
    x = np.maximum(t - REST, 0.0) * (push + load) + SD * np.random.default_rng(3).standard_normal(len(t))
    channels = {
        "command": Channel("command", "u", "m/s", np.where(t < REST - DT / 2, -2.0, push)),
        "position": Channel("position", "x", "m", x, sd=SD),
    }
    return Recording("pushed", t, channels)


def answer(process_noise):
    model = build(held)
    noise = Noise(np.array([SD**2]), ((1,),), np.log([process_noise]))
    return SimpleNamespace(question=SimpleNamespace(model=model, free=()), p=model.vector({}), noise=noise)


SINCE = np.sqrt(
    np.mean((DT * np.arange(round(0.5 / DT))) ** 2) / 3.0
)  # of three windows, the first is the push's


def test_what_the_past_cannot_tell_is_not_held_against_a_model():
    """The window of the push errs by load x time, the load not known better than SPREAD; the next ones know it."""
    judged = judge(answer(1e-4), [recording(load=0.2)])
    assert judged.imperfection["position"] == pytest.approx(SPREAD * SINCE, rel=0.01)
    assert judged.scores["position"].rmse > 100 * SD
    assert excess(judged, {"position": SD}) == pytest.approx(1.0, abs=0.1)


def test_where_it_may_not_move_at_all_both_sides_count():
    """sqrt(3) sd more load moves it so much faster; as much less only holds it."""
    judged = judge(answer(1e-4), [recording(load=0.0, push=0.1)])
    expected = np.sqrt((3.0 * SPREAD**2 + 0.1**2) / 6.0) * SINCE
    assert judged.imperfection["position"] == pytest.approx(expected, rel=0.02)


def test_what_the_past_tells_is_held_against_a_model():
    """Three times as much load as a start may have is no ignorance, nor does process noise excuse it."""
    judged = judge(answer(0.3), [recording(load=0.6)])
    assert judged.imperfection["position"] == pytest.approx(SPREAD * SINCE, rel=0.01)
    assert excess(judged, {"position": SD}) > 2.0 * EXCESS


@pytest.mark.parametrize(("leeway", "moved"), [(0.0, 0.0), (0.1, 0.1), (9.0, 1.0)])
def test_what_a_law_leaves_open_is_not_held_against_a_model(leeway, moved):
    """A window errs by the pace's leeway x time; a pace of 1 goes no further than to its double."""
    about = "a law that stands in for nature's"
    pace = Parameter("pace", "1", 1.0, "by which it follows the command", about, 1.0, leeway=leeway)

    def paced(s):
        x = s.state("x", "m", 1.0, spread=1e3 * SD)
        s.rate(x, s.param(pace) * s.input("command", "m/s"))
        s.output("position", "m", x)

    t = DT * np.arange(2000)
    channels = {
        "command": Channel("command", "u", "m/s", np.ones_like(t)),
        "position": Channel("position", "x", "m", t, sd=SD),
    }
    model, noise = build(paced), Noise(np.array([SD**2]), ((0,),), np.log([1.0]))
    asked = SimpleNamespace(question=SimpleNamespace(model=model, free=()), p=model.vector({}), noise=noise)
    seen = judge(asked, [Recording("paced", t, channels)])
    expected = moved * np.sqrt(np.mean((DT * np.arange(round(0.5 / DT))) ** 2))
    assert seen.imperfection["position"] == pytest.approx(expected, rel=0.02, abs=SD)
