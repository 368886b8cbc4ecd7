"""Diagnoses of a user's own plant against a closed form: named when it is there, silent when nothing is missing."""

from dataclasses import replace

import numpy as np
import pytest

from optid.core.budget import Budget
from optid.core.recording import Recording
from optid.diagnosis import testing
from optid.diagnosis.pipeline import diagnose
from optid.diagnosis.result import Verdict
from optid.errors import InputError
from optid.report.diagnosis_document import diagnosis_document
from optid.report.diagnosis_page import diagnosis_page
from tests.diagnosis.trolley import TRUTH, recording, rig

WIDTH = 0.2


def dead_band(u):
    return np.sign(u) * np.maximum(np.abs(u) - WIDTH, 0.0)


def asked(folder, concealed=lambda u: u, held=None, **how):
    train = [recording(seed, f"run{seed}.csv", concealed) for seed in (1, 2)]
    held = held or [recording(3, "held.csv", concealed)]
    return diagnose(rig(folder), train, held, **how)


@pytest.fixture(scope="module")
def dead(tmp_path_factory):
    return asked(tmp_path_factory.mktemp("dead"), dead_band)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return asked(tmp_path_factory.mktemp("sound"))


def test_nothing_missing_nothing_named(sound):
    assert sound.verdict is Verdict.CONSISTENT
    assert sound.findings == ()
    assert sound.test.best.scores["position"].rmse < 1.1 * sound.noise["position"]
    assert sound.test.p_value > sound.test.level  # a silent rig carries a test of its own
    for estimate in sound.best_parameters:
        assert estimate.low < TRUTH[estimate.name] < estimate.high


def test_a_dead_band_is_named_sized_and_proven(dead):
    assert dead.verdict is Verdict.MISSING_PHYSICS
    first = dead.findings[0]
    assert first.effect.name == "dead_zone@drive.command"
    assert first.site == "drive.command"  # an own plant speaks in its own sites
    width = {e.name: e for e in first.parameters}["width"]
    assert width.value == pytest.approx(WIDTH, rel=0.1)
    assert first.evidence.p_value < 0.01
    assert dead.test.p_value < 0.01
    before, after = dead.test.base.scores["position"].rmse, dead.test.best.scores["position"].rmse
    assert after < 1.2 * dead.noise["position"] < before


def test_the_unknown_input_goes_where_the_law_says(dead):
    (finding,) = dead.findings
    assert finding.law.shape == finding.signal.signal.shape
    # Where the command is beyond the band the law takes its width away from it, to the side of the command.
    u = np.concatenate([recording["command"].values for recording in dead.problem.train])
    driven = np.abs(u) > 2 * WIDTH
    assert np.abs(finding.law[driven] + WIDTH * np.sign(u[driven])).max() < 0.1 * WIDTH
    assert finding.signal.site == finding.place


def test_the_document_holds_what_the_contract_asks(dead):
    document = diagnosis_document(dead)
    assert document["verdict"] == "missing-physics"
    keys = {
        "effect",
        "site",
        "equation",
        "parameters",
        "where",
        "evidence",
        "indistinguishable_from",
        "suspected",
    }
    assert keys <= set(document["findings"][0])
    assert {"channels", "intervals", "states"} <= set(document["findings"][0]["where"])
    assert {"holdout_fit_gain", "p_value", "delta_bic"} <= set(document["findings"][0]["evidence"])
    assert document["baseline"]["holdout"]["position"]["unit"] == "m"
    assert 0.0 < document["test"]["p_value"] < 0.01
    assert "dead zone" in document["summary"].lower()


def test_the_page_stands_alone(dead):
    page = diagnosis_page(dead)
    assert page.count('<div class="figure"') >= 3
    assert 'src="http' not in page and 'href="http' not in page
    assert "dead zone" in page.lower()


def test_bounds_that_shut_the_truth_out_are_no_missing_physics(tmp_path):
    narrow = rig(tmp_path)
    shut = {"gain": (0.1, 2.5), "drag": (0.01, 50.0)}
    freed = tuple(replace(f, low=shut[f.name][0], high=shut[f.name][1]) for f in narrow.freed)
    train, held = [recording(1, "run.csv")], [recording(2, "held.csv")]
    found = diagnose(replace(narrow, freed=freed), train, held)
    assert found.verdict is Verdict.PARAMETERS
    assert found.findings == ()
    assert {e.name: e.value for e in found.best_parameters} == pytest.approx(TRUTH, rel=0.01)
    assert found.test.base.scores["position"].rmse > 3.0 * found.test.best.scores["position"].rmse
    assert "gain" in found.summary
    assert diagnosis_document(found)["verdict"] == "parameters"
    assert "<html" in diagnosis_page(found)


def test_without_a_hold_out_there_is_no_proof(tmp_path):
    with pytest.raises(InputError, match="held out"):
        diagnose(rig(tmp_path), [recording(1, "run.csv")], [])


def test_a_hold_out_of_a_few_samples_is_refused_before_work(tmp_path):
    held = recording(3, "held.csv")
    rest = np.arange(len(held)) >= 37
    gone = {role: replace(c, values=np.where(rest, np.nan, c.values)) for role, c in held.channels.items()}
    with pytest.raises(InputError, match="windows") as raised:
        asked(tmp_path, held=[replace(held, channels=gone)])
    assert "held.csv" in str(raised.value)


class Sealed(Recording):
    """A recording that raises when any of its samples is read while it is sealed."""

    sealed = False

    def __getattribute__(self, name):
        if name in ("time", "channels") and type(self).sealed:
            raise AssertionError("a stage before the test read the hold-out")
        return super().__getattribute__(name)


def test_no_stage_before_the_test_reads_the_hold_out(tmp_path, monkeypatch):
    """After the gate has looked at its form it is sealed, until the test opens it."""
    opened = []

    def progress(share, words):
        Sealed.sealed = not words.startswith("testing")

    def told(*given):
        opened.append(Sealed.sealed)
        return testing.test_on_holdout(*given)

    monkeypatch.setattr("optid.diagnosis.pipeline.test_on_holdout", told)
    held = recording(3, "held.csv", dead_band)
    try:
        found = asked(
            tmp_path, dead_band, held=[Sealed(held.name, held.time, held.channels)], progress=progress
        )
        assert opened == [False]
        Sealed.sealed = True
        with pytest.raises(AssertionError, match="read the hold-out"):
            found.problem.train[0].time + Sealed(held.name, held.time, held.channels).time
    finally:
        Sealed.sealed = False
    assert found.verdict is Verdict.MISSING_PHYSICS


def test_selection_may_be_judged_on_a_recording_of_its_own(tmp_path):
    """One whose validation recording shows no dead band is not told of one, though the others show it."""
    train = [recording(seed, f"run{seed}.csv", dead_band) for seed in (1, 2)]
    other = recording(4, "other.csv")
    held = [recording(3, "held.csv", dead_band)]
    found = diagnose(rig(tmp_path), [*train, other], held, validation=("other.csv",))
    assert found.verdict is not Verdict.MISSING_PHYSICS
    with pytest.raises(InputError, match=r"run9\.csv.*run1\.csv"):
        diagnose(rig(tmp_path), train, held, validation=("run9.csv",))


def test_a_name_that_the_hold_out_contradicts_is_a_suspicion(tmp_path):
    """The band is in the recordings to fit alone: something else is in what was held out."""
    found = asked(tmp_path, dead_band, held=[recording(3, "held.csv", lambda u: u)])
    assert found.verdict is Verdict.UNEXPLAINED
    assert all(finding.effect is None for finding in found.findings)
    assert "dead_zone@drive.command" in [
        one.effect for finding in found.findings for one in finding.suspected
    ]
    document = diagnosis_document(found)
    assert [f["effect"] for f in document["findings"]] == [None] * len(found.findings)


def test_a_right_name_stands_without_one_that_the_hold_out_contradicts(tmp_path):
    """The band is everywhere; what else is in the recordings to fit is not in what was held out."""

    def leaning(t, x, v):
        return 0.05

    train = [recording(seed, f"run{seed}.csv", dead_band, beside=leaning) for seed in (1, 2)]
    held = [recording(3, "held.csv", dead_band)]
    found = diagnose(rig(tmp_path), train, held)
    assert found.verdict is Verdict.MISSING_PHYSICS
    named, *rest = found.findings
    assert named.effect.name == "dead_zone@drive.command"
    assert [one.name for one in found.best.effects] == ["dead_zone@drive.command"]
    assert all(finding.effect is None for finding in rest)
    assert rest and all("does not confirm it" in one.why for f in rest for one in f.suspected)


def test_what_predicts_worse_than_the_model_as_it_came_is_not_handed_on(tmp_path):
    """A push that pulses with time has no name here; on the recording held out it pulls instead."""

    def pulses(sign):
        return lambda t, x, v: sign * np.sign(v) * abs(np.sin(2.0 * np.pi * t))

    train = [recording(seed, f"run{seed}.csv", beside=pulses(1.0)) for seed in (1, 2)]
    held = [recording(3, "held.csv", beside=pulses(-1.0))]
    found = diagnose(rig(tmp_path), train, held)
    assert found.verdict is Verdict.UNEXPLAINED
    assert found.test.refuted
    assert found.best is found.base
    assert found.test.best is found.test.base
    assert "With an empirical description" not in found.summary


def test_a_budget_that_ends_while_look_alikes_are_tried_is_told(tmp_path, monkeypatch):
    from optid.diagnosis import pipeline

    compare, over = pipeline.compare_alternatives, []
    monkeypatch.setattr(pipeline, "compare_alternatives", lambda *given: over.append(1) or compare(*given))
    monkeypatch.setattr(Budget, "is_over", property(lambda budget: bool(over)))
    found = asked(tmp_path, dead_band)
    assert found.path.ended_early and "stopped at its time limit" in found.summary


def test_a_budget_that_is_over_ends_with_what_there_is_and_says_so(tmp_path):
    found = asked(tmp_path, dead_band, budget=Budget(time_limit=1e-3))
    assert found.verdict in (Verdict.UNEXPLAINED, Verdict.MISSING_PHYSICS)
    assert "before everything was tried" in found.summary


def test_a_figure_that_is_not_finite_is_never_a_verdict(sound, tmp_path, monkeypatch):
    """A prediction that diverges on the hold-out stops the claim that the model is good to the noise."""
    from optid.diagnosis import evaluation

    windows = evaluation.predict_windows

    def diverges(*given):
        out = windows(*given)
        out.outputs[-50:] = np.nan
        return out

    monkeypatch.setattr(evaluation, "predict_windows", diverges)
    found = asked(tmp_path)
    assert found.verdict is Verdict.UNEXPLAINED
    assert found.test.error_over_noise != found.test.error_over_noise  # NaN is handed on, not hidden


def test_a_law_whose_predictions_diverge_on_the_hold_out_is_no_name(tmp_path, monkeypatch):
    """Windows that diverge count against it, and its intervals are as wide as they can be."""
    from optid.diagnosis import evaluation

    windows = evaluation.predict_windows

    def diverges(objective, p, *given):
        out = windows(objective, p, *given)
        if any("." in one.name for one in objective.model.parameters):
            out.outputs[-50:] = np.nan
        return out

    monkeypatch.setattr(evaluation, "predict_windows", diverges)
    found = asked(tmp_path, dead_band)
    assert found.verdict is Verdict.UNEXPLAINED
    assert all(finding.effect is None for finding in found.findings)


def test_the_noise_of_the_hold_out_is_not_known_before_the_test(tmp_path, monkeypatch):
    """What is written into the rig file's channels, as the noise that decimation leaves, is of training recordings."""
    from optid.diagnosis import pipeline

    prepare, kept = pipeline.prepare, []

    def recorded(stated, recordings):
        found, thin = prepare(stated, recordings)
        kept.append((found, [one.name for one in recordings]))
        return found, thin

    monkeypatch.setattr(pipeline, "prepare", recorded)
    found = asked(tmp_path)
    (names,) = [names for made, names in kept if made is found.problem.rig and "held.csv" not in names]
    assert names == ["run1.csv", "run2.csv"]
    assert not any("held.csv" in names and len(names) > 1 for _, names in kept)


def test_a_diagnosis_that_died_goes_on_at_its_last_stage_with_the_same_answer(tmp_path, dead, monkeypatch):
    from optid.diagnosis import pipeline

    file = tmp_path / "checkpoint.json"

    def killed(*given):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(pipeline, "compare_alternatives", killed)
        asked(tmp_path, dead_band, checkpoint=file)
    assert file.is_file()

    def again(*given):
        raise AssertionError("a stage that is done runs again")

    monkeypatch.setattr(pipeline, "fit_base", again)
    monkeypatch.setattr(pipeline, "select", again)
    found = asked(tmp_path, dead_band, checkpoint=file)
    assert not file.exists()
    first, second = (diagnosis_document(one) for one in (dead, found))
    assert first == second


def test_a_checkpoint_of_other_recordings_is_not_gone_on_from(tmp_path, monkeypatch):
    from optid.diagnosis import pipeline

    file = tmp_path / "checkpoint.json"

    def killed(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr(pipeline, "select", killed)
    for concealed in (dead_band, lambda u: u):
        called = []
        real = pipeline.fit_base
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr(
                pipeline, "fit_base", lambda problem, real=real, c=called: c.append(1) or real(problem)
            )
            asked(tmp_path, concealed, checkpoint=file)
        assert called == [1]
