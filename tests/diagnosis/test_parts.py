"""The parts of a diagnosis: comparison by blocks, residual tests, ranges of signals, words."""

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from optid.core.recording import Channel, Recording
from optid.diagnosis import candidate as candidate_of
from optid.diagnosis import contest as contest_of
from optid.diagnosis import diagnosis as diagnosis_of
from optid.diagnosis import refit as refit_of
from optid.diagnosis import search as search_of
from optid.diagnosis import settling
from optid.diagnosis.candidate import Candidate, Data, fit_base
from optid.diagnosis.contest import FORM, Rival
from optid.diagnosis.disturbance import places
from optid.diagnosis.judge import Comparison, Judged, beyond_noise, cleared, compare, excess
from optid.diagnosis.law import law_at
from optid.diagnosis.residuals import _portmanteau
from optid.diagnosis.screen import screen
from optid.diagnosis.uncertainty import disagreement, estimates, resolution
from optid.diagnosis.words import quantity
from optid.effects.library import admitted, built_in
from optid.errors import SolveError
from optid.estimation.result import Score
from optid.rigs.rigfile import read_rig, with_effects
from tests.diagnosis.trolley import recording, rig


def judged(deviance, rmse):
    n = len(deviance)
    blocks = np.arange(n) // 50
    nothing = np.zeros((n, 1))
    return Judged(
        0.5, deviance, blocks, nothing + rmse, nothing, nothing, np.arange(n) / 100, np.zeros(n, dtype=int),
        {"position": Score(90.0, rmse, "m")}, lambda: {"position": np.zeros(n)},
    )  # fmt: skip


def test_a_gain_in_every_block_is_significant_and_one_in_a_single_block_is_not():
    rng = np.random.default_rng(0)
    before = rng.normal(size=4000) ** 2
    everywhere = judged(before - 0.3 + 0.1 * rng.normal(size=4000), 0.5)
    once = before.copy()
    once[100:150] -= 100.0
    assert compare(judged(before, 1.0), everywhere, rng).p_value < 0.001
    assert compare(judged(before, 1.0), judged(once, 1.0), rng).p_value > 0.05
    assert compare(judged(before, 1.0), everywhere, rng).error_gain == pytest.approx(0.5)


def test_without_a_gain_the_p_value_is_even():
    rng = np.random.default_rng(1)
    base = rng.normal(size=5000) ** 2
    found = [
        compare(judged(base, 1.0), judged(base + 0.2 * rng.normal(size=5000), 1.0), rng).p_value
        for _ in range(120)
    ]
    assert 0.02 < np.mean(np.array(found) < 0.1) < 0.2  # expected 0.1


def test_portmanteau_of_white_noise_has_as_much_as_lags():
    rng = np.random.default_rng(2)
    values = [_portmanteau(z, z) for z in rng.normal(size=(200, 2000))]
    assert np.mean(values) == pytest.approx(20.0, abs=1.5)
    coloured = np.convolve(rng.normal(size=2000), [1.0, 0.8])
    assert _portmanteau(coloured, coloured) > 200


def test_three_lucky_blocks_do_not_outweigh_the_many_that_got_worse():
    before = np.ones(2000)
    after = before + 0.02  # 40 blocks of 50 samples: worse by 1 each
    after[:150] -= 2.0  # but three, better by 100
    assert compare(judged(before, 1.0), judged(after, 1.0), np.random.default_rng(0)).p_value > 0.5


def test_one_block_that_went_astray_does_not_veto_the_many_that_got_better():
    per_block = np.array([1.5, 1.0, 1.2, 0.2, 1.2, -114.0, 2.5, 2.6, 2.6, 3.0, 2.1, 3.0, -0.1, 3.7, 2.5, 3.6])
    better = judged(np.repeat(-per_block, 50), 1.0)
    assert compare(judged(np.zeros(800), 1.0), better, np.random.default_rng(0)).p_value < 0.01


def test_windows_that_err_less_count_where_the_likelihood_is_lost():
    rng = np.random.default_rng(0)
    before, after = (judged(np.zeros(800), 1.0) for _ in range(2))
    off = rng.normal(size=(800, 1))
    before, closer = (
        replace(before, windows=off),
        replace(after, windows=0.5 * off, deviance=np.full(800, 0.1)),
    )
    assert compare(before, closer, rng).p_value < 0.002


def test_windows_that_err_alike_say_nothing():
    rng = np.random.default_rng(0)
    pairs = [
        [replace(judged(np.zeros(800), 1.0), windows=rng.normal(size=(800, 1))) for _ in range(2)]
        for _ in range(60)
    ]
    assert sum(compare(*pair, rng).p_value < 0.1 for pair in pairs) < 12  # expected at most 6


def test_what_a_model_clears_is_counted_in_the_channel_that_erred_most():
    before, half, none = (judged(np.zeros(100), rmse) for rmse in (5.0, 3.0, 5.0))
    assert cleared(before, half, {"position": 1.0}) == pytest.approx((25.0 - 9.0) / 24.0)
    assert cleared(before, none, {"position": 1.0}) == 0.0
    assert cleared(before, judged(np.zeros(100), 0.5), {"position": 1.0}) == 1.0
    assert cleared(judged(np.zeros(100), 1.0), none, {"position": 1.0}) == 1.0  # nothing erred


def test_what_an_imperfection_may_explain_is_beyond_the_noise_all_the_same():
    vague, after, noise = judged(np.zeros(100), 5.0), judged(np.zeros(100), 3.0), {"position": 1.0}
    vague = replace(vague, find_open=lambda: {"position": np.full(100, 5.0)})
    assert excess(vague, noise) == pytest.approx(5.0 / np.hypot(1.0, 5.0))
    assert beyond_noise(vague, noise)
    assert cleared(vague, after, noise) == 1.0
    assert cleared(vague, after, noise, imperfect=False) == pytest.approx((25.0 - 9.0) / 24.0)
    assert not beyond_noise(judged(np.zeros(100), 1.1), noise)
    assert not beyond_noise(vague, {})  # nobody knows the noise


def test_a_window_counts_by_what_its_own_past_leaves_open():
    """Of 16 windows one may miss by 20 sd of the noise, and does by 30; the others err by the noise, or by 3 of it."""
    n, first = 800, np.arange(800) < 50
    left = {"position": np.where(first, 20.0, 0.0)}

    def model(others):
        windows = np.where(first, 30.0, others)[:, None]
        return replace(judged(np.zeros(n), 1.0), windows=windows, find_open=lambda: left)

    one = 30.0**2 / (1.0 + 20.0**2)
    assert excess(model(1.0), {"position": 1.0}) == pytest.approx(np.sqrt((one + 15.0) / 16.0))
    assert excess(model(3.0), {"position": 1.0}) == pytest.approx(np.sqrt((one + 15.0 * 9.0) / 16.0))
    assert model(1.0).imperfection["position"] == pytest.approx(20.0 / 4.0)


def test_quantities_are_said_in_units_people_use():
    assert quantity(0.0123, "m") == "12.3 mm"
    assert quantity(3e-5, "m") == "30 um"
    assert (quantity(-2.21, "m/s"), quantity(0.999, "m/s")) == ("-2.21 m/s", "999 mm/s")
    assert quantity(0.9996, "m") == "1 m"
    assert quantity(2.5e5, "Pa") == "2.5 bar"
    assert quantity(0.004, "s") == "4 ms"
    assert quantity(12.0, "s") == "12 s"


def test_coloured_noise_is_told_by_the_recording_that_rests(tmp_path):
    rng, sd, share = np.random.default_rng(3), 3e-5, 0.8
    time = np.arange(8000) / 1000
    made = []
    for name, motion in (
        ("rests", 0.02 * np.clip(np.sin(time), 0.9, 1.0)),
        ("moves", 0.05 * np.sin(60 * time)),
    ):
        noise = lfilter([np.sqrt(1 - share**2)], [1, -share], sd * rng.standard_normal(len(time)))
        channels = {"position": Channel("position", "x", "m", motion + noise)}
        made.append(Recording(name, time, channels))
    plain = rig(tmp_path)
    plain = replace(plain, channels={role: replace(c, sd=None) for role, c in plain.channels.items()})
    alone, both = (diagnosis_of._noise(plain, some)["position"] for some in (made[1:], made))
    assert alone < 0.8 * sd
    assert both == pytest.approx(sd, rel=0.15)


@pytest.mark.parametrize(("score", "kept"), [(-200.0, True), (50.0, False), (None, False)])
def test_a_base_fit_is_tried_again_from_no_skew(score, kept, monkeypatch):
    model = read_rig(Path(__file__).parents[2] / "data" / "bench.toml").model
    skew = model.index("sampling_skew")
    p = np.zeros(len(model.parameters))
    p[skew] = -3e-4
    found = SimpleNamespace(
        question=SimpleNamespace(model=model, free=(0, skew)),
        p=p,
        score=0.0,
        noise=SimpleNamespace(levels=np.zeros(2)),
    )

    def maximise(question, p, levels, **others):
        assert p[skew] == 0.0 and (levels < 0.0).all()
        if score is None:
            raise SolveError("the simulation leaves the numbers")
        return SimpleNamespace(score=score)

    monkeypatch.setattr(candidate_of, "maximise", maximise)
    assert (candidate_of._quietly_unskewed(found) is not found) == kept
    assert p[skew] == -3e-4
    found.question.free = (0,)  # the rig file states it, or the plant has none
    assert candidate_of._quietly_unskewed(found) is found


def test_a_delay_is_known_to_half_a_sample_at_best():
    delayed = with_effects(
        read_rig(Path(__file__).parents[2] / "data" / "bench.toml"), (built_in()["input_delay"],), {}
    )
    names = [parameter.name for parameter in delayed.model.parameters]
    free = (names.index("viscous_friction"), names.index("input_delay.delay"))
    question = SimpleNamespace(model=delayed.model, free=free, problem=SimpleNamespace(dt=np.full(9, 2e-3)))
    least = resolution(
        Candidate((built_in()["input_delay"],), delayed, SimpleNamespace(question=question), None)
    )
    assert least.tolist() == [0.0, 1e-3]


def test_a_candidate_that_leaves_the_numbers_drops_out(tmp_path, monkeypatch):
    train = [recording(seed, f"run{seed}.csv", lambda u: u) for seed in (1, 2)]
    data = Data(tuple(train), tuple(train), {}, np.random.default_rng(0))
    base = fit_base(rig(tmp_path), data, lambda share, words: None)
    signatures = screen(base.answer, data.train, admitted(base.rig.model))[:2]
    bold = [replace(one, gain=1e6, values=one.effect.usual[0]) for one in signatures]
    whole = refit_of._attempt

    def attempt(contest, signature, again):
        if signature is bold[0]:
            raise SolveError("the simulation leaves the numbers")
        return whole(contest, signature, again)

    monkeypatch.setattr(refit_of, "_attempt", attempt)
    contest = refit_of.Contest(base, base, base.answer, len(bold), data, lambda words: None)
    rivals = refit_of.refit(contest, bold)
    assert [rival.effect.name for rival in rivals] == [bold[1].effect.name]
    better = replace(rivals[0], train_gain=rivals[0].train_gain + 1.0)
    for other, kept in ((better, better), (replace(better, train_gain=-1e9), rivals[0])):
        (found,) = refit_of.refit(contest, bold, [other])  # of an effect that both have, the likelier
        assert found.train_gain == pytest.approx(kept.train_gain)


def test_a_site_that_equations_pass_several_times_has_no_one_signal():
    bench = Candidate((), read_rig(Path(__file__).parents[2] / "data" / "bench.toml"), None, None)
    assert law_at(bench, bench, "flow.ratio") is None


def searched(names, confirmed, share, monkeypatch):
    """A search in which each model has the one rival that `names` gives it; `confirmed` are held to help."""
    rig = SimpleNamespace(model=SimpleNamespace(laws_leave=0.2))

    def rivals(contest, few, before=()):
        name = names.get(tuple(contest.current.effects))
        if name is None:
            return []
        candidate = Candidate((*contest.current.effects, name), rig, None, None)
        why = "" if name in confirmed else "no gain on the recordings held out"
        return [Rival(name, candidate, 100.0, None, why, hopeful=True)]

    monkeypatch.setattr(search_of, "refit", rivals)
    monkeypatch.setattr(search_of, "_thinned", lambda base, current, *others: (current, {}, ()))
    monkeypatch.setattr(search_of, "_exchanged", lambda *others: None)
    monkeypatch.setattr(search_of, "excess", lambda judged, noise: 9.0)
    monkeypatch.setattr(search_of, "rigidly", lambda current, data: (current, data))
    monkeypatch.setattr(search_of, "cleared", lambda *others: share)
    for name in ("screen", "admitted", "quieted", "_promising"):
        monkeypatch.setattr(search_of, name, lambda *others: [SimpleNamespace(name="any")])
    monkeypatch.setattr(search_of, "from_afar", lambda *others: [])
    data = Data((), (), {}, np.random.default_rng(0))
    return search_of.search(Candidate((), rig, None, None), (), data, lambda share, words: None)


@pytest.mark.parametrize("second", [True, False])
def test_an_unconfirmed_step_counts_only_if_the_next_is_confirmed(second, monkeypatch):
    """Of two effects that are both missing neither may help before the other is there."""
    found = searched({(): "one", ("one",): "two"}, ["two"] if second else [], 0.5, monkeypatch)
    assert found.best.effects == (("one", "two") if second else ())
    assert [one.winner is not None for one in found.rounds][:2] == [False, second]


@pytest.mark.parametrize(("share", "count"), [(0.41, 3), (0.39, 2)])
def test_a_last_effect_that_would_have_to_be_the_largest_is_not_looked_for(share, count, monkeypatch):
    """Names must clear 0.8 here: half of that before the last one, as the largest come first."""
    names = {(): "one", ("one",): "two", ("one", "two"): "three"}
    found = searched(names, ["one", "two", "three"], share, monkeypatch)
    assert len(found.best.effects) == count


def two_named(monkeypatch, again=-60.0, size=2.0, error_gain=0.5):
    """What is left of an offset (-50 alone) and a delay (-1000 with it) that are tried without each other.

    Without the delay the refit ends `again`.
    """
    offset, delay = (
        SimpleNamespace(name=name, fitted=(1,), size=lambda values: size) for name in ("offset", "delay")
    )

    def model(effects, score):
        return Candidate(effects, SimpleNamespace(), SimpleNamespace(score=score, p=None), None)

    base, before, both = model((), 0.0), model((offset,), -50.0), model((offset, delay), -1000.0)
    proof = Comparison(1.0, 1.0, 0.001, 0.0, error_gain)
    monkeypatch.setattr(
        search_of, "refitted",
        lambda rig, effects, *others: model(effects, again if effects == (offset,) else -60.0),
    )  # fmt: skip
    monkeypatch.setattr(
        search_of, "settled", lambda effects, rig, p, answer, *others: model(effects, answer.score)
    )
    monkeypatch.setattr(contest_of, "excess", lambda judged, noise: 1.1)
    monkeypatch.setattr(contest_of, "cleared", lambda *others, **how: 1.0)
    monkeypatch.setattr(contest_of, "brought_to_noise", lambda *others: False)
    monkeypatch.setattr(contest_of, "own_values", lambda *others: {})
    monkeypatch.setattr(contest_of, "compare", lambda *others: proof)
    data = Data((), (), {}, np.random.default_rng(0))
    return search_of._thinned(base, both, before, data, None, lambda share, words: None)


@pytest.mark.parametrize(
    ("again", "kept"),
    [(-995.0, ["offset"]), (-100.0, ["offset", "delay"]), (-10.0, ["offset", "delay"])],  # -50 before
)
def test_the_last_effect_must_be_needed_from_where_it_led_too(again, kept, monkeypatch):
    """A delay may have been confirmed only because the model before it had stopped at a wrong skew."""
    best, without, dropped = two_named(monkeypatch, again)
    assert [effect.name for effect in best.effects] == kept
    assert [one.effect.name for one in dropped] == (["delay"] if len(kept) == 1 else [])
    if len(kept) == 2:
        assert without["delay"].answer.score == min(again, -50.0)


@pytest.mark.parametrize(
    ("size", "error_gain", "why"),
    [
        (0.9, 0.5, "the refit leaves it at 90 % of the smallest size worth a name"),
        (2.0, 0.03, "held out, windows err by 3.0 % less"),
    ],
)
def test_effects_stay_that_would_be_confirmed_as_the_last_to_come(size, error_gain, why, monkeypatch):
    """One of a size that is not worth a name, or one whose windows err by 3 % less, would not."""
    best, _, dropped = two_named(monkeypatch, size=size, error_gain=error_gain)
    assert not best.effects
    assert [one.why.partition(":")[0] for one in dropped] == 2 * [why]


@pytest.mark.parametrize("led", [True, False])
@pytest.mark.parametrize("left", [3.0, 9.0])
def test_the_effect_that_led_best_goes_on_unconfirmed_from_where_it_led(led, left, monkeypatch):
    weak, strong = (SimpleNamespace(name=name) for name in ("weak", "strong"))
    rivals = tuple(
        Rival(effect, Candidate((), None, None, None), gain, None, "no gain", hopeful=effect is strong)
        for effect, gain in ((strong, 900.0), (weak, 5.0))
    )
    look = search_of._Look((), (SimpleNamespace(effect=weak),) if led else (), "quiet", rivals)
    assert search_of._unconfirmed(look, beside=True).effect is strong
    ahead = search_of._unconfirmed(look)
    assert ahead.effect is (weak if led else strong)
    monkeypatch.setattr(search_of, "stood", lambda current, signature, guide, data, plain: (signature, guide))
    monkeypatch.setattr(search_of, "excess", lambda judged, noise: left)
    guide = search_of._guiding(look, ahead, None, Data((), (), {}, np.random.default_rng(0)), None)
    assert guide == ((look.led[0], "quiet") if led and left > 4.0 else None)


def test_of_two_as_good_the_effect_with_fewer_parameters_leads():
    def rival(count, gain):
        effect, against = SimpleNamespace(fitted=range(count)), SimpleNamespace(bounded_gain=0.0)
        return Rival(effect, None, gain, against, "", hopeful=True)

    plain, rich, richer = rival(1, 1000.0), rival(2, 1001.0), rival(3, 1500.0)
    assert sorted([rich, plain], key=contest_of.order) == [plain, rich]
    assert sorted([plain, richer], key=contest_of.order) == [richer, plain]


@pytest.mark.parametrize(
    ("train", "held_out", "error", "hopeful", "leads"),
    [
        (7000.0, 800.0, 0.3, True, True),
        (900.0, 800.0, 0.3, True, False),
        (7000.0, 400.0, 0.3, True, False),
        (7000.0, 800.0, 0.05, True, False),
        (7000.0, 800.0, 0.3, False, False),
    ],
)
def test_who_explains_more_in_every_way_leads_once_something_is_confirmed(
    train, held_out, error, hopeful, leads
):
    def rival(gain, bounded, closer, why, hopeful=True):
        effect = SimpleNamespace(fitted=(1, 2))
        return Rival(effect, None, gain, Comparison(bounded, bounded, 0.01, 0.0, closer), why, hopeful)

    confirmed, larger = rival(1700.0, 600.0, 0.1, ""), rival(train, held_out, error, "p = 0.009", hopeful)
    found = contest_of.foremost([confirmed, larger])
    assert (found[0].effect is larger.effect, found[0].why) == (leads, "")
    assert len(found) == 2
    unconfirmed = contest_of.foremost([larger, rival(1.0, 1.0, 0.0, "p = 0.5")])
    assert unconfirmed[0] is larger and unconfirmed[0].why


@pytest.mark.parametrize("again", [True, False])
def test_an_effect_that_its_refit_loses_is_tried_again_from_others(again, monkeypatch):
    effect = SimpleNamespace(
        size=lambda values: values["much"], at_null=lambda: {"much": 0.0}, strength={"much": 1.0},
        qualified=lambda values: values,
    )  # fmt: skip
    scores = {2.0: -10.0, 1.0: -500.0, 4.0: -50.0}  # from the screen's size the refit ends at nothing

    def started(contest, question, effect, values):
        much = values["much"]
        return SimpleNamespace(score=scores[much], much=0.0 if much == 2.0 else much)

    monkeypatch.setattr(refit_of, "_started", started)
    monkeypatch.setattr(contest_of, "own_values", lambda effect, rig, answer: {"much": answer.much})
    monkeypatch.setattr(Data, "question", lambda self, rig, plain: SimpleNamespace(rig=rig))
    for name in ("grown", "replace"):
        monkeypatch.setattr(
            refit_of, name, lambda *others, **more: SimpleNamespace(model=None, parameters={})
        )
    model = SimpleNamespace(rig=SimpleNamespace(model=None))
    data = Data((), (), {}, np.random.default_rng(0))
    contest = refit_of.Contest(model, model, None, 1, data, lambda words: None)
    found = refit_of._attempt(contest, SimpleNamespace(effect=effect, values={"much": 2.0}, beside={}), again)
    assert found.answer.score == (-500.0 if again else -10.0)


@pytest.mark.parametrize(
    ("gains", "again"),
    [
        ({"lag": 3.0, "delay": 1.0, "drag": 0.0}, []),  # nothing explains anything
        # One does: what is easily confused with it and fell behind, from where it stands.
        ({"lag": 900.0, "delay": 1.0, "drag": 0.0}, ["delay"]),
        ({"lag": 900.0, "delay": 600.0, "drag": 0.0}, []),
    ],
)
def test_refits_that_lost_their_way_start_again(gains, again, monkeypatch):
    def refit(name, gain):
        effect = SimpleNamespace(name=name, fitted=(1,), look_alikes=("delay",) if name == "lag" else ())
        return SimpleNamespace(effect=effect, answer=SimpleNamespace(score=-gain), size=2.0)

    def better(contest, t, best, goal):
        assert goal == pytest.approx(-0.3 * 900.0)  # what is followed no further need not be found
        calls.append(t.effect.name)
        return SimpleNamespace(score=-1000.0 if t.effect.name == "delay" else 1000.0)

    calls, tried = [], [refit(name, gain) for name, gain in gains.items()]
    monkeypatch.setattr(refit_of, "_beside", better)
    here, data = SimpleNamespace(score=0.0), Data((), (), {}, np.random.default_rng(0))
    current = Candidate((), None, here, None)
    contest = refit_of.Contest(current, current, SimpleNamespace(), 30, data, lambda words: None)
    likelier = refit_of._start_again(contest, tried)
    assert calls == again == [t.effect.name for t in likelier]
    assert next(t.effect.name for t in tried) == ("delay" if again else "lag")
    assert {t.effect.name: -t.answer.score for t in tried} == gains | ({"delay": 1000.0} if again else {})
    calls.clear()
    refit_of._start_again(refit_of.Contest(current, current, here, 30, data, lambda words: None), tried)
    assert calls == []  # nothing looked with less process noise


@pytest.mark.parametrize(
    ("before", "followed"),
    [
        (0.0, ["lag", "far", "lag"]),
        (1000.0, ["lag", "far", "lag"]),
        (1600.0, ["lag", "lag"]),  # the others come far short of what is confirmed already
        (2000.0, []),
    ],
)
def test_who_comes_far_short_of_what_is_confirmed_is_not_followed(before, followed, monkeypatch):
    calls = []

    def refitted(name, gain):
        effect = SimpleNamespace(name=name, look_alikes=())
        noise = SimpleNamespace(levels=name)
        return SimpleNamespace(
            effect=effect, size=2.0, answer=SimpleNamespace(score=-gain, p=None, noise=noise, question=None)
        )

    def maximise(question, p, levels, **others):
        calls.append(levels)
        return SimpleNamespace(score=0.0)  # likelier than where it led is none of them

    monkeypatch.setattr(refit_of, "maximise", maximise)
    monkeypatch.setattr(refit_of, "foreseeing", lambda answer, horizon: answer)
    monkeypatch.setattr(refit_of, "_explains_all", lambda contest, best: False)
    monkeypatch.setattr(refit_of, "_start_again", lambda contest, tried: [])
    monkeypatch.setattr(refit_of, "_chosen", lambda contest, likely, led: likely)
    current = Candidate((), None, SimpleNamespace(score=0.0), SimpleNamespace(horizon=0.5))
    data = Data((), (), {}, np.random.default_rng(0))
    contest = refit_of.Contest(current, current, None, 1, data, lambda words: None)
    tried = [refitted("lag", 900.0), refitted("far", 750.0)]
    tried[0].answer.question = tried[1].answer.question = SimpleNamespace()
    refit_of._follow(contest, tried, before)
    assert calls == followed


@pytest.mark.parametrize(("whole", "asked"), [(True, ["lag", "drag"]), (False, ["lag", "drag", "delay"])])
def test_look_alikes_start_again_only_where_the_best_leaves_something(whole, asked, monkeypatch):
    def refitted(name, gain):
        effect = SimpleNamespace(name=name, look_alikes=())
        noise = SimpleNamespace(levels=None)
        answer = SimpleNamespace(score=-gain, p=None, noise=noise, question=name)
        return SimpleNamespace(effect=effect, size=2.0, answer=answer)

    calls, tried = [], [refitted("lag", 900.0), refitted("drag", 800.0), refitted("delay", 1.0)]

    def maximise(question, p, levels, **others):
        calls.append(question)
        return SimpleNamespace(score=0.0)

    def again(contest, tried):
        late = tried.pop()
        late.answer.score = -850.0
        tried.insert(1, late)
        return [late]

    monkeypatch.setattr(refit_of, "_chosen", lambda contest, likely, led: likely)
    monkeypatch.setattr(refit_of, "maximise", maximise)
    monkeypatch.setattr(refit_of, "foreseeing", lambda answer, horizon: answer)
    monkeypatch.setattr(refit_of, "_explains_all", lambda contest, best: whole)
    monkeypatch.setattr(refit_of, "_start_again", again)
    monkeypatch.setattr(refit_of, "CLOSE", 2.0)  # nothing goes further still
    current = Candidate((), None, SimpleNamespace(score=0.0), SimpleNamespace(horizon=0.5))
    data = Data((), (), {}, np.random.default_rng(0))
    contest = refit_of.Contest(current, current, None, 1, data, lambda words: None)
    refit_of._follow(contest, tried, 0.0)
    assert calls == asked


@pytest.mark.parametrize(
    ("why", "lag", "second", "there"),
    [
        ("", 3.4e-3, 0.7, True),
        ("", 1e-3, 0.7, False),  # likelihood bent it
        ("", 3.4e-3, 0.0, False),
        ("no gain", 3.4e-3, 0.7, False),
    ],
)
def test_a_refit_that_stands_where_its_effect_leads_is_not_refitted_from_there(
    why, lag, second, there, monkeypatch
):
    effect, candidate = SimpleNamespace(name="lag"), Candidate((), None, None, None)
    rival = Rival(effect, candidate, 900.0, None, why, hopeful=True)
    monkeypatch.setattr(
        contest_of, "own_values", lambda effect, rig, answer: {"lag": lag, "second": second, "none": 0.0}
    )
    led = SimpleNamespace(effect=effect, values={"lag": 3.7e-3, "second": 0.8, "none": 0.0})
    assert contest_of.arrived(rival, led) is there
    assert not contest_of.arrived(
        rival, SimpleNamespace(effect=SimpleNamespace(name="other"), values=led.values)
    )


def test_a_second_start_ends_where_its_goal_falls_out_of_reach(monkeypatch):
    goals, noise = [], SimpleNamespace(levels=None)
    answer = SimpleNamespace(question=None, noise=noise)
    t = SimpleNamespace(effect=SimpleNamespace(qualified=dict), answer=answer, values={})
    monkeypatch.setattr(refit_of, "placed", lambda *others: None)
    monkeypatch.setattr(refit_of, "_scaled", lambda effect, values, much: values)
    monkeypatch.setattr(refit_of, "likeliest", lambda question, starts: starts[0])
    monkeypatch.setattr(refit_of, "maximise", lambda *others, goal, **more: goals.append(goal))
    refit_of._beside(None, t, t, goal=-270.0)
    assert goals == [-270.0]


def test_the_air_may_go_wrong_in_both_chambers_at_once():
    tried = places(read_rig(Path(__file__).parents[2] / "data" / "bench.toml").model)
    assert ("flow.chamber_a", "flow.chamber_b") in tried and ("valve.command",) in tried


def test_recordings_that_disagree_widen_the_intervals(tmp_path):
    def said(factors):
        train = [recording(k, f"run{k}.csv", lambda u, f=f: f * u) for k, f in enumerate(factors)]
        data = Data(tuple(train), tuple(train), {}, np.random.default_rng(0))
        base = fit_base(rig(tmp_path), data, lambda share, words: None)
        gain = [base.rig.model.parameters[i].name for i in base.answer.question.free].index("gain")
        return base, disagreement(base.answer), gain

    base, apart, gain = said((1.1, 0.9, 1.0))
    # Without one of them 2.85, 3.15 and 3: a spread of 0.17, and Student's 4.3 with two degrees of freedom.
    assert apart[gain] == pytest.approx(4.3 * 0.173, rel=0.2)
    least = estimates(base.answer, (), apart)[gain]
    assert least.high - least.low > 1.9 * apart[gain]
    one, six = (estimates(base.answer, (), ratio=ratio)[gain] for ratio in (1.0, 6.0))
    assert six.high - six.low == pytest.approx(6.0 * (one.high - one.low))
    assert said((1.0, 1.0, 1.0))[1][gain] < 0.05


@pytest.mark.parametrize(
    ("left", "ratio", "beyond", "led", "asked"),
    [
        (0.01, 1.1, False, 9, [5]),
        (0.01, 1.1, True, 9, [5, 2]),  # the windows' pasts explain it, or hide something
        (0.01, 9.0, True, 0, [9, 2]),
        (0.1, 9.0, True, 0, [9, 9]),
        (0.01, 9.0, True, 9, [5, 3, 2, 2]),
        (0.1, 9.0, True, 9, [5, 3, 5, 3]),
        (
            0.1,
            2.0,
            True,
            9,
            [5, 3, 9, 5],
        ),  # a model that errs by so little is not bent: the screen comes first
    ],
)
def test_a_search_goes_on_while_something_is_left_and_with_few_where_it_is_little(
    left, ratio, beyond, led, asked, monkeypatch
):
    """Little is left and the windows are at the noise: it ends. They are not: the two best are still tried.

    Where much is left, the five or two that lead best from afar come before three that the screen shows.
    """
    rounds, led_on, begun = [], [], []

    def plain(current, data):
        begun.append(current)
        return current

    def rivals(contest, few, before=()):
        rounds.append(len(few))
        name = f"effect {len(rounds)}"
        if len(rounds) > 1:
            return list(before)
        candidate = Candidate((name,), SimpleNamespace(model=None), None, None)
        return [Rival(name, candidate, 100.0, None, "", hopeful=True)]

    monkeypatch.setattr(search_of, "refit", rivals)
    monkeypatch.setattr(search_of, "_thinned", lambda base, current, *others: (current, {}, ()))
    monkeypatch.setattr(search_of, "beyond_noise", lambda judged, noise: beyond)
    monkeypatch.setattr(search_of, "cleared", lambda *others: 1.0 - left)
    monkeypatch.setattr(search_of, "needed", lambda base: 0.96)
    monkeypatch.setattr(search_of, "likelier", lambda current, data: led_on.append(current) or current)
    for part in (search_of, settling):
        monkeypatch.setattr(part, "excess", lambda judged, noise: ratio if rounds else 9.0)
    monkeypatch.setattr(settling, "plainer", plain)
    for name in ("screen", "admitted", "quieted"):
        monkeypatch.setattr(search_of, name, lambda *others: [SimpleNamespace(name="any")] * 9)
    for name, count in (("_promising", 9), ("from_afar", led)):
        these = [SimpleNamespace(effect=f"{name} {k}") for k in range(count)]
        monkeypatch.setattr(search_of, name, lambda *others, these=these: these)
    base = Candidate((), SimpleNamespace(model=None), None, None)
    data = Data((), (), {}, np.random.default_rng(0))
    found = search_of.search(base, (), data, lambda share, words: None)
    assert rounds == asked
    assert found.best.effects == ("effect 1",)
    assert led_on == ([found.best] if left < FORM else [])  # it may be all, and only stand beside its top
    assert begun == ([found.best] if 1.2 < ratio < 4.8 else [])  # it may be all, and its contact only yield


@pytest.mark.parametrize(("plainly", "taken"), [(1.1, True), (1.3, False)])
def test_an_effect_that_a_rigid_contact_makes_all_there_is_goes_on_so(plainly, taken, monkeypatch):
    """One that leaves something still is left as others will be compared with it; they are as rigid otherwise."""

    def model(judged, effects):
        return Candidate(effects, SimpleNamespace(model=None), None, judged)

    def look(base, current, own, data, *others, **named):
        rigid.append(data.rigid)
        rivals = [Rival("any", winner, 100.0, None, "", hopeful=True)] if len(rigid) == 1 else []
        return search_of._Look((), (), None, tuple(rivals))

    base, winner, plain, rigid = model(9.0, ()), model(2.0, ("any",)), model(plainly, ("any",)), []
    monkeypatch.setattr(search_of, "_round", look)
    monkeypatch.setattr(search_of, "_thinned", lambda base, current, *others: (current, {}, ()))
    monkeypatch.setattr(settling, "plainer", lambda found, data: {winner: plain}[found])
    for part in (search_of, settling):
        monkeypatch.setattr(part, "excess", lambda judged, noise: judged)
    monkeypatch.setattr(search_of, "beyond_noise", lambda judged, noise: True)
    monkeypatch.setattr(search_of, "cleared", lambda *others: 0.5)
    monkeypatch.setattr(search_of, "needed", lambda base: 0.4)
    data = Data((), (), {}, np.random.default_rng(0))
    found = search_of.search(base, (), data, lambda share, words: None)
    assert found.best is (plain if taken else winner)
    assert found.rigid is taken
    assert rigid == [False, taken]


@pytest.mark.parametrize(
    ("ratio", "left", "before", "after", "named"),
    [
        (1.6, 1.5, 0.90, 0.93, True),  # 3 % of the first error
        (1.6, 1.5, 0.90, 0.91, False),
        (1.6, 1.1, 0.90, 0.91, True),  # windows at the noise
        (1.6, 1.5, 0.990, 0.996, True),  # most of the rest
        (1.6, 1.5, 0.990, 0.994, False),
    ],
)
def test_beside_others_an_effect_must_clear_more_than_the_form_of_their_laws_leaves(
    ratio, left, before, after, named, monkeypatch
):
    effect = SimpleNamespace(name="small", fitted=(), look_alikes=())
    answer = SimpleNamespace(score=0.0)
    tried = SimpleNamespace(effect=effect, rig=None, answer=answer, size=5.0, foreseen=-math.inf)
    current = Candidate(("large",), None, SimpleNamespace(score=1000.0), "before")
    base = Candidate((), None, None, "base")
    proof = SimpleNamespace(p_value=1e-4, error_gain=0.5, bounded_gain=9.0)
    monkeypatch.setattr(contest_of, "judge", lambda answer, holdout: "after")
    monkeypatch.setattr(contest_of, "centred", lambda effects, rig, answer: ((effects, "told"), answer))
    monkeypatch.setattr(contest_of, "compare", lambda *others: proof)
    monkeypatch.setattr(
        contest_of, "cleared", lambda base, seen, noise: {"before": before, "after": after}[seen]
    )
    monkeypatch.setattr(contest_of, "excess", lambda judged, noise: {"before": ratio, "after": left}[judged])
    data = Data((), (), {}, np.random.default_rng(0))
    contest = refit_of.Contest(base, current, None, 1, data, lambda words: None)
    rival = contest_of.rival_of(contest, tried, 0)
    assert rival.candidate.rig == (
        ("large", effect),
        "told",
    )  # what recordings have of their own is told first
    assert (not rival.why) is named
    assert named or rival.why.startswith(f"it clears {100 * (after - before):.1f} % of the first error")


@pytest.mark.parametrize(("share", "named"), [(0.6, True), (0.4, False)])
def test_what_the_pasts_of_windows_may_explain_an_effect_beside_others_must_take_away(
    share, named, monkeypatch
):
    asked = []

    def cleared(before, after, noise, *, imperfect):
        asked.append((before, after, imperfect))
        return share

    monkeypatch.setattr(contest_of, "excess", lambda judged, noise: 1.1)
    monkeypatch.setattr(contest_of, "cleared", cleared)
    current = Candidate(("large",), None, None, "before")
    data = Data((), (), {}, np.random.default_rng(0))
    contest = refit_of.Contest(current, current, None, 1, data, lambda words: None)
    proof = SimpleNamespace(p_value=1e-4, error_gain=0.5, bounded_gain=9.0)
    rival = Rival(None, Candidate((), None, None, "after"), 99.0, proof, "", hopeful=True)
    why = contest_of.reason(contest, rival, contest_of.level(0))
    assert (not why) is named
    assert named or why.startswith("it clears 40 % of the error beyond the noise")
    assert asked == [("before", "after", False)]


@pytest.mark.parametrize(
    ("before", "after", "gain", "named"),
    [
        (5.0, 1.1, 9.0, True),
        (5.0, 1.3, 9.0, False),  # more is missing: it could as well be something else
        (1.1, 1.0, 9.0, False),  # nothing shows that anything is missing
        (5.0, 1.1, -1.0, False),  # the rest of the hold-out speaks against it
    ],
)
def test_what_acts_seldom_counts_where_it_brings_the_windows_to_the_noise(
    before, after, gain, named, monkeypatch
):
    """One window of sixteen has no significance over windows, whatever it gains."""
    current, candidate = (Candidate((), None, None, judged(np.zeros(800), rmse)) for rmse in (before, after))
    contest = refit_of.Contest(
        current,
        current,
        None,
        1,
        Data((), (), {"position": 1.0}, np.random.default_rng(0)),
        lambda words: None,
    )
    against = Comparison(gain, gain, 0.016, 0.0, 0.5)
    cushion = SimpleNamespace(name="cushion", fitted=(), size=lambda values: 2.0)
    rival = Rival(cushion, candidate, 900.0, against, "", hopeful=True)
    assert (not contest_of.reason(contest, rival, contest_of.level(0))) is named
    assert contest_of.reason(contest, replace(rival, why="too little", hopeful=False), 0.01) == "too little"
    # It is needed later, too, though the windows that show it are few.
    effect = rival.effect
    with_it = Candidate((effect,), None, SimpleNamespace(score=-900.0), candidate.judged)
    base = Candidate((), None, SimpleNamespace(score=0.0), current.judged)
    monkeypatch.setattr(contest_of, "own_values", lambda *others: {})
    monkeypatch.setattr(contest_of, "compare", lambda *others: against)
    best, *_ = search_of._thinned(base, with_it, base, contest.data, None, lambda share, words: None)
    assert (best is with_it) is named


@pytest.mark.parametrize(
    ("much", "there", "why", "asked"),
    [
        (9.0, True, "", [["lag", "drag"], ["play"]]),
        (9.0, False, "", [["lag", "drag"], ["play"]]),
        (9.0, False, "no gain", [["lag", "drag"], ["lag", "play"]]),
        (2.0, True, "", [["lag", "play"], ["drag"]]),
        (2.0, False, "", [["lag", "play"], ["lag", "drag"]]),
    ],
)
def test_a_round_spares_what_stands_where_its_effect_leads(much, there, why, asked, monkeypatch):
    """A bent model is led from afar first; elsewhere what the screen shows may already stand where that would end.

    What came from afar and is not confirmed may have lost its way: it begins where the model is, too.
    """
    lag, drag, play = (SimpleNamespace(name=name) for name in ("lag", "drag", "play"))
    refits = []

    def refit(contest, few, before=()):
        refits.append([one.effect.name for one in few])
        return [Rival(lag, Candidate((lag,), None, None, None), 900.0, None, why, hopeful=True)]

    def seen(*effects):
        return lambda *others: [SimpleNamespace(effect=effect) for effect in effects]

    monkeypatch.setattr(search_of, "refit", refit)
    monkeypatch.setattr(search_of, "from_afar", seen(lag, drag))
    monkeypatch.setattr(search_of, "_promising", seen(lag, play))
    monkeypatch.setattr(search_of, "arrived", lambda rival, led: there and rival.effect is led.effect)
    monkeypatch.setattr(search_of, "excess", lambda judged, noise: much)
    monkeypatch.setattr(search_of, "admitted", lambda model, own: [lag, drag, play])
    for name in ("screen", "quieted"):
        monkeypatch.setattr(search_of, name, lambda *others: [])
    current = Candidate((), SimpleNamespace(model=None), None, None)
    data = Data((), (), {}, np.random.default_rng(0))
    look = search_of._round(current, current, (), data, lambda words: None)
    assert refits == asked
    assert [one.effect for one in look.led] == [lag, drag]  # who led is known all the same


def test_a_round_may_leave_an_effect_out(monkeypatch):
    both = [SimpleNamespace(name=name) for name in ("lag", "drag")]
    seen = []
    monkeypatch.setattr(search_of, "admitted", lambda model, own: both)
    monkeypatch.setattr(search_of, "screen", lambda answer, train, effects: seen.extend(effects) or [])
    current = Candidate((), SimpleNamespace(model=None), None, None)
    data = Data((), (), {}, np.random.default_rng(0))
    search_of._round(current, current, (), data, lambda words: None, 0, "lag")
    assert seen == both[1:]


@pytest.mark.parametrize(
    ("left", "tried"),
    [
        ({"lag": 1.1, "drag": 9.0, "delay": 1.5}, ["lag", "delay"]),
        ({"lag": 1.5, "drag": 9.0, "delay": 1.1}, ["lag", "drag", "delay", "leak"]),
    ],
)
def test_where_one_explains_all_only_what_resembles_it_is_tried(left, tried, monkeypatch):
    calls = []

    def attempt(contest, signature, again):
        calls.append(signature.effect.name)
        return SimpleNamespace(
            effect=signature.effect, answer=SimpleNamespace(score=left.get(calls[-1], 9.0))
        )

    alike = {"lag": ("delay",), "delay": ("leak",)}
    few = [
        SimpleNamespace(effect=SimpleNamespace(name=name, look_alikes=alike.get(name, ())))
        for name in ("lag", "drag", "delay", "leak")
    ]
    monkeypatch.setattr(refit_of, "_attempt", attempt)

    def judge(answer, holdout):
        return SimpleNamespace(
            left=answer.score, scores={"position": SimpleNamespace(rmse=2e-5 * answer.score)}
        )

    def dear(judged, noise):
        assert judged.left < 5.0  # what errs by more is not looked at any closer
        return judged.left

    monkeypatch.setattr(refit_of, "judge", judge)
    monkeypatch.setattr(refit_of, "excess", dear)
    monkeypatch.setattr(refit_of, "_follow", lambda *others: None)
    effect = SimpleNamespace(name="lost")
    lost, turns = Rival(effect, None, 0.0, SimpleNamespace(bounded_gain=0.0), "no gain", False), []
    monkeypatch.setattr(refit_of, "rival_of", lambda contest, t, turn: turns.append(turn) or lost)
    monkeypatch.setattr(contest_of, "cost", lambda effect: 0.0)
    data = Data((), (), {"position": 2e-5}, np.random.default_rng(0))
    contest = refit_of.Contest(None, None, None, 4, data, lambda words: None)
    refit_of.refit(contest, few)
    assert calls == tried
    assert turns == list(range(len(tried)))


def test_the_rivals_of_two_looks_take_their_turns_together(monkeypatch):
    """By likelihood: one of the second look that gains most has the first turn's half of the error rate."""
    monkeypatch.setattr(refit_of, "reason", lambda contest, rival, place: f"turn {place}")
    best = []
    monkeypatch.setattr(refit_of, "_follow", lambda contest, tried, before: best.append(before))
    monkeypatch.setattr(contest_of, "cost", lambda effect: 0.0)
    before = [
        Rival(SimpleNamespace(name=name), None, gain, SimpleNamespace(bounded_gain=0.0), "", True)
        for name, gain in (("drag", 5.0), ("lag", 900.0), ("drag", 50.0))
    ]
    before.append(replace(before[1], effect=SimpleNamespace(name="drift"), train_gain=4.0, why="no gain"))
    before[1] = replace(before[1], why="")
    data = Data((), (), {}, np.random.default_rng(0))
    found = refit_of.refit(refit_of.Contest(None, None, None, 4, data, lambda words: None), (), before)
    assert [(one.effect.name, one.train_gain, one.why) for one in found] == [
        ("lag", 900.0, "turn 0.005"), ("drag", 50.0, "turn 0.0025"), ("drift", 4.0, "turn 0.00125"),
    ]  # fmt: skip
    assert best == [900.0]
    refit_of.refit(refit_of.Contest(None, None, None, 4, data, lambda words: None), (), before[3:])
    assert best[1] == 0.0  # nobody is confirmed


@pytest.mark.parametrize(("noise_left", "settled"), [(1.1, 1), (1.5, 0)])
def test_a_winner_is_settled_where_nothing_more_is_missing(noise_left, settled, monkeypatch):
    calls = []
    effect = SimpleNamespace(name="one", fitted=(), look_alikes=())
    tried = SimpleNamespace(effect=effect, answer=SimpleNamespace(score=0.0), size=5.0)
    won = Rival(
        effect, Candidate((effect,), None, None, None), 10.0, SimpleNamespace(bounded_gain=1.0), "", True
    )
    monkeypatch.setattr(refit_of, "_attempt", lambda *others, again: tried)
    monkeypatch.setattr(refit_of, "_explains_all", lambda *others: False)
    monkeypatch.setattr(refit_of, "_follow", lambda *others: None)
    monkeypatch.setattr(refit_of, "rival_of", lambda *others: won)
    monkeypatch.setattr(refit_of, "_settle", lambda *others: calls.append(1))
    monkeypatch.setattr(refit_of, "excess", lambda judged, noise: noise_left)
    data = Data((), (), {}, np.random.default_rng(0))
    contest = refit_of.Contest(None, None, None, 1, data, lambda words: None)
    assert refit_of.refit(contest, [SimpleNamespace(effect=effect)]) == [won]
    assert len(calls) == settled


@pytest.mark.parametrize(
    ("score", "why", "noisy", "kept"),
    [
        (-200.0, "", True, ("other", "second")), (-90.0, "", True, ("first", "second")),
        (-200.0, "no gain on the recordings held out", True, ("first", "second")),
        (-200.0, "", False, ("first", "second")),
    ],
)  # fmt: skip
def test_the_first_effect_has_to_hold_its_place_beside_the_others(score, why, noisy, kept, monkeypatch):
    """It was chosen alone: what does better in its place takes it, where the windows are not at the noise."""
    first, second, other = (SimpleNamespace(name=name, fitted=()) for name in ("first", "second", "other"))

    def candidate(effects, score):
        rig = SimpleNamespace(model=SimpleNamespace(laws_leave=0.2))
        return Candidate(effects, rig, SimpleNamespace(score=score), None)

    base, alone = candidate((), 0.0), candidate((second,), -50.0)
    both, exchanged = candidate((first, second), -100.0), candidate((second, other), score)
    following = {
        "": (first, candidate((first,), -40.0), ""), "first": (second, both, ""), "second": (other, exchanged, why),
    }  # fmt: skip

    def one_round(base, current, own, data, tell, most=None, but="", guide=None, afar=True):
        assert but == ("first" if current is alone else "")  # it stands already: what else there is
        found = following.get(" ".join(effect.name for effect in current.effects))
        if found is None:
            return search_of._Look((), (), None, ())
        effect, there, why = found
        return search_of._Look((), (), None, (Rival(effect, there, 100.0, None, why, hopeful=False),))

    def thinned(base, current, before, data, plain, report):
        return current, {"first": alone}, ()

    monkeypatch.setattr(search_of, "_round", one_round)
    monkeypatch.setattr(search_of, "_thinned", thinned)
    monkeypatch.setattr(search_of, "excess", lambda judged, noise: 9.0 if noisy else 1.1)
    monkeypatch.setattr(search_of, "rigidly", lambda current, data: (current, data))
    monkeypatch.setattr(search_of, "cleared", lambda *others: 0.5)
    data = Data((), (), {}, np.random.default_rng(0))
    found = search_of.search(base, (), data, lambda share, words: None)
    assert sorted(effect.name for effect in found.best.effects) == sorted(kept)
    assert len(found.rounds) == (4 if kept[0] == "other" else 3)
