"""Where effects lead from a fit under held gains, on the trolley."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.diagnosis.candidate import QUIETER, refitted
from optid.diagnosis.lead import RACE, Ground, ahead, leads, stood, worst
from optid.effects.curve import Curve
from optid.effects.library import admitted
from optid.errors import SolveError
from optid.estimation.likelihood import FAR
from optid.estimation.scoring import quieted
from optid.estimation.steering import Steered, innovations, steered_fit
from tests.diagnosis import trolley
from tests.diagnosis.trolley import TRUTH


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    return trolley.worn(tmp_path_factory.mktemp("trolley"))


def test_the_effect_at_work_leads_farthest_and_to_the_truth(worn):
    base, guide, data = worn
    plain = base.rig.model
    bent = base.answer.p[plain.index("gain")]
    assert abs(bent / TRUTH["gain"] - 1.0) > 0.1
    found = leads(base, guide, admitted(plain), data, plain)
    assert found[0].effect.name == "saturation@drive.command"
    assert found[0].values["limit"] == pytest.approx(0.4, rel=0.02)
    assert {name: found[0].beside[name] for name in TRUTH} == pytest.approx(TRUTH, rel=0.02)
    gains = [one.gain for one in found]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > 0.9 * np.isfinite(guide.filtered.innovations[0]).sum()


def test_what_begins_at_its_null_is_told_apart_by_what_its_ways_would_explain(worn, monkeypatch):
    base, guide, data = worn
    ground = Ground.of(base.rig, guide, data, base.rig.model, guide.p)

    def begun(along):
        form = Curve("drive.command", along, low=-1.0, high=1.0, size=0.3)
        (lead,) = ground.begun(form)
        own = lead.signature(0.0).values
        assert {name: own[name] for name in form.strength} == dict.fromkeys(form.strength, 0.0)
        return lead.at.loss

    right, wrong = begun("command"), begun("position")
    assert right < 0.5 * wrong
    monkeypatch.setattr(Curve, "ways", ())
    assert begun("command") == pytest.approx(begun("position")) and begun("command") > wrong


def test_a_lead_stands_with_the_guides_process_noise(worn):
    base, guide, data = worn
    plain = base.rig.model
    first = leads(base, guide, admitted(plain), data, plain)[0]
    there = stood(base, first, guide, data, plain)
    model = there.question.model
    assert there.noise.levels == pytest.approx(guide.noise.levels)
    assert there.p[model.index("saturation@drive.command.limit")] == first.values["limit"]
    assert there.p[model.index("gain")] == first.beside["gain"]
    assert there.score < guide.score


def test_the_loss_of_a_search_is_hubers_and_what_it_ended_with(worn):
    base, guide, _ = worn
    q, filtered = guide.question, guide.filtered
    found = steered_fit(q, q.model.vector(base.rig.parameters), q.model, filtered, 15)
    z = np.abs(innovations(q, found.p[None], q.model, filtered)[0])
    prior = (found.p[list(q.free)] - q.prior) / q.prior_sd
    rho = np.where(z > FAR, FAR * (2.0 * z - FAR), z**2).sum() + np.sum(prior**2)
    assert found.loss == pytest.approx(rho / 2.0, rel=1e-6)


def test_the_first_leg_runs_over_all_of_the_recording_that_lacks_most():
    """By Huber's loss: one sample far off weighs little beside many that are off by some sd."""
    problem = SimpleNamespace(recording=np.array([0, 1, 1, 2]), counts=np.array([9, 4, 4, 9]))
    E = np.zeros((1, 30, 1))
    E[0, 3], E[0, 10:20], E[0, 25] = 30.0, 8.0, np.nan
    guide = SimpleNamespace(
        question=SimpleNamespace(problem=problem),
        filtered=SimpleNamespace(innovations=E, variances=np.full(E.shape, 4.0)),
    )
    assert worst(guide) == [1, 2]
    E[0, 3] = 500.0
    assert worst(guide) == [0]


def test_the_legs_of_a_race_run_over_one_recording_and_then_over_all(worn, monkeypatch):
    base, guide, data = worn
    ran = []

    def watched(*given):
        ran.append((given[4], given[5] if len(given) > 5 else None))
        return steered_fit(*given)

    monkeypatch.setattr("optid.diagnosis.lead.steered_fit", watched)
    leads(base, guide, admitted(base.rig.model), data, base.rig.model)
    first, *_ = RACE
    assert {over is not None for count, over in ran if count == first[0]} == {True}
    assert {over is not None for count, over in ran if count != first[0]} == {False}


def test_innovations_of_one_segment_are_those_of_all_there(worn):
    base, guide, _ = worn
    q, P = guide.question, base.answer.p[None]
    whole = innovations(q, P, q.model, guide.filtered)[0]
    first, second = (innovations(q, P, q.model, guide.filtered, [k])[0] for k in (0, 1))
    assert np.array_equal(np.concatenate([first, second]), whole)
    assert len(first) == q.problem.counts[0] + 1


def test_a_race_takes_few_of_one_effect_and_the_best_of_all():
    lag, drag = object(), object()
    running = [
        SimpleNamespace(effect=effect, at=Steered(np.zeros(1), loss))
        for effect, loss in ((lag, 1.0), (drag, 9.0), (lag, 2.0), (drag, 5.0), (lag, 3.0))
    ]
    assert [one.at.loss for one in ahead(running, 3, 2)] == [1.0, 2.0, 5.0]
    assert [one.at.loss for one in ahead(running, 9, 1)] == [1.0, 5.0]


def test_a_lead_that_leaves_the_numbers_falls_behind(worn, monkeypatch):
    base, guide, data = worn
    plain = base.rig.model
    best = leads(base, guide, admitted(plain), data, plain)[0]

    def lost(question, *others):
        if any(q.name.startswith("saturation@drive.command") for q in question.model.parameters):
            raise SolveError("the simulation leaves the numbers")
        return steered_fit(question, *others)

    monkeypatch.setattr("optid.diagnosis.lead.steered_fit", lost)
    assert best.effect.name not in [
        one.effect.name for one in leads(base, guide, admitted(plain), data, plain)
    ]


def test_effects_lead_on_beside_one_with_states_of_its_own(worn):
    base, _, data = worn
    plain = base.rig.model
    found = next(e for e in admitted(plain) if e.name == "hysteresis@drive.command")
    beside = refitted(base.rig, (found,), base, data, plain)
    assert len(beside.rig.model.states) > len(plain.states)
    guide = quieted(beside.answer, QUIETER)
    ahead = leads(beside, guide, admitted(beside.rig.model), data, plain)
    assert ahead[0].effect.name == "saturation@drive.command"
    assert f"{found.name}.width" in ahead[0].beside


def test_a_step_costs_slopes_and_one_vector_of_dampings(worn, monkeypatch):
    """Start, slopes and what they lead to: no simulation of what is known, and no slopes that no step follows."""
    base, guide, _ = worn
    q, sets = guide.question, []

    def counted(question, P, *others):
        sets.append(len(P))
        return innovations(question, P, *others)

    monkeypatch.setattr("optid.estimation.steering.innovations", counted)
    found = steered_fit(q, q.model.vector(base.rig.parameters), q.model, guide.filtered, 3)
    free = len(q.free)
    assert sets == [1, free, 4, free, 4, free, 4]
    assert found.loss < steered_fit(q, q.model.vector(base.rig.parameters), q.model, guide.filtered, 2).loss


def test_a_step_that_would_reach_too_far_is_damped_and_gains(worn, monkeypatch):
    """Arctangents, from whose flanks a whole Gauss-Newton step overshoots to where they miss more."""
    _, guide, _ = worn
    q = guide.question
    free = list(q.free)
    target = q.at(TRUTH)[free] / q.typical

    def flanked(question, P, *others):
        return np.repeat(np.arctan(4.0 * (P[:, free] / q.typical - target)), 50, axis=1)

    monkeypatch.setattr("optid.estimation.steering.innovations", flanked)
    far = q.at({name: 1.8 * value for name, value in TRUTH.items()})
    start, damped = (steered_fit(q, far, q.model, guide.filtered, steps) for steps in (0, 1))
    assert damped.loss < 0.6 * start.loss
    assert steered_fit(q, far, q.model, guide.filtered, 10).p[free] / q.typical == pytest.approx(
        target, abs=1e-3
    )
    monkeypatch.setattr("optid.estimation.steering.DAMPINGS", (1e-4,) * 4)
    monkeypatch.setattr("optid.estimation.steering.TRIALS", 1)
    assert steered_fit(q, far, q.model, guide.filtered, 1).loss == start.loss


def test_what_the_recordings_hardly_show_stays_where_it_is(worn, monkeypatch):
    """Rows that the second parameter hardly moves: a step by its own curvature alone would lead to its bound."""
    _, guide, _ = worn
    q = guide.question
    free = list(q.free)
    start = q.at({name: 1.2 * value for name, value in TRUTH.items()})
    origin = start[free] / q.typical

    def faint(question, P, *others):
        x = P[:, free] / q.typical - origin
        far = np.tanh(x[:, 1:]) * 1e-4  # what a large step of it promises it does not keep
        return np.repeat(np.concatenate([x[:, :1] - 0.1, far - 5e-4], axis=1), 40, axis=1)

    monkeypatch.setattr("optid.estimation.steering.innovations", faint)
    held = steered_fit(q, start, q.model, guide.filtered, 1).p[free] / q.typical - origin
    assert held[0] == pytest.approx(0.1, abs=0.01) and abs(held[1]) < 0.5
    monkeypatch.setattr("optid.estimation.steering.FLOOR", 0.0)
    loose = steered_fit(q, start, q.model, guide.filtered, 1).p[free] / q.typical - origin
    assert abs(loose[1]) > 1.0
