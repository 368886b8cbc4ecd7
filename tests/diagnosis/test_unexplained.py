"""A curve describes what no effect of the catalogue explains, and only where there is something to describe."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from optid.diagnosis import following, unexplained
from optid.diagnosis.candidate import Data, fit_base, refitted
from optid.diagnosis.contest import own_values
from optid.diagnosis.diagnosis import diagnose
from optid.diagnosis.disturbance import Located, locate, locate_at
from optid.diagnosis.finding import Verdict
from optid.diagnosis.following import led_on
from optid.diagnosis.forms import curves, fitting, levels, shared, sticking, swelling, turned
from optid.diagnosis.judge import EXCESS, excess
from optid.diagnosis.unexplained import _rivalling, _said, describe, look, nameless
from optid.effects.curve import Curve
from optid.effects.library import admitted
from optid.effects.relaxation import Relaxation
from optid.estimation.multistep import misses
from optid.report.diagnosis_document import diagnosis_document
from optid.report.diagnosis_page import diagnosis_page
from optid.rigs.rigfile import read_rig, with_effects, write_rig
from tests.diagnosis.describing import description
from tests.diagnosis.trolley import RATE, SD, recording, rig


def wavy(u):
    return u + 0.2 * np.sin(3.0 * u)


def fitted(folder, concealed):
    train = [recording(seed, f"run_{seed}", concealed) for seed in (1, 2)]
    held = [recording(3, "held", concealed)]
    data = Data(tuple(train), tuple(held), {"position": SD}, np.random.default_rng(0))
    return fit_base(rig(folder), data, lambda share, words: None), data


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    base, data = fitted(tmp_path_factory.mktemp("wavy"), wavy)
    site = locate_at(base, data, "drive.command")  # the drag's force would do as well
    return base, data, site, description(base, base, [site], data)


def test_the_curve_is_the_law(described):
    base, _, _, found = described
    rival = found.rival
    assert rival.effect.name == "curve@drive.command@command"
    before, after = (one.judged.scores["position"].rmse for one in (base, rival.candidate))
    assert after < 0.2 * before
    model, p = rival.candidate.rig.model, rival.candidate.answer.p
    u = np.linspace(-0.9, 0.9, 19)
    # velocity at rest: what pushes is the gain times the command with the curve
    rates = np.array([float(model.rates([0.0, 0.0], [one], p)[1]) for one in u])
    assert rates == pytest.approx(3.0 * wavy(u), abs=0.05)


def test_a_finding_tells_of_it_and_stays_without_a_name(described):
    base, data, site, found = described
    finding = nameless(base, [site], found, data)
    assert finding.effect is None and finding.evidence is found.rival.against
    assert "a curve over command describes it, without a name" in finding.sentence
    assert finding.shown[0] == "command"
    # the law's picture is the curve itself, up to what the fitted gain has taken of it
    u = found.rival.candidate.answer.question.problem.inputs[:, 0]
    slope, level = np.polyfit(u, finding.law - 0.2 * np.sin(3.0 * u), 1)
    assert finding.law == pytest.approx(0.2 * np.sin(3.0 * u) + slope * u + level, abs=0.03)


def test_the_rig_file_holds_it(described, tmp_path):
    found = described[3].rival.candidate
    values = dict(zip((q.name for q in found.rig.model.parameters), found.answer.p.tolist(), strict=True))
    write_rig(found.rig, tmp_path / "rig.toml", values)
    again = read_rig(tmp_path / "rig.toml")
    assert again.model.vector(again.parameters) == pytest.approx(found.answer.p, rel=1e-11)


def test_nothing_is_drawn_where_nothing_is_missing(tmp_path):
    base, data = fitted(tmp_path, lambda u: u)
    assert all(description(base, base, [one], data) is None for one in locate(base, data))


def test_curves_run_over_what_moved_and_turn_with_what_is_a_speed(described):
    base, data, *_ = described
    signal = np.random.default_rng(0).normal(0.0, 2.0, (len(base.answer.filtered.states[0]), 1))
    there = Located(("drag.force",), 1.0, signal, None, None)
    found = {curve.name.removeprefix("curve@drag.force@"): curve for curve in curves(base, there)}
    assert set(found) == {"position", "velocity", "command", "position@velocity", "command@velocity"}
    u = np.concatenate([one["command"].values for one in data.train])
    null = found["command@velocity"].at_null()
    assert (null["low"], null["high"], null["size"]) == (u.min(), u.max(), np.std(signal))
    speed = base.answer.filtered.states[0][:, 1]
    assert null["width"] == pytest.approx(0.05 * np.sqrt(np.mean(speed**2)))


def test_of_sites_with_a_signal_each_the_largest_speaks_unless_one_is_asked_for():
    signals = np.array([[0.0, 1.0, 0.2], [0.0, -1.0, 0.4]])
    both = Located(("none", "large", "small"), 1.0, signals, None, None)
    assert (both.site, both.signal.tolist()) == ("large", [1.0, -1.0])
    assert (both.only("small").site, both.only("small").signal.tolist()) == ("small", [0.2, 0.4])


def test_a_curve_may_lie_at_any_of_the_sites_whose_signals_came_together(described):
    base, data, site, before = described
    both = replace(
        site, sites=("sensor.position", *site.sites), signals=np.c_[9.0 * site.signal, site.signal]
    )
    assert both.site == "sensor.position"
    found = description(base, base, [both], data)
    assert found.rival.effect.sites == before.rival.effect.sites == ("drive.command",)
    finding = nameless(base, [both], found, data)
    assert finding.place == "drive.command" and finding.signal.signal == pytest.approx(site.signal)


def test_places_that_do_nearly_as_well_are_looked_at_as_well(described):
    base, data, site, before = described
    elsewhere = replace(site, sites=("sensor.position",))  # as good on what is held out
    badly = replace(site.judged, deviance=site.judged.deviance + 1.0)
    worse = replace(site, sites=("drag.force",), judged=badly)
    assert _rivalling([elsewhere, site, worse], data) == [site]
    found = description(base, base, [elsewhere, site, worse], data)
    assert found.rival.effect.name == before.rival.effect.name == "curve@drive.command@command"
    finding = nameless(base, [elsewhere, site, worse], found, data)
    assert (finding.site, finding.place) == ("drive", "drive.command")
    assert "an unknown signal at sensor.position explains the recordings best" in finding.sentence
    assert "describes it at drive.command, without a name" in finding.sentence


def test_an_answer_holds_the_curve_and_no_name(tmp_path):
    """No effect of the catalogue comes near it, for any site."""
    runs = [recording(seed, f"run_{seed}", lambda u: u + 0.35 * np.cos(7.0 * u)) for seed in (1, 2, 3)]
    found = diagnose(rig(tmp_path), runs[:2], runs[2:], generator=np.random.default_rng(0))
    assert found.verdict is Verdict.UNEXPLAINED
    assert [effect.name for effect in found.best.effects] == ["curve@drive.command@command"]
    document = diagnosis_document(found)
    assert [one["effect"] for one in document["findings"]] == [None]
    before, after = (document[part]["holdout"]["position"]["rmse"] for part in ("baseline", "improved"))
    assert after < 0.1 * before
    assert document["improved"]["parameters"].keys() >= {
        f"curve@drive.command@command.height_{k}" for k in (1, 13)
    }
    assert (
        f"With what describes it, which names nothing, windows err by position {1e3 * after:.3g} mm"
        in found.summary
    )
    assert "through it what describes it" in diagnosis_page(found)


def test_of_forms_about_as_good_the_one_where_the_mismatch_lies_is_followed_first():
    def led(site, gain):
        return SimpleNamespace(effect=SimpleNamespace(sites=(site,)), gain=gain)

    force, drive, poor = led("drag.force", 990.0), led("drive.command", 970.0), led("drive.command", 900.0)
    assert unexplained._ordered([poor, force, drive], ["drive", "drag"]) == [drive, force, poor]
    assert unexplained._ordered([poor, force, drive], ["sensor", "drag"]) == [force, drive, poor]
    assert unexplained._ordered([], ["drive"]) == []


def test_a_curve_over_what_the_plant_declares_only_later_is_left_out(tmp_path):
    plant = rig(tmp_path)
    late = Curve("drive.command", "torque")
    early = Curve("drive.command", "velocity")
    assert fitting(plant, [late, early]) == [early]


def axis_seen(located):
    """What a description needs of a fitted axis: its rig, states that move at random, where something is missing."""
    plant = read_rig(Path(__file__).parents[2] / "data" / "bench.toml")
    rng = np.random.default_rng(5)
    columns = {
        "position": (-0.1, 0.1),
        "velocity": (-1.0, 1.0),
        "pressure_a": (3e5, 5e5),
        "pressure_b": (3e5, 5e5),
    }
    X = np.stack([rng.uniform(*columns.get(s.name, (0.0, 0.0)), 400) for s in plant.model.states], axis=1)
    U = np.zeros((400, len(plant.model.inputs)))
    question = SimpleNamespace(problem=SimpleNamespace(inputs=U))
    answer = SimpleNamespace(
        filtered=SimpleNamespace(states=X[None]), question=question, p=plant.model.vector(plant.parameters)
    )
    names = [state.name for state in plant.model.states]
    there = Located(located, 1.0, rng.normal(0.0, 2e-4, (400, len(located))), None, None)
    return SimpleNamespace(rig=plant, answer=answer), dict(zip(names, X.T, strict=True)), there


def test_sites_alike_share_what_each_of_them_knows():
    base, x, there = axis_seen(("flow.chamber_a", "flow.chamber_b"))
    found = {effect.name: effect for effect in shared(base, there)}
    both = "flow.chamber_a+flow.chamber_b"
    share, memory = found[f"scaling@{both}@P"], found[f"relaxation@{both}@P"]
    P = np.r_[x["pressure_a"], x["pressure_b"]]
    null = share.at_null()
    assert (null["low"], null["high"]) == (P.min(), P.max())
    null = memory.at_null()
    assert (null["scale"], null["start"]) == pytest.approx((P.std(), P.mean()))
    assert null["size"] == pytest.approx(there.signals.std())
    # Choked flows to the outside say no more than the pressure does, a spool that stands still says nothing.
    assert {f"relaxation@{both}@{name}" for name in ("other_P", "v", "x")} <= found.keys()
    assert not {f"relaxation@{both}@{name}" for name in ("ambient", "exhaust", "spool")} & found.keys()
    assert len(fitting(base.rig, found.values())) == len(found)


def test_a_single_site_remembers_states_and_inputs():
    base, _, there = axis_seen(("force.external",))
    found = {effect.name for effect in shared(base, there)}
    moving = ("position", "velocity", "pressure_a", "pressure_b")  # the command does not
    assert found == {f"relaxation@force.external@{name}" for name in moving}


def test_dry_friction_is_scaled_where_the_plant_has_some(described):
    """What sticks no force that is added describes."""
    base, x, _ = axis_seen(("flow.chamber_a",))
    found = {effect.name: effect for effect in levels(base)}
    known = ("position", "velocity", "pressure_a", "pressure_b", "drive", "share")
    shares = {f"scaling@force.coulomb@{name}" for name in known}
    assert found.keys() == shares | {"ageing@force.coulomb@velocity"}
    slow = found["ageing@force.coulomb@velocity"].at_null()["slow"]
    assert slow == pytest.approx(0.01 * np.sqrt(np.mean(x["velocity"] ** 2)))
    null = found["scaling@force.coulomb@position"].at_null()
    assert (null["low"], null["high"]) == (x["position"].min(), x["position"].max())
    assert len(fitting(base.rig, found.values())) == len(found)
    trolley, *_ = described
    assert levels(trolley) == []


def test_forms_swell_with_what_their_sites_know():
    base, x, there = axis_seen(("flow.chamber_a", "flow.chamber_b"))
    memory = next(one for one in shared(base, there) if one.kind == "relaxation" and one.along == "P")
    found = {form.by: form for form in swelling(base, memory)}
    assert {"P", "other_P", "v", "x"} <= found.keys() and "spool" not in found  # the spool stands still
    P = np.r_[x["pressure_a"], x["pressure_b"]]
    assert found["P"].at_null()["magnitude"] == pytest.approx(np.sqrt(np.mean(P**2)))
    share = levels(base)[0]
    assert {"velocity", "drive"} <= {form.by for form in swelling(base, share)}


def test_a_curve_is_turned_where_it_swells():
    base, x, _ = axis_seen(("force.external",))
    share = next(one for one in levels(base) if one.along == "position")
    assert turned(base, share) == []
    swelled = next(form for form in swelling(base, share) if form.by == "velocity")
    (other,) = turned(base, swelled)
    assert other.name == "scaling@force.coulomb@velocity*position"
    null = other.at_null()
    assert (null["low"], null["high"]) == (x["velocity"].min(), x["velocity"].max())
    assert null["magnitude"] == pytest.approx(np.sqrt(np.mean(x["position"] ** 2)))


def test_what_swells_with_a_speed_is_found_to(tmp_path):
    """A force over the position that only motion brings about: no curve over one signal does half as well."""

    def beside(t, x, v):
        return 2.5 * np.sin(4.0 * x) * abs(v)

    runs = [recording(seed, f"run_{seed}", beside=beside) for seed in (1, 2, 3)]
    data = Data(tuple(runs[:2]), (runs[2],), {"position": SD}, np.random.default_rng(0))
    base = fit_base(rig(tmp_path), data, lambda share, words: None)
    found = description(base, base, [locate_at(base, data, "drag.force")], data)
    assert found.rival.effect.name in ("curve@drag.force@position*velocity", "curve@drag.force@position*v")
    before, after = (one.judged.scores["position"].rmse for one in (base, found.rival.candidate))
    assert after < 0.04 * before


def test_a_drive_that_sticks_and_jumps_is_followed_to(tmp_path):
    """No slope leads to its width, and nothing that is added does what it does."""

    def stuck(u):
        stands, out = 0.0, []
        for one in u:
            stands = one if abs(one - stands) > 0.35 else stands
            out.append(stands)
        return np.array(out)

    base, data = fitted(tmp_path, stuck)
    looked = look(base, base, [locate_at(base, data, "drive.command")], data, lambda words: None)
    assert looked.best.effect.name == "sticking@drive.command@command" and looked.arrived
    found = looked.best.candidate
    own = own_values(looked.best.effect, found.rig, found.answer)
    assert own["size"] * own["width"] == pytest.approx(0.35, rel=0.1)
    before, after = (one.judged.scores["position"].rmse for one in (base, found))
    assert after < 1.2 * SD < 0.1 * before


def test_what_has_arrived_is_not_refitted_and_what_has_not_is_taken_further(described, monkeypatch):
    base, data, *_ = described
    looked = look(base, base, [described[2]], data, lambda words: None)
    seen = []
    monkeypatch.setattr(unexplained, "refit", lambda contest, few, before: seen.append(few) or list(before))
    assert looked.arrived and describe(looked, data).rival is looked.best
    assert seen == []
    far = replace(looked, contest=replace(looked.contest, data=replace(data, noise={"position": SD / 9})))
    assert not far.arrived
    describe(far, replace(data, noise={"position": SD / 9}))
    begun = next(one for one in seen[0] if one.effect is looked.best.effect)
    fitted_to = looked.best.candidate
    assert begun.values == own_values(begun.effect, fitted_to.rig, fitted_to.answer)
    assert set(begun.beside) == {"gain", "drag"}


@pytest.mark.parametrize(("quieter", "turns"), [(1.0, False), (9.0, True)])
def test_the_best_form_is_turned_where_windows_err_beyond_the_noise(described, monkeypatch, quieter, turns):
    base, data, site, _ = described
    other = over(curves(base, site), "velocity")
    monkeypatch.setattr(unexplained, "turned", lambda current, form: [other])
    less = replace(data, noise={"position": SD / quieter})
    rivals = look(base, base, [site], less, lambda words: None).rivals
    assert rivals[0].effect.name == "curve@drive.command@command"
    assert (other.name in [rival.effect.name for rival in rivals]) is turns


def test_what_predicts_better_describes_even_where_it_is_less_likely(described, monkeypatch):
    """A level that jumps a moment late surprises the filter, which process noise does not; windows hardly mind."""
    base, data, site, _ = described
    (first, *_), less = look(base, base, [site], data, lambda words: None).led, 1e5
    likely = replace(base, answer=replace(base.answer, score=base.answer.score - less))
    contest = replace(look(base, base, [site], data, lambda words: None).contest, current=likely)
    (rival,) = led_on(contest, [first])
    assert likely.answer.score < rival.candidate.answer.score and not rival.why
    seconds = base.judged.horizon
    missed = [misses(one, seconds) for one in (base.answer, rival.candidate.answer)]
    assert rival.train_gain == pytest.approx(2.0 * (missed[0] - missed[1]) / (seconds * RATE), rel=1e-6)
    monkeypatch.setattr(following, "misses", lambda answer, seconds: 1.0)
    (rival,) = led_on(contest, [first])
    assert rival.why.startswith("the refit gains 0 in -2 log likelihood")


def over(forms, along):
    return next(form for form in forms if form.along == along and not form.by)


def test_who_arrives_leaves_the_others_nothing(described):
    base, data, site, _ = described
    looked = look(base, base, [site], data, lambda words: None)
    right = next(one for one in looked.led if one.effect is looked.best.effect)
    form = over(curves(base, site), "velocity")
    wrong = replace(right, effect=form, values=form.at_null())
    said = []
    contest = replace(looked.contest, tell=said.append)
    (best,) = led_on(contest, [right, wrong])
    assert best.effect is right.effect and said == [f"following {right.effect.name}"]
    best, other = led_on(contest, [wrong, right])
    assert (best.effect, other.effect) == (right.effect, form) and len(said) == 3
    assert other.why and not best.why


def test_beside_effects_with_states_of_their_own_only_the_first_models_states_are_noisy(described):
    base, data, *_ = described
    (effect,) = (e for e in admitted(base.rig.model) if e.name == "hysteresis@drive.command")
    named = refitted(base.rig, (effect,), base, data, base.rig.model)
    assert len(named.rig.model.states) > len(base.rig.model.states)
    looked = look(base, named, [locate_at(named, data, "drive.command")], data, lambda words: None)
    best = looked.best.candidate
    assert [one.name for one in best.effects] == [effect.name, "curve@drive.command@command"]
    assert best.answer.question.groups == base.answer.question.groups
    assert excess(best.judged, data.noise) < EXCESS < excess(named.judged, data.noise)


def test_when_the_time_is_over_nobody_is_followed(described):
    base, data, site, _ = described
    looked = look(base, base, [site], replace(data, until=0.0), lambda words: None)
    assert (looked.led, looked.rivals, looked.arrived) == ([], [], False)


def test_forms_may_begin_where_unknown_signals_stand_that_came_with_the_same_model(described, monkeypatch):
    base, data, site, found = described
    asked = []
    monkeypatch.setattr(unexplained, "from_afar", lambda *args, near, race: asked.append(near) or [])
    look(base, base, [site], data, lambda words: None)
    look(base, found.rival.candidate, [site], data, lambda words: None)
    first, second = asked
    assert list(first) == ["drive.command"] and first["drive.command"].answer is site.answer
    assert second == {}


def test_a_description_says_times_with_their_unit(tmp_path):
    memory = Relaxation("drag.force", "velocity")
    full = with_effects(rig(tmp_path), [memory], memory.qualified({"height": 1.0, "time": 0.25}))
    fitted_to = SimpleNamespace(rig=full, answer=SimpleNamespace(p=full.model.vector(full.parameters)))
    assert (
        _said(memory, fitted_to) == "what follows changes of velocity and is forgotten in 250 ms describes it"
    )


def test_what_is_sent_may_stick_where_a_recorded_input_arrives():
    base, _, there = axis_seen(("valve.command",))
    assert sticking(base, there) == []  # the command does not move
    U = base.answer.question.problem.inputs
    U[:, 0] = np.linspace(-1.0, 1.0, len(U))
    (stuck,) = sticking(base, there)
    assert stuck.name == "sticking@valve.command@command"
    assert stuck.at_null()["size"] == pytest.approx(np.sqrt(np.mean(U[:, 0] ** 2)))
    assert swelling(base, stuck) == []  # it adds nothing that could
    base, _, there = axis_seen(("force.external",))
    assert sticking(base, there) == []
