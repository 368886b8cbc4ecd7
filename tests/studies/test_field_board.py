"""The field board: its table is whole, and answers are scored as engineers would; nothing is diagnosed here."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from optid.effects.library import find_effect
from studies import field_board
from studies.field.page import write_board
from studies.field.scoring import Answer, diagnosed, score
from studies.field.table import read_table

ROWS = {row.name: row for row in read_table()}
SEAL, SILVERBOX = ROWS["seal-0.3mm"], ROWS["silverbox-mechanical"]
SLOPE = "pressure_dependent_friction.per_pressure"


def told(*names, verdict="missing-physics", suspected=(), doubts=(), **values):
    return Answer(verdict, names, suspected, {SLOPE: (1.6e-5, "N/Pa"), **values}, doubts)


def test_every_row_says_what_is_true_who_says_so_and_what_is_accepted():
    assert len(ROWS) == len(read_table())
    for row in ROWS.values():
        assert row.truth and row.source and row.accept and row.train, row.name
        assert row.holdout or row.command == "fit", row.name
        for pattern in (*row.accept, *row.tolerate):
            assert not row.reject & (pattern.names | pattern.beside), row.name


def test_every_name_of_the_table_can_be_told():
    later = {"hardening_spring", "transmission_backlash", "transmission_compliance", "cogging"}
    for row in ROWS.values():
        patterns = (*row.accept, *row.tolerate)
        for name in row.reject.union(*(one.names | one.beside for one in patterns)) - later - {"*"}:
            assert find_effect(name, Path()), name


@pytest.mark.parametrize(
    ("answer", "expected"),
    [
        (told("pressure_dependent_friction"), "accept"),
        (told("pressure_dependent_friction", "presliding"), "accept"),
        (told("pressure_dependent_friction", "stribeck_friction"), "tolerate"),
        (told("pressure_dependent_friction", "sensor_drift"), "reject"),
        (told("pressure_dependent_friction", **{SLOPE: (2.0e-5, "N/Pa")}), "tolerate"),
        (told("pressure_dependent_friction", **{SLOPE: (3.0e-5, "N/Pa")}), "reject"),
        (told("pressure_dependent_friction", doubts=("p = 0.5",)), "tolerate"),
        (told("stribeck_friction"), "reject"),
        (told(verdict="consistent"), "reject"),
        (told(verdict="unexplained", suspected=("pressure_dependent_friction", "sensor_lag")), "tolerate"),
        (told(verdict="unexplained", suspected=("sensor_lag",)), "none"),
        (told(verdict="unexplained"), "none"),
        (Answer(""), "none"),
    ],
)
def test_an_answer_is_scored_as_the_table_has_it(answer, expected):
    assert score(SEAL, answer) == expected


def test_a_kind_stands_for_it_at_any_site_and_a_site_for_itself():
    assert score(SILVERBOX, told("hardening_spring@force.spring")) == "accept"
    assert score(SILVERBOX, told("power_law@drive.command")) == "reject"
    assert score(SILVERBOX, told("hardening_spring@force.spring", "delay@force.spring")) == "reject"


def test_a_size_without_a_sign_counts_either_way():
    name = "asymmetric_friction.viscous_asymmetry"
    for value, expected in ((0.18, "accept"), (-0.18, "accept"), (-0.6, "tolerate")):
        assert score(ROWS["emps"], told("asymmetric_friction", **{name: (value, "1")})) == expected


def document(low, p):
    size = {"value": 1.6e-5, "unit": "N/Pa", "ci95": [low, 2e-5]}
    finding = {
        "effect": "pressure_dependent_friction",
        "parameters": {"per_pressure": size},
        "evidence": {"p_value": p},
        "suspected": [],
    }
    return {"verdict": "missing-physics", "findings": [finding]}


def test_a_name_that_contradicts_itself_is_no_more_than_tolerated():
    assert score(SEAL, diagnosed(document(1.2e-5, 1e-4))) == "accept"
    assert score(SEAL, diagnosed(document(0.0, 1e-4))) == "tolerate"  # the interval holds the null
    assert score(SEAL, diagnosed(document(1.2e-5, 0.2))) == "tolerate"


def test_the_board_tells_what_was_refused_and_counts(tmp_path):
    folder = tmp_path / SEAL.name
    folder.mkdir()
    ran = {"status": 2, "seconds": 1.2, "said": "", "error": "optid: unfit\nmore"}
    (folder / "run.json").write_text(json.dumps(ran))
    write_board([SEAL, SILVERBOX], tmp_path)
    (entry,) = json.loads((tmp_path / "board.json").read_text())
    assert entry["score"] == "none" and entry["told"] == "refused (status 2): optid: unfit"
    assert "none 1 of 2 rows" in (tmp_path / "board.md").read_text()
    assert "<td>refused (status 2): optid: unfit</td>" in (tmp_path / "board.html").read_text()


def test_a_row_that_was_answered_is_not_run_again(tmp_path, monkeypatch):
    (tmp_path / "run.json").write_text("{}")
    monkeypatch.setattr(field_board.subprocess, "run", lambda *a, **k: pytest.fail("was run"))
    field_board.run(SEAL, tmp_path, 1.0)


def test_a_stated_length_makes_a_rig_file_of_its_own(shared, tmp_path):
    row = replace(SEAL, parameters={"presliding_length": "2 mm"})
    text = field_board.rig_file(row, tmp_path).read_text()
    assert 'presliding_length = "2 mm"' in text
    assert f'model = "{shared}/recordings/seal_friction/seal.py:seal"' in text


def test_without_the_recordings_it_says_so(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(field_board, "RECORDINGS", tmp_path / "absent")
    monkeypatch.setattr(sys, "argv", ["field_board.py", str(tmp_path)])
    assert field_board.main() == 1
    assert "skipped" in capsys.readouterr().out
