"""What changed since commissioning: numbers joined, suspects told, and the looks at a session's own log."""

import json
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from optid.effects import library
from optid.errors import InputError
from optid.live.commissioning import RIG_FILE, Commissioned, joined, read_since, sentence
from optid.live.following import SECONDS, ParameterMonitor, StretchEstimates, look
from optid.live.loop import Choices
from optid.live.windows import _beside
from optid.monitoring.one_step import Quantity
from optid.pid.controller import Gains
from optid.rigs.rigfile import read_rig


def of(value, sd=0.1, explained=0.1):
    return Quantity(value, sd, "N", explained)


def test_estimates_are_joined_by_their_weights_and_scatter_is_not_overlooked():
    mean, sd = joined([of(1.0, 0.1), of(1.4, 0.2)])
    assert mean == pytest.approx(1.08)
    assert sd == pytest.approx(0.2 / np.sqrt(5) * max(1.0, np.sqrt(0.16 / 0.05)))
    assert joined([of(1.0), of(1.0)])[1] == pytest.approx(0.1 / np.sqrt(2))


def test_noise_is_told_as_rarely_as_promised():
    rng = np.random.default_rng(5)
    since, told = Commissioned(RIG_FILE, {str(k): (0.0, 0.0, 0.0) for k in range(50)}), 0
    for _ in range(400):
        looks = [{str(k): of(rng.normal(0.0, 0.1)) for k in range(50)} for _ in range(4)]
        told += any(one.changed for one in since.compare(looks, {}))
    assert told <= 3  # 0.4 expected; more has a chance of 1e-3


def test_an_sd_from_three_simulated_rigs_raises_no_false_alarm():
    rng = np.random.default_rng(6)
    since, told = Commissioned(RIG_FILE, {str(k): (0.0, 0.0, 0.0) for k in range(50)}), 0
    for _ in range(400):
        sd = np.std(rng.normal(size=(4, 50, 3)), axis=2, ddof=1) * np.sqrt(4.0 / 3.0)
        off = rng.normal(size=(4, 50)) - np.mean(rng.normal(size=(4, 50, 3)), axis=2)
        looks = [{str(k): of(off[n, k], sd[n, k]) for k in range(50)} for n in range(4)]
        told += any(one.changed for one in since.compare(looks, {}))
    assert told <= 3  # 0.4 expected; more has a chance of 1e-3


def test_the_first_suspect_explains_most_and_can_be():
    since = Commissioned(
        RIG_FILE,
        dict.fromkeys(("sure.but_slight", "leak.area", "drag.negative", "quiet"), (0.0, 0.0, 0.0)),
    )
    look = {
        "sure.but_slight": of(5.0, 0.1, 0.001),
        "leak.area": of(2.0, 0.1, 0.3),
        "drag.negative": of(-2.0, 0.1, 0.5),
        "quiet": of(0.1, 0.1, 0.4),
    }
    found = since.compare([look, look], {"drag.negative": (0.0, 10.0)})
    assert [one.name for one in found if one.changed] == ["leak.area"]
    assert found[0].name == "leak.area"
    words = sentence(found, RIG_FILE, 40.0, "optid diagnose X")
    assert "Suspected" in words
    assert "leak, area 2 (1.86 to 2.14) N, then 0" in words
    assert words.endswith("next: optid diagnose X")
    calm = since.compare([{name: of(0.05) for name in look}] * 2, {})
    assert "no significant difference" in sentence(calm, RIG_FILE, 40.0, "")


def test_like_is_held_against_like(tmp_path):
    path = tmp_path / "live.json"
    row = {"name": "friction", "unit": "N", "now": 90.0, "sd": 1.0, "explained": 0.4}
    path.write_text(json.dumps({"followed": {"rows": [row]}}))
    since = read_since(path)
    same, other = (
        since.compare([{"friction": of(value, 1.0, 0.4)}] * 2, {})[0].changed for value in (91.0, 140.0)
    )
    assert (same, other) == (False, True)
    path.write_text(json.dumps({"followed": None}))
    with pytest.raises(InputError, match="a session that tracked"):
        read_since(path)


def test_it_says_something_once_and_says_why_not(tmp_path, monkeypatch):
    said = []
    plan = SimpleNamespace(rig=Path("rig.toml"), out=tmp_path, since=None, fast=True)
    following = ParameterMonitor(plan, 1000.0, said.append)
    (tmp_path / "recording.csv").write_text("t,u,x\n0,0,0\n")
    look = StretchEstimates({"f": of(9.0)}, {"f": 1.0}, {})
    answers = iter([None, "no motion", "no motion", look, look, look])
    monkeypatch.setattr(following._background, "begin", lambda *arguments: None)
    monkeypatch.setattr(following._background, "result", lambda: next(answers))
    for k in range(6):
        following.poll(25.0 * k)
    assert said[0] == "the parameters are not tracked: no motion"
    assert len(said) == 2
    assert said[1].startswith("Suspected, from the last 40 s beside the rig file: f 9 ")
    assert "optid diagnose rig.toml" in said[1]
    assert following.standing["rows"][0]["changed"]


@pytest.mark.parametrize("offset", [0.0, 0.02])
def test_a_valve_offset_is_suspected_and_a_sound_rig_is_not(bench, run_live, tmp_path, monkeypatch, offset):
    every = library.admitted
    some = ("valve_offset", "ambient_leakage", "cross_leakage", "valve_deadband", "stribeck_friction")
    # Five of 36: each costs a compiled model.
    monkeypatch.setattr(library, "admitted", lambda model: [e for e in every(model) if e.name in some])
    real, session = tmp_path / "real.toml", tmp_path / "rig.toml"
    effect = f"\n[effects.valve_offset]\noffset = {offset}\n"
    real.write_text(bench.source + effect * bool(offset), encoding="utf-8")
    session.write_text(f'{bench.source}\n[live]\nrate = "250 Hz"\n[live.simulated]\nrig = "{real}"\n')
    _, _, path = run_live(read_rig(session), seconds=SECONDS, choices=Choices(Gains(25.0)))
    path.rename(tmp_path / "recording.csv")
    found = look(SimpleNamespace(rig=session, out=tmp_path), 250.0)
    since = Commissioned(RIG_FILE, {name: (value, 0.0, 0.0) for name, value in found.stated.items()})
    told = [one for one in since.compare([found.found] * 4, found.bounds) if one.changed]
    assert [one.name for one in told[:1]] == ["valve_offset.offset"] * bool(offset)
    assert all(one.now == pytest.approx(offset, abs=3 * one.sd) for one in told[:1])


def test_what_a_rig_as_stated_shows_too_is_no_change():
    same = [of(value, 0.01, share) for value, share in ((3.8, 0.1), (4.0, 0.3), (4.2, 0.2))]
    found = _beside(of(5.0, 0.1, 0.35), same, 1.0)
    assert found.value == pytest.approx(2.0)  # 1 more than they show, beside what is stated
    assert found.sd == pytest.approx(0.2 * math.sqrt(4 / 3))  # their scatter, which is more than it claims
    assert found.explained == pytest.approx(0.05)
    assert _beside(of(4.0, 0.5, 0.2), same, 1.0).sd == pytest.approx(0.5 * math.sqrt(4 / 3))
    assert _beside(of(4.0, 0.5, 0.2), same, 1.0).explained == 0.0
