"""The blind trial on other axes: what is drawn, what it is called, how it counts."""

import json

import numpy as np
import pytest

from optid.core.sheet import build
from optid.effects.library import admitted
from optid.rigs import find_plant
from optid.rigs.rigfile import read_rig
from studies.trial.case import SIZES
from studies.trial.other_axes import DATA, Concealed, Judged, compose, judged, score, shows
from studies.trial.other_names import BOARDS
from studies.trial.seal import seal
from studies.trial.sizes import Draw


@pytest.mark.parametrize("plant", BOARDS)
def test_names_are_the_plants_and_what_has_none_is_outside(plant):
    board = BOARDS[plant]
    rig = read_rig(DATA / board.file)
    names = {effect.name: effect for effect in admitted(build(find_plant(plant, DATA), **rig.options))}
    assert len(board.named) >= 15 and len(board.outside) >= 5
    assert set(board.named) <= set(names)
    assert set(board.outside).isdisjoint(names)
    for name, (site, _) in board.named.items():
        assert names[name].site.partition(".")[0] == site, name


@pytest.mark.parametrize("plant", BOARDS)
def test_every_size_sets_fields_that_the_rig_has(plant):
    board = BOARDS[plant]
    for site, fields in (*board.named.values(), *board.outside.values()):
        for size in SIZES:
            made = fields(Draw(size, np.random.default_rng(1)))
            assert made and board.rig._replace(**made) != board.rig
            assert site


def test_a_draw_is_the_same_whichever_part_is_taken_and_has_every_name_once_before_one_twice():
    board = BOARDS["rotary-axis"]
    whole = compose(board, 5, 60, ("nothing", "single", "pair", "outside"))
    assert whole == compose(board, 5, 60, ("nothing", "single", "pair", "outside"))
    kinds = [case.kind for case in whole]
    assert (kinds.count("nothing"), kinds.count("single"), kinds.count("outside")) == (15, 36, 9)
    assert {case.effect for case in whole if case.kind == "single"} == set(board.named)


def left(place, verdict, *findings):
    place.mkdir(parents=True)
    (place / "run.json").write_text("{}")
    found = [{"effect": effect, "site": site} for effect, site in findings]
    (place / "diagnosis.json").write_text(json.dumps({"verdict": verdict, "findings": found}))


def test_what_a_diagnosis_says_is_counted(tmp_path):
    cases = [
        Concealed("case-001", "single", "cogging", "drive", "large", {}, 1),
        Concealed("case-002", "nothing", "", "", "small", {}, 2),
        Concealed("case-003", "outside", "flow_force", "valve", "large", {}, 3),
        Concealed("case-004", "single", "cogging", "drive", "large", {}, 4),
    ]
    left(tmp_path / "case-001/diagnose", "missing-physics", ("cogging", "drive"))
    left(tmp_path / "case-002/diagnose", "missing-physics", ("sensor_lag", "sensor"))
    left(tmp_path / "case-003/diagnose", "unexplained", (None, "valve"))
    assert [judged(case, tmp_path / case.name / "diagnose").right for case in cases[:3]] == [
        True,
        False,
        True,
    ]
    assert judged(cases[3], tmp_path / "case-004/diagnose") is None
    for site, right in (("flow", True), ("force", False)):
        left(tmp_path / f"flow-force-at-{site}", "unexplained", (None, site))
        assert judged(cases[2], tmp_path / f"flow-force-at-{site}").right is right
    key, digest = seal({"cases": [vars(case) for case in cases]}, tmp_path / "answers.sealed")
    (tmp_path / "cases.json").write_text(json.dumps({"answers_sha256": digest, "plant": "rotary-axis"}))
    text = score(tmp_path, key, "diagnose")
    assert "first name right            1/1" in text and "nothing named             0/1" in text


def test_silence_is_right_where_no_recording_shows_the_physics():
    """Friction that grows at rest does nothing to an axis that hardly rests; a coil's heat does."""
    board = BOARDS["rotary-axis"]
    hidden = Concealed("case-001", "outside", "dwell_friction", "force", "small", {"dwell_gain": 1e-4}, 1)
    seen = Concealed("case-002", "outside", "copper_warming", "drive", "large", {"warming": 0.4}, 1)
    assert not shows(board, hidden, 2.0) and shows(board, seen, 2.0)
    assert Judged(hidden, "consistent", (), (), shown=False).right
    assert not Judged(hidden, "unexplained", (), ("force",), shown=False).right
    assert not Judged(seen, "consistent", (), ()).right
