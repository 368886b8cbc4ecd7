"""What a diagnosis says agrees with the figures beside it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from optid.diagnosis import findings
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.evaluation import Evaluation
from optid.diagnosis.localisation.region import Range
from optid.diagnosis.result import Finding, Suspicion
from optid.diagnosis.summary import (
    _nearest,
    _nothing_more,
    _start_uncertainty,
    _unexplained,
    _what_errs,
    _when,
    _where,
)
from optid.diagnosis.validation import Validated
from optid.estimation.result import Score
from optid.report.diagnosis_document import range_entry


def diagnosis(p, strongest="sensor_backlash"):
    model = strongest and SimpleNamespace(effects=(SimpleNamespace(name=strongest),))
    return SimpleNamespace(
        path=SimpleNamespace(strongest=model),
        test=SimpleNamespace(p_value=p, level=0.01),
        rejected=(
            (strongest, "cross-validated, the error of the windows falls by 2.0 %: too little to matter"),
        ),
    )


def test_what_the_hold_out_prefers_is_never_said_to_improve_nothing():
    """A small backlash below the noise: the test sees it, and 2 % of the error are not worth a name."""
    told = _nothing_more(diagnosis(6e-4))
    assert told.startswith("Sensor backlash predicts better (p = 0.0006), but too little to be named: ")
    assert "falls by 2.0 %" in told


@pytest.mark.parametrize("found", [diagnosis(0.2), diagnosis(1.0, strongest=None)])
def test_what_chance_explains_is_no_improvement(found):
    assert _nothing_more(found).startswith("No effect of the catalogue improves it (p = ")


def test_where_is_told_from_the_law_or_where_it_tells_something():
    law = Range(-0.05, 0.05, "m/s", 0.94, 0.73, by_law=True)
    assert _where("velocity", law) == " It acts at velocity from -50 mm/s to 50 mm/s."
    dense = _where("pressure_a", Range(3e5, 4e5, "Pa", 0.8, 0.4))
    assert dense == " 80 % of the mismatch lies at pressure a from 3 bar to 4 bar, and 40 % of the samples."
    assert _where("pressure_a", Range(3e5, 4e5, "Pa", 0.81, 0.75)) == ""


def named(always, **ranges):
    region = SimpleNamespace(states=ranges, always=always)
    return SimpleNamespace(effect=SimpleNamespace(name="cross_leakage"), region=region, shown=tuple(ranges))


def test_what_acts_all_the_time_is_said_to_unless_its_law_has_a_range():
    ranged = Range(-0.05, 0.05, "m/s", 0.94, 0.73, by_law=True)
    assert _when(named(True)) == " It acts all the time."
    assert _when(named(True, velocity=Range(0.0, 1.0, "m/s", 0.9, 0.2))) == " It acts all the time."
    assert _when(named(True, velocity=ranged)) == ""
    assert _when(named(False)) == ""


@pytest.mark.parametrize("by_law", [True, False])
def test_the_document_says_whose_range_it_is(by_law):
    told = range_entry(Range(-0.05, 0.05, "m/s", 0.94, 0.73, by_law))
    assert told == {
        "low": -0.05,
        "high": 0.05,
        "unit": "m/s",
        "share_of_mismatch": 0.94,
        "share_of_samples": 0.73,
        "by_law": by_law,
    }


@pytest.mark.parametrize(
    ("left", "why", "told"),
    [
        (
            0.81,
            "chance (p = 0.2)",
            " Of the catalogue overflow comes nearest, 10 % less error; not proven: chance (p = 0.2).",
        ),
        (0.99, "chance (p = 0.2)", ""),
        (0.81, "", ""),
    ],
)
def test_where_nothing_is_proven_the_nearest_law_is_told_with_what_it_lacks(left, why, told):
    contender = SimpleNamespace(
        effect=SimpleNamespace(name="overflow"), validated=Validated(np.full((20, 1), left)), why=why
    )
    path = SimpleNamespace(
        nearest=contender, first=Validated(np.ones((20, 1))), best=SimpleNamespace(effects=())
    )
    d = SimpleNamespace(path=path, problem=SimpleNamespace(criteria=SimpleNamespace(smallest_gain=0.04)))
    assert _nearest(d) == told


@pytest.mark.parametrize(
    ("held_out", "told"), [(0.99, "those held out do not show"), (4.0, "held out, windows")]
)
def test_what_only_the_recordings_to_fit_contain_is_not_laid_on_those_held_out(held_out, told):
    scores = {"position": SimpleNamespace(rmse=held_out * 20e-6, unit="m")}
    base = SimpleNamespace(error_over_noise=lambda noise: held_out, scores=scores)
    outputs = (SimpleNamespace(role="position", unit="m"),)
    d = SimpleNamespace(
        path=SimpleNamespace(first=SimpleNamespace(error_over_noise=1.51)),
        problem=SimpleNamespace(criteria=SimpleNamespace(error_over_noise=1.2)),
        test=SimpleNamespace(base=base),
        noise={"position": 20e-6},
        best=SimpleNamespace(rig=SimpleNamespace(model=SimpleNamespace(outputs=outputs))),
    )
    said = _what_errs(d)
    assert told in said
    assert ("1.5 times the noise" in said) == (held_out < 1.2)


def at(site):
    return SimpleNamespace(site=site, sites=(site,))


def test_sites_that_the_recordings_do_not_tell_apart_are_all_told(monkeypatch):
    """A drive whose command is a torque: a mismatch in either place looks the same."""

    def finding(s, signal, described, words, suspects):
        return SimpleNamespace(
            effect=None,
            site=findings.kind_of(signal.site),
            sentence=words,
            shown=(),
            indistinguishable=(),
            region=None,
            suspected=suspects,
        )

    monkeypatch.setattr(findings, "_unexplained_finding", finding)
    monkeypatch.setattr(findings, "_at_all_samples", lambda s, one: one)
    sites = tuple(map(at, ("force.external", "force.gear", "drive.command", "sensor.position")))
    surrogate = SimpleNamespace(contender=None, sites=sites, likely=sites[:3], at=lambda site: sites[0])
    found = findings.unexplained_findings(
        SimpleNamespace(surrogate=surrogate, best=SimpleNamespace(effects=()), names=False), ()
    )
    assert [one.site for one in found] == ["force", "drive"]
    monkeypatch.setattr("optid.diagnosis.summary._what_errs", lambda d: "Something errs.")
    monkeypatch.setattr("optid.diagnosis.summary._nearest", lambda d: "")
    assert _unexplained(SimpleNamespace(findings=found, best=None, base=None)) == (
        "Something errs. Not explained at the force: an unknown signal at force.external explains the recordings best; "
        "force.gear would do nearly as well. Or at the drive: an unknown signal at drive.command explains the "
        "recordings as well."
    )


@pytest.mark.parametrize(("kind", "told"), [("sensor", "an unknown signal"), ("force", "it could be")])
def test_a_suspected_effect_is_told_where_the_unknown_signal_lies_too(monkeypatch, kind, told):
    def finding(site, words):
        return Finding(None, site, site, (), None, (), None, 0.0, 0.0, (), words, ())

    located, one = at("force.external"), Suspicion("bent", "unproven")
    monkeypatch.setattr(
        findings,
        "_unexplained_finding",
        lambda s, signal, law, words, doubts: replace(
            finding(findings.kind_of(signal.site), words), suspected=doubts
        ),
    )
    monkeypatch.setattr(findings, "_at_all_samples", lambda s, one: one)
    monkeypatch.setattr(
        findings,
        "_suspected",
        lambda s, effect, one: replace(finding(effect.site, "it could be"), suspected=(one,)),
    )
    likely = (located, at("drive.command"))
    surrogate = SimpleNamespace(contender=None, sites=likely, likely=likely, at=lambda site: located)
    effects = (SimpleNamespace(name="bent", site=kind, sites=(kind,)),)
    found, other = findings.unexplained_findings(
        SimpleNamespace(surrogate=surrogate, best=SimpleNamespace(effects=effects), names=True), (one,)
    )
    assert found.site == "force" and found.sentence.startswith(told)
    assert found.suspected == (one,)
    assert other.site == "drive" and other.sentence.endswith("as well")


@pytest.mark.parametrize("law", ["a description", "an effect"])
def test_a_suspected_effect_is_no_empirical_description(monkeypatch, law):
    monkeypatch.setattr("optid.diagnosis.summary._what_errs", lambda d: "Something errs.")
    monkeypatch.setattr("optid.diagnosis.summary._nearest", lambda d: "")
    monkeypatch.setattr("optid.diagnosis.summary.Description", str)
    best = SimpleNamespace(effects=("a curve",) if law == "a description" else (1,))
    score = SimpleNamespace(rmse=0.0277, unit="rad")
    test = SimpleNamespace(best=SimpleNamespace(scores={"position": score}))
    told = _unexplained(SimpleNamespace(findings=(), best=best, base=None, test=test))
    assert ("With an empirical description" in told) == (law == "a description")
    assert ("With what is suspected, windows have an error of 0.0277 rad." in told) == (law == "an effect")


@pytest.mark.parametrize(
    ("errs", "told"),
    [
        (3.1e-5, ""),
        (4.5e-5, ", and as the windows' starts are not known exactly, a correct model errs by 50 µm"),
    ],
)
def test_errors_above_the_noise_of_a_sound_model_are_accounted_for(errs, told):
    measured, off = np.zeros((400, 1)), np.full((400, 1), errs)
    scores = {"position": Score.of(measured[:, 0], off[:, 0], "m")}
    blocks = np.arange(400) // 20
    base = Evaluation(
        0.5, blocks, off, off, measured, np.arange(400.0), blocks * 0, scores, np.full((400, 1), 4e-5)
    )
    assert (
        _start_uncertainty(
            SimpleNamespace(
                test=SimpleNamespace(base=base),
                noise={"position": 3e-5},
                problem=SimpleNamespace(criteria=Criteria()),
            )
        )
        == told
    )
