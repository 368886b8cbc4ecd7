"""Diagnoses of a user's own plant against a closed form: named when it is there, silent when nothing is missing."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from optid.diagnosis import diagnosis as diagnosis_of
from optid.diagnosis import search as search_of
from optid.diagnosis.candidate import refitted
from optid.diagnosis.contest import Contest
from optid.diagnosis.diagnosis import diagnose
from optid.diagnosis.finding import Verdict
from optid.diagnosis.judge import EXCESS, excess, missed
from optid.diagnosis.refit import refit
from optid.diagnosis.search import Search, in_time
from optid.diagnosis.uncertainty import estimates
from optid.diagnosis.words import summary
from optid.effects.library import admitted, built_in
from optid.errors import InputError
from optid.report.diagnosis_document import diagnosis_document
from optid.report.diagnosis_page import diagnosis_page
from optid.rigs.rigfile import read_rig, with_effects
from tests.diagnosis.trolley import TRUTH, recording, rig

WIDTH = 0.2


def dead_band(u):
    return np.sign(u) * np.maximum(np.abs(u) - WIDTH, 0.0)


def asked(folder, concealed=lambda u: u, **how):
    train = [recording(seed, f"run{seed}.csv", concealed) for seed in (1, 2)]
    held = [recording(3, "held.csv", concealed)]
    return diagnose(rig(folder), train, held, generator=np.random.default_rng(0), **how)


@pytest.fixture(scope="module")
def dead(tmp_path_factory):
    return asked(tmp_path_factory.mktemp("dead"), dead_band)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return asked(tmp_path_factory.mktemp("sound"))


def test_nothing_missing_nothing_named(sound):
    assert sound.verdict is Verdict.CONSISTENT
    assert sound.findings == ()
    assert sound.best.judged.scores["position"].rmse < 1.1 * sound.noise["position"]
    for estimate in sound.best_parameters:
        assert estimate.low < TRUTH[estimate.name] < estimate.high


def test_without_a_beginning_that_misleads_the_base_is_fitted_again(tmp_path, monkeypatch):
    def later(base, data):
        assert len(base.answer.question.problem.time) == 2 * 1200
        return replace(data, train=tuple(one.slice(2.0) for one in data.train), late=("run1.csv",))

    monkeypatch.setattr(diagnosis_of, "begun", later)
    found = asked(tmp_path)
    assert len(found.base.answer.question.problem.time) == 2 * 1000
    assert "Of run1.csv the beginning does not count" in found.summary
    assert "the beginning does not count" not in summary(replace(found, data=replace(found.data, late=())))


def looking(seen, arrived=False):
    """Stands in for a look at what may describe a mismatch."""

    def look(base, current, sites, data, tell):
        seen(current, sites)
        return SimpleNamespace(sites=sites, arrived=arrived)

    return look


def test_what_a_search_that_was_ended_leaves_is_described_while_there_is_time(tmp_path, monkeypatch):
    asked_for = []
    monkeypatch.setattr(diagnosis_of, "SEARCHED", 0.0)
    monkeypatch.setattr(diagnosis_of, "OWN", 0.0)
    monkeypatch.setattr(diagnosis_of, "look", looking(lambda current, sites: asked_for.append(sites[0].site)))
    monkeypatch.setattr(diagnosis_of, "listen", lambda looked, data, tell: looked)
    monkeypatch.setattr(diagnosis_of, "describe", lambda looked, data: None)
    found = asked(tmp_path, dead_band, time_limit=1e6)
    assert found.verdict is Verdict.UNEXPLAINED and found.search.stopped
    assert len(asked_for) == 1


def test_a_search_whose_time_is_over_says_so_and_names_nothing(tmp_path, dead, monkeypatch):
    def dear(*_, **__):
        raise AssertionError("there is no time left for it")

    monkeypatch.setattr(diagnosis_of, "look", dear)
    monkeypatch.setattr(search_of, "refit", dear)
    found = asked(tmp_path, dead_band, time_limit=1e-9)
    assert found.verdict is Verdict.UNEXPLAINED and found.search.stopped
    assert found.findings[0].effect is None and found.findings[0].site
    assert not any(one.rivals for one in found.search.rounds)
    assert "The search was ended before everything was tried" in found.summary
    assert not dead.search.stopped and "ended" not in dead.summary


@pytest.mark.parametrize("little", [True, False])
def test_what_describes_comes_to_names_only_where_these_explain_much(tmp_path, monkeypatch, little):
    seen = []

    def searched(base, own, data, report, aside):
        wrong = next(e for e in admitted(base.rig.model) if e.name == "saturation@drive.command")
        return Search(base, refitted(base.rig, (wrong,), base, data, base.rig.model), ())

    monkeypatch.setattr(diagnosis_of, "search", searched)
    monkeypatch.setattr(diagnosis_of, "explains_little", lambda *_: little)
    monkeypatch.setattr(diagnosis_of, "look", looking(lambda current, _: seen.append(current.effects)))
    monkeypatch.setattr(diagnosis_of, "listen", lambda looked, data, tell: looked)
    monkeypatch.setattr(diagnosis_of, "describe", lambda looked, data: None)
    found = asked(tmp_path, dead_band)
    assert found.verdict is Verdict.UNEXPLAINED
    assert [[effect.name for effect in one] for one in seen] == (
        [[]] if little else [[], ["saturation@drive.command"]]
    )


def test_what_was_looked_at_beside_the_search_is_not_looked_for_again(tmp_path, monkeypatch):
    seen, located, described = [], [], []
    locate = diagnosis_of.locate

    def searched(base, own, data, report, aside):
        aside()
        assert len(seen) == len(located) == 1
        return Search(base, base, ())

    monkeypatch.setattr(diagnosis_of, "search", searched)
    monkeypatch.setattr(diagnosis_of, "locate", lambda *given: located.append(given) or locate(*given))
    monkeypatch.setattr(diagnosis_of, "look", looking(lambda current, _: seen.append(current.effects), True))
    monkeypatch.setattr(diagnosis_of, "listen", lambda looked, data, tell: looked)
    monkeypatch.setattr(diagnosis_of, "describe", lambda looked, data: described.append(looked.arrived))
    found = asked(tmp_path, dead_band)
    assert found.verdict is Verdict.UNEXPLAINED
    assert (len(seen), len(located), described) == (1, 1, [True])


@pytest.mark.parametrize(
    ("shares", "arrived", "told"),
    [
        ({"named": 0.2, "aside": 0.9}, False, "aside"),
        ({"named": 0.6, "aside": 0.5, "beside": 0.9}, False, "beside"),
        ({"named": 0.6, "aside": 0.7, "beside": 0.9}, True, "aside"),  # nobody looks any further
        ({"named": 0.6, "aside": 0.5, "beside": 0.4}, False, None),  # the names clear more
        ({"named": 0.6}, False, None),
    ],
)
def test_of_what_describes_a_mismatch_the_best_is_told_unless_names_clear_more(
    shares, arrived, told, monkeypatch
):
    monkeypatch.setattr(diagnosis_of, "cleared", lambda base, judged, noise: shares[judged])
    monkeypatch.setattr(diagnosis_of, "explains_little", lambda base, named, data: shares["named"] < 0.5)
    monkeypatch.setattr(
        diagnosis_of,
        "look",
        lambda *_: SimpleNamespace(arrived=False, found="beside" if len(shares) == 3 else None),
    )

    def describing(looked, data):
        candidate = SimpleNamespace(judged=looked.found)
        return SimpleNamespace(rival=SimpleNamespace(candidate=candidate)) if looked.found else None

    monkeypatch.setattr(diagnosis_of, "listen", lambda looked, data, tell: looked)
    monkeypatch.setattr(diagnosis_of, "describe", describing)
    base, named = SimpleNamespace(judged="base"), SimpleNamespace(judged="named")
    looked = [SimpleNamespace(arrived=arrived, found="aside" if len(shares) > 1 else None)]
    data = SimpleNamespace(noise={}, over=False)
    found = diagnosis_of._described(base, named, [], looked, data, lambda words: None)
    assert (found and found.rival.candidate.judged) == told


@pytest.mark.parametrize(("base_takes", "ends"), [(10.0, 85.0), (60.0, 100.0)])
def test_the_time_limit_counts_from_the_start_but_leaves_the_search_its_own(
    tmp_path, monkeypatch, base_takes, ends
):
    clock = iter((0.0, base_takes))
    monkeypatch.setattr(diagnosis_of, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    until = []

    def searched(base, own, data, report, aside):
        until.append(data.until)
        return Search(base, base, ())

    monkeypatch.setattr(diagnosis_of, "search", searched)
    found = asked(tmp_path, dead_band, time_limit=100.0)
    assert until == [pytest.approx(ends)]
    assert found.data.until == math.inf  # to locate and to tell takes its time


def test_when_the_time_is_over_nobody_is_tried_any_more(dead):
    few = dead.search.rounds[0].screened[:1]
    at = Contest(dead.base, dead.base, dead.base.answer, 1, dead.data, lambda words: None)
    assert [rival.effect for rival in refit(at, few)] == [few[0].effect]
    assert refit(replace(at, data=replace(dead.data, until=0.0)), few) == []


def test_who_wins_before_its_rivals_had_their_turn_must_leave_them_nothing(dead):
    data = dead.data
    winner = dead.search.rounds[0].winner
    assert winner is not None and not winner.why
    assert in_time(winner, data) is winner  # its windows are at the noise
    short = replace(winner, candidate=dead.base)
    assert "the time was over" in in_time(short, data).why
    lost = replace(short, why="no gain")
    assert in_time(lost, data) is lost


def test_bounds_that_shut_the_truth_out_are_no_missing_physics(tmp_path):
    narrow = rig(tmp_path)
    shut = {"gain": (0.1, 2.5), "drag": (0.01, 50.0)}
    freed = tuple(replace(f, low=shut[f.name][0], high=shut[f.name][1]) for f in narrow.freed)
    train, held = [recording(1, "run.csv")], [recording(2, "held.csv")]
    found = diagnose(replace(narrow, freed=freed), train, held, generator=np.random.default_rng(0))
    assert found.verdict is Verdict.PARAMETERS
    assert found.findings == ()
    assert {e.name: e.value for e in found.best_parameters} == pytest.approx(TRUTH, rel=0.01)
    assert found.base.judged.scores["position"].rmse > 3.0 * found.best.judged.scores["position"].rmse
    assert "gain" in found.summary
    assert diagnosis_document(found)["verdict"] == "parameters"
    assert "<html" in diagnosis_page(found)


def test_a_dead_band_is_named_sized_and_proven(dead):
    assert dead.verdict is Verdict.MISSING_PHYSICS
    first = dead.findings[0]
    assert first.effect.name == "dead_zone@drive.command"
    assert first.site == "drive.command"  # an own plant speaks in its own sites
    width = {e.name: e for e in first.parameters}["width"]
    assert width.value == pytest.approx(WIDTH, rel=0.1)
    assert first.evidence.p_value < 0.01
    before, after = dead.base.judged.scores["position"].rmse, dead.best.judged.scores["position"].rmse
    assert after < 1.2 * dead.noise["position"] < before


def test_the_unknown_signal_goes_where_the_law_says(dead):
    (finding,) = dead.findings
    assert finding.signal is not None
    assert finding.law.shape == finding.signal.signal.shape
    # Where the command is beyond the band the law takes its width away from it, to the side of the command.
    u = np.concatenate([recording["command"].values for recording in dead.data.train])
    driven = np.abs(u) > 2 * WIDTH
    assert np.abs(finding.law[driven] + WIDTH * np.sign(u[driven])).max() < 0.1 * WIDTH
    assert finding.signal.site == finding.place
    assert finding.signal.gain > 20.0  # chi-squared with one degree of freedom: once in 100 000


def test_the_document_holds_what_the_contract_asks(dead):
    document = diagnosis_document(dead)
    assert document["verdict"] == "missing-physics"
    keys = {"effect", "site", "equation", "parameters", "where", "evidence", "indistinguishable_from"}
    assert keys <= set(document["findings"][0])
    assert {"channels", "intervals", "states"} <= set(document["findings"][0]["where"])
    assert {"holdout_fit_gain", "p_value", "delta_bic"} <= set(document["findings"][0]["evidence"])
    assert document["baseline"]["holdout"]["position"]["unit"] == "m"
    assert "dead zone" in document["summary"].lower()


def test_the_page_stands_alone(dead):
    page = diagnosis_page(dead)
    assert page.count('<div class="figure"') >= 3
    assert 'src="http' not in page and 'href="http' not in page
    assert "dead zone" in page.lower()


def test_without_a_hold_out_there_is_no_proof(tmp_path):
    with pytest.raises(InputError, match="held out"):
        diagnose(rig(tmp_path), [recording(1, "a.csv")], [], generator=np.random.default_rng(0))


@pytest.mark.parametrize(("misses", "ratio"), [(0.9, 1.0), (1.19, 1.0), (6.0, 6.0)])
def test_intervals_widen_by_what_a_model_misses_beyond_the_noise(misses, ratio, monkeypatch):
    monkeypatch.setattr("optid.diagnosis.judge.excess", lambda judged, noise: misses)
    assert missed(None, {}) == ratio


def test_the_intervals_of_a_model_that_lacks_something_are_wider_than_its_likelihood_has_them(dead):
    """The base model without the dead zone misses by several times the noise; so do its intervals."""
    times = dead.base.judged.scores["position"].rmse / dead.noise["position"]
    own = estimates(dead.base.answer, ())
    assert times > 3.0
    for wide, narrow in zip(dead.base_parameters, own, strict=True):
        assert wide.value == narrow.value
        assert wide.high - wide.low > 1.5 * (narrow.high - narrow.low) or wide.at_bound


def test_where_three_recordings_disagree_intervals_are_no_narrower_even_at_the_noise(
    tmp_path, dead, monkeypatch
):
    """Of two the spread has one degree of freedom: it says too little."""
    monkeypatch.setattr(diagnosis_of, "disagreement", lambda answer: answer.question.typical)
    runs = [recording(seed, f"run{seed}.csv", dead_band) for seed in (1, 2, 3, 4)]
    three = diagnose(rig(tmp_path), runs[:3], runs[3:], generator=np.random.default_rng(0))
    assert excess(three.best.judged, three.noise) <= EXCESS
    assert [finding.effect.name for finding in three.findings] == [dead.findings[0].effect.name]
    for found, wide in ((three, True), (dead, False)):
        gain = next(one for one in found.best_parameters if one.name == "gain")
        assert ((gain.high - gain.low) > 1.0) is wide


def test_where_windows_ask_for_other_parameters_intervals_reach_as_far_as_those_of_the_likeliest(
    tmp_path, monkeypatch
):
    runs = [recording(seed, f"run{seed}.csv", dead_band) for seed in (1, 2, 3, 4)]
    monkeypatch.setattr(diagnosis_of, "disagreement", lambda answer: 0.5 * answer.question.typical)
    monkeypatch.setattr(
        diagnosis_of, "foreseen", lambda found, data: (found, 0.25 * found.answer.question.typical)
    )
    told = diagnose(rig(tmp_path), runs[:3], runs[3:], generator=np.random.default_rng(0))
    gain = next(one for one in told.best_parameters if one.name == "gain")
    question = told.best.answer.question
    k = question.free.index(question.model.index("gain"))
    assert gain.high - gain.value == pytest.approx(0.75 * question.typical[k])


def test_the_evidence_for_a_name_is_that_of_the_likeliest_model(tmp_path, dead, monkeypatch):
    """Windows may ask for parameters that likelihood abhors, which is no doubt of the name."""

    def elsewhere(found, data):
        judged, answer, none = found.judged, found.answer, np.zeros(len(found.answer.question.free))
        scores = {role: replace(one, fit_percent=12.0) for role, one in judged.scores.items()}
        judged = replace(judged, deviance=judged.deviance + 1e3, windows=judged.windows + 1.0, scores=scores)
        return replace(found, judged=judged, answer=replace(answer, score=answer.score + 1e6)), none

    monkeypatch.setattr(diagnosis_of, "foreseen", elsewhere)
    (one,), (other,) = asked(tmp_path, dead_band).findings, dead.findings
    assert one.evidence.p_value == pytest.approx(other.evidence.p_value, abs=0.005)
    assert one.evidence.gain == pytest.approx(other.evidence.gain)
    assert (one.train_gain, one.delta_bic) == pytest.approx((other.train_gain, other.delta_bic))
    # The fit is that of the model handed out.
    assert one.evidence.fit_gain == pytest.approx(12.0 - dead.base.judged.scores["position"].fit_percent)


@pytest.mark.parametrize(
    ("leave", "share", "verdict"),
    [
        (0.06, 0.95, Verdict.MISSING_PHYSICS), (0.06, 0.93, Verdict.UNEXPLAINED),
        (None, 0.93, Verdict.MISSING_PHYSICS), (None, 0.2, Verdict.UNEXPLAINED),
    ],
)  # fmt: skip
def test_names_that_leave_more_than_right_ones_do_are_no_answer(leave, share, verdict, monkeypatch):
    """Where a blind trial has measured what right names leave, that decides; elsewhere a quarter is asked."""
    rig = SimpleNamespace(model=SimpleNamespace(laws_leave=leave))
    base = SimpleNamespace(effects=(), judged="base", rig=rig)
    best = SimpleNamespace(effects=(SimpleNamespace(name="lag"),), judged="best")
    for name, value in (("excess", 9.0), ("cleared", share), ("locate", ["here"])):
        monkeypatch.setattr(diagnosis_of, name, lambda *others, value=value: value)
    monkeypatch.setattr(search_of, "cleared", lambda *others: share)
    data = SimpleNamespace(noise={}, generator=None)
    found = diagnosis_of._verdict(SimpleNamespace(base=base, best=best), data, lambda share, words: None)
    assert found[0] is verdict
    assert found[1] is (best if verdict is Verdict.MISSING_PHYSICS else base)
    assert bool(found[2]) is (verdict is Verdict.UNEXPLAINED)
    if verdict is Verdict.UNEXPLAINED:
        assert found[3].effects == ("lag",)
        assert str(found[3]).startswith(f"clears {100 * share:.0f} %")


def test_what_is_far_below_any_size_worth_a_name_is_told_in_words():
    leak = built_in()["ambient_leakage"]
    grown = with_effects(read_rig(Path(__file__).parents[2] / "data/bench.toml"), [leak])
    areas = {"ambient_leakage.area_a": 1.5e-7, "ambient_leakage.area_b": 7.4e-14}
    best = SimpleNamespace(
        rig=grown, answer=SimpleNamespace(p=grown.model.vector({**grown.parameters, **areas}))
    )
    said = diagnosis_of._says(leak, best)
    assert "chamber A through 0.15 mm2, from chamber B through next to nothing" in said


@pytest.mark.parametrize(("p_value", "told"), [(0.016, True), (0.001, False)])
def test_the_summary_tells_what_shows_in_few_windows(dead, p_value, told):
    findings = tuple(replace(f, evidence=replace(f.evidence, p_value=p_value)) for f in dead.findings)
    assert ("it shows in few windows of the hold-out" in summary(replace(dead, findings=findings))) is told
