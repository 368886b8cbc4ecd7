"""Rivals come from the call or from what a diagnosis left open."""

import json
from pathlib import Path

import pytest

from optid.errors import InputError
from optid.experiments.rivals import MOST, from_diagnosis, named
from optid.rigs.rigfile import read_rig

DATA = Path(__file__).parents[2] / "data"


def diagnosis(folder, findings, not_testable=()):
    content = {
        "schema": "optid.diagnosis/1",
        "findings": [{"effect": e, "indistinguishable_from": others} for e, others in findings],
        "not_testable": [{"effect": name} for name in not_testable],
    }
    (folder / "diagnosis.json").write_text(json.dumps(content))
    return folder


def test_a_finding_comes_with_what_explains_as_well(tmp_path):
    folder = diagnosis(tmp_path, [("a", ["b", "c"]), (None, []), ("d", [])], ["e"])
    assert from_diagnosis(folder) == ("a", "b", "c", "d")
    assert from_diagnosis(folder / "diagnosis.json") == ("a", "b", "c", "d")


def test_where_nothing_is_alike_what_was_not_testable_comes_in(tmp_path):
    folder = diagnosis(tmp_path, [("a", [])], [f"n{k}" for k in range(9)])
    assert from_diagnosis(folder) == ("a", *(f"n{k}" for k in range(MOST - 1)))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (None, "no such file"),
        ("{", "cannot be read"),
        ("[]", "schema"),
        ('{"schema": "optid.fit/1"}', "optid.diagnosis/1"),
        ('{"schema": "optid.diagnosis/1"}', "findings"),
        (
            '{"schema": "optid.diagnosis/1", "findings": [{"effect": 3, "indistinguishable_from": []}], '
            '"not_testable": []}',
            "not a text",
        ),
        ('{"schema": "optid.diagnosis/1", "findings": [], "not_testable": []}', "nothing open"),
    ],
)
def test_no_diagnosis_is_refused(tmp_path, text, said):
    path = tmp_path / "diagnosis.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(InputError, match=said):
        from_diagnosis(path)


def test_names_are_looked_up_where_the_plant_takes_them(tmp_path):
    rig = read_rig(DATA / "bench.toml")
    assert [e.name for e in named(["valve_lag", "input_delay"], rig)] == ["valve_lag", "input_delay"]
    for names, said in (
        (["valve_lagg"], 'did you mean "valve_lag"'),
        (["valve_lag", "valve_lag"], "twice"),
        ([""], "empty"),
        (["overflow"], "takes no effect"),
    ):
        with pytest.raises(InputError, match=said):
            named(names, rig)
    with_lag = tmp_path / "lag.toml"
    with_lag.write_text((DATA / "bench.toml").read_text() + '\n[effects.valve_lag]\ntime_constant = "3 ms"\n')
    with pytest.raises(InputError, match=r"without \[effects.valve_lag\]"):
        named(["valve_lag"], read_rig(with_lag))
