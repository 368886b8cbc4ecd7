"""Where effects lead from afar, by windows: past a fit that is bent, from values that are far off, on the trolley."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from optid.core import threads
from optid.diagnosis import afar
from optid.diagnosis import refit as refit_of
from optid.diagnosis.afar import BRANCHES, RACE, calm, from_afar
from optid.diagnosis.candidate import QUIETER, refitted
from optid.diagnosis.judge import EXCESS, excess, judge
from optid.diagnosis.lead import Lead
from optid.diagnosis.screen import grown
from optid.effects.library import admitted
from optid.errors import SolveError
from optid.estimation.multistep import windows
from optid.estimation.place import Place
from optid.estimation.scoring import middling, quieted
from optid.estimation.steering import Steered, steered_fit
from tests.diagnosis import trolley
from tests.diagnosis.trolley import TRUTH


@pytest.fixture(scope="module")
def worn(tmp_path_factory):
    return trolley.worn(tmp_path_factory.mktemp("trolley"))


@pytest.fixture(scope="module")
def first(worn):
    base, guide, data = worn
    return from_afar(base, guide, admitted(base.rig.model), data, base.rig.model)[0]


def test_the_effect_at_work_leads_farthest_and_to_the_truth(worn):
    base, guide, data = worn
    plain = base.rig.model
    bent = base.answer.p[plain.index("gain")]
    assert abs(bent / TRUTH["gain"] - 1.0) > 0.1
    found = from_afar(base, guide, admitted(plain), data, plain)
    assert found[0].effect.name == "saturation@drive.command"
    assert found[0].values["limit"] == pytest.approx(0.4, rel=0.02)
    assert {name: found[0].beside[name] for name in TRUTH} == pytest.approx(TRUTH, rel=0.02)
    gains = [one.gain for one in found]
    assert gains == sorted(gains, reverse=True)
    assert gains[0] > 0.9 * np.isfinite(guide.filtered.innovations[0]).sum()


def test_effects_lead_to_the_same_on_any_number_of_cores(worn, monkeypatch):
    base, guide, data = worn
    found = []
    for cores in (1, 2):
        monkeypatch.setattr(threads, "WORKERS", cores)
        found.append(from_afar(base, guide, admitted(base.rig.model), data, base.rig.model))
    assert [(one.effect.name, one.values, one.gain, one.beside) for one in found[0]] == [
        (one.effect.name, one.values, one.gain, one.beside) for one in found[1]
    ]


def test_a_refit_begins_where_its_effect_led(worn, first):
    base, guide, data = worn
    contest = refit_of.Contest(base, base, guide, 30, data, lambda words: None)
    found = refit_of._attempt(contest, first, again=False).answer
    assert found.score < base.answer.score - 500.0
    model = found.question.model
    limit = model.index("saturation@drive.command.limit")
    assert found.p[limit] == pytest.approx(0.4, rel=0.01)
    lost = {**first.beside, **first.effect.qualified(first.values)} | {"gain": 3.6, "drag": 1.0}
    assert refit_of._from_afar(contest, found.question, lost).p[limit] == pytest.approx(0.4, rel=0.05)


@pytest.mark.parametrize(("again", "score", "longer"), [(True, 5.0, 1), (True, -5.0, 0), (False, 5.0, 0)])
def test_the_best_lead_is_refitted_until_it_stands(worn, first, again, score, longer, monkeypatch):
    base, guide, data = worn
    there = SimpleNamespace(p=None, noise=SimpleNamespace(levels=None), score=base.answer.score + score)
    calls = []

    def maximise(question, p, levels, **others):
        calls.append(others)
        return "stood"

    monkeypatch.setattr(refit_of, "_from_afar", lambda *others: there)
    monkeypatch.setattr(refit_of, "maximise", maximise)
    contest = refit_of.Contest(base, base, guide, 30, data, lambda words: None)
    found = refit_of._attempt(contest, first, again)
    assert (found.answer == "stood", len(calls)) == (bool(longer), longer)


def test_a_refit_that_likelihood_leads_astray_stays_where_windows_led(worn, monkeypatch):
    """A score that is better and windows that miss far more: that is process noise, not the law."""
    base, guide, data = worn
    contest = refit_of.Contest(base, base, guide, 30, data, lambda words: None)
    led, likely = (SimpleNamespace(score=base.answer.score - by) for by in (10.0, 90.0))
    missed = {id(led): 100.0, id(likely): 190.0}
    monkeypatch.setattr("optid.estimation.multistep.misses", lambda answer, seconds: missed[id(answer)])
    assert refit_of._chosen(contest, likely, led) is likely
    missed[id(likely)] = 210.0
    assert refit_of._chosen(contest, likely, led) is led
    led.score = base.answer.score + 1.0  # worse than without it: that names nothing
    assert refit_of._chosen(contest, likely, led) is likely


@pytest.mark.parametrize("far", ["stated", "fitted"])
def test_effects_begin_from_both_starts_and_one_may_be_far_off(worn, far):
    """A gain of 40 where 3 is right, held there: nothing gains from it, be it the file's or the fit's."""
    base, guide, data = worn
    plain, starts = base.rig.model, set()

    def held(question, p, *others, **named):
        gain = p[question.model.index("gain")]
        starts.add(gain > 30.0)
        return Steered(p, 1e9) if gain > 30.0 else steered_fit(question, p, *others, **named)

    if far == "stated":
        base = replace(base, rig=replace(base.rig, parameters={**base.rig.parameters, "gain": 40.0}))
    else:
        p = guide.p.copy()
        p[plain.index("gain")] = 40.0
        guide = replace(guide, p=p)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("optid.diagnosis.lead.steered_fit", held)
        patch.setattr("optid.diagnosis.afar.steered_fit", held)
        found = from_afar(base, guide, admitted(plain), data, plain)
    assert starts == {True, False}
    assert found[0].effect.name == "saturation@drive.command"
    assert found[0].beside["gain"] == pytest.approx(TRUTH["gain"], rel=0.02)


def test_beside_another_effect_leads_begin_where_both_belong(worn):
    base, _, data = worn
    plain = base.rig.model
    found = next(e for e in admitted(plain) if e.name == "hysteresis@drive.command")
    beside = refitted(base.rig, (found,), base, data, plain)
    guide = quieted(beside.answer, QUIETER)
    led = from_afar(beside, guide, admitted(beside.rig.model), data, plain)
    assert led[0].effect.name == "saturation@drive.command"
    assert f"{found.name}.width" in led[0].beside


def test_the_legs_of_a_race_run_over_one_recording_and_then_over_all(worn, monkeypatch):
    base, guide, data = worn
    ran = []

    def watched(question, p, plain, held, evaluations, over=None, looks=None):
        ran.append((evaluations, over is not None, int(looks.sum())))
        return steered_fit(question, p, plain, held, evaluations, over, looks)

    monkeypatch.setattr("optid.diagnosis.lead.steered_fit", watched)
    from_afar(base, guide, admitted(base.rig.model), data, base.rig.model)
    (begun, *_), *_ = RACE
    assert {over for count, over, _ in ran if count == begun} == {True}
    assert {over for count, over, _ in ran if count != begun} == {False}
    short, whole = (
        int(windows(guide.question.problem, share * base.judged.horizon).sum()) for share in (afar.SHORT, 1.0)
    )
    assert {looks for *_, looks in ran} == {short, whole}
    assert ran[-1][2] == whole


@pytest.mark.parametrize(
    ("losses", "arrives", "kept", "brought"),
    [
        ([9.0, 5.0], 9.0, 9.0, 1),  # at the noise already
        ([9.0, 5.0, 4.0, 1.0], 4.0, 4.0, 3),
        ([9.0, 8.8, 8.7, 1.0], 0.0, 8.7, 3),  # two in a row miss hardly less
        ([9.0, 9.5, 6.0, 7.0, 3.0, 4.0, 2.0, 1.0], 0.0, 2.0, 7),
    ],
)
def test_other_branches_are_brought_on_while_that_leads_anywhere(losses, arrives, kept, brought, monkeypatch):
    ended = iter(losses)
    monkeypatch.setattr(
        afar, "_brought", lambda lead, *others: replace(lead, at=Steered(lead.at.p, next(ended)))
    )
    monkeypatch.setattr(afar, "_arrived", lambda lead, data: lead.at.loss <= arrives)
    lead = Lead(SimpleNamespace(), SimpleNamespace(), (), Steered(np.zeros(1), 1.0))
    best = afar._best(lead, [lead] * BRANCHES, None, None, SimpleNamespace(over=False))
    assert best.at.loss == kept
    assert list(ended) == losses[brought:]


def test_a_lead_arrives_where_its_windows_held_out_are_at_the_noise(worn, first):
    base, guide, data = worn
    question = data.question(grown(base.rig, first.effect), base.rig.model)
    p = question.at({**first.beside, **first.effect.qualified(first.values)})
    names = tuple(first.beside)
    assert afar._arrived(Lead(first.effect, question, names, Steered(p, 1.0)), data)
    assert not afar._arrived(Lead(first.effect, guide.question, names, Steered(guide.p, 1.0)), data)
    here = Place(guide.question, guide.p, calm(guide.question))
    here.glance()
    assert excess(judge(here.answer(False), data.holdout), data.noise) > EXCESS


def test_filters_of_a_race_are_calm_and_weigh_by_the_measurement_alone(worn):
    base, guide, _ = worn
    q = guide.question
    assert calm(q).levels == pytest.approx(middling(q) - afar.CALM)
    P = np.array([guide.p, base.rig.model.vector(base.rig.parameters)])
    for p in P:
        held, own = afar._filter(q, p), Place(q, p, calm(q)).filtered
        assert held.gains == pytest.approx(own.gains)
        assert held.innovations == pytest.approx(own.innovations, nan_ok=True)
        assert (held.variances == q.measurement).all()


def test_a_lead_that_leaves_the_numbers_falls_behind(worn, first, monkeypatch):
    base, guide, data = worn
    plain = base.rig.model

    def lost(question, *others, **named):
        if any(q.name.startswith("saturation@drive.command") for q in question.model.parameters):
            raise SolveError("the simulation leaves the numbers")
        return steered_fit(question, *others, **named)

    monkeypatch.setattr("optid.diagnosis.lead.steered_fit", lost)
    names = [one.effect.name for one in from_afar(base, guide, admitted(plain), data, plain)]
    assert first.effect.name not in names


def test_nothing_leads_when_the_time_is_over(worn):
    base, guide, data = worn
    plain = base.rig.model
    assert from_afar(base, guide, admitted(plain), replace(data, until=0.0), plain) == []


def test_what_resembles_an_unknown_signal_leads_as_well(worn, first, monkeypatch):
    base, guide, data = worn
    plain = base.rig.model
    question = data.question(grown(base.rig, first.effect), plain)
    p = question.at({**first.beside, **first.effect.qualified(first.values)})
    asked = []
    there = [(first.effect, question, p)]
    monkeypatch.setattr(afar, "resembling", lambda *args: asked.append(args) or there)
    (found,) = from_afar(base, guide, [], data, plain)
    assert found.effect is first.effect and found.values["limit"] == pytest.approx(0.4, rel=0.02)
    assert asked == [(base, [], data, plain, None)]  # every sensor's signal is estimated
    from_afar(base, guide, [], data, plain, near={})
    assert asked[1][-1] == {}
