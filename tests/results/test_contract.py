"""Every kind of result keeps the same promises: it tells, shows and saves itself, and comes back the same."""

import inspect
import json
import re

import pandas as pd
import pytest
from matplotlib.figure import Figure

import optid
from optid.errors import InputError
from optid.results.loading import RESULTS
from tests.results.examples import MAKERS

KINDS = pytest.mark.parametrize("kind", RESULTS, ids=lambda kind: kind.__name__)


@pytest.fixture
def result(kind):
    return MAKERS[kind]()


@KINDS
def test_it_tells_itself(result, kind):
    said = result.summary()
    assert said and "None" not in said and " um" not in said and "-0 " not in said
    assert said.splitlines()[0][:20] in repr(result)
    assert kind.__name__ in repr(result)
    frame = result.to_frame()
    assert isinstance(frame, pd.DataFrame) and len(frame.columns)


@KINDS
def test_its_document_is_json_with_a_schema_and_the_callers_own(result, kind):
    document = result.to_dict()
    assert document["schema"] == kind.SCHEMA
    assert json.loads(json.dumps(document, allow_nan=False)) == document
    document["schema"] = "another"
    next(value for value in document.values() if isinstance(value, (dict, list))).clear()
    assert result.to_dict() != document


@KINDS
def test_it_shows_itself(result, kind):
    figure = Figure()
    axes = figure.subplots()
    assert result.plot(axes) is axes
    assert axes.lines or axes.patches or axes.collections
    assert result.plot() is not axes
    assert "<svg" in result._repr_html_() and "<pre>" in result._repr_html_()


@KINDS
def test_it_comes_back_the_same(result, kind, tmp_path):
    place = result.save(tmp_path / "deep" / "out")
    assert {file.name for file in place.iterdir()} >= {kind.FILE, "report.html", *result.files}
    assert {file.name for file in place.iterdir()} >= set(result.written)
    back = optid.load(place)
    assert type(back) is kind
    assert back == result
    assert back.summary() == result.summary()
    assert optid.load(place / kind.FILE) == result
    again = back.save(tmp_path / "again")
    assert optid.load(again) == result


@KINDS
def test_another_number_is_another_result(result, kind):
    document = result.to_dict()
    document["version"] = "another"
    assert kind(document, result.tables, result.files) != result
    for name, frame in result.tables.items():
        other = frame.copy()
        column = other.columns[-1]
        other[column] = other[column].iloc[::-1].to_numpy() if len(set(other[column])) > 1 else None
        assert kind(result.document, {**result.tables, name: other}, result.files) != result


def test_all_kinds_are_public():
    assert all(getattr(optid, kind.__name__) is kind for kind in RESULTS)
    assert set(MAKERS) == set(RESULTS)


def test_public_docstrings():
    for name in optid.__all__:
        value = getattr(optid, name)
        if callable(value) and value.__module__.startswith("optid.api"):
            said = inspect.getdoc(value)
            for parameter in inspect.signature(value).parameters:
                assert re.search(rf"^{parameter} : .+\n    \S", said, re.MULTILINE), (name, parameter)
            assert "\nRaises\n------\n" in said, name


@pytest.mark.parametrize(
    ("files", "fragment"),
    [
        ({}, "no result"),
        ({"fit.json": "{}", "plan.json": "{}"}, "2 results"),
        ({"fit.json": "{"}, "cannot be read"),
        ({"fit.json": "[]"}, "a list"),
        ({"fit.json": "[" * 100_000}, "nested too deeply"),
        (
            {"fit.json": '{"schema": "optid.fit/99", "version": "9"}'},
            "optid.fit/99 is newer.*optid 9 wrote it",
        ),
        ({"fit.json": '{"schema": "optid.fit/1"}'}, "outcome: missing"),
        ({"plan.json": '{"schema": "optid.plan/1"}', "tables.npz": "no zip"}, "tables of a result"),
    ],
    ids=["none", "two", "cut", "list", "deep", "newer", "incomplete", "tables"],
)
def test_what_is_no_result_is_refused(files, fragment, tmp_path):
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=fragment):
        optid.load(tmp_path)


def test_a_pickle_is_not_opened(tmp_path):
    import numpy as np

    (tmp_path / "plan.json").write_text('{"schema": "optid.plan/1"}')
    np.savez(tmp_path / "tables.npz", **{"a|b": np.array([object()], dtype=object)}, allow_pickle=True)
    with pytest.raises(InputError):
        optid.load(tmp_path)


FIT = {
    "schema": "optid.fit/1",
    "outcome": "converged",
    "seconds": 3.0,
    "horizon": 0.5,
    "asked": ["mass"],
    "parameters": {"mass": {"value": 2.0, "unit": "kg", "ci95": [1.9, None], "start": 1.0}},
    "values": {"mass": 2.0},
    "process_noise": [1e-6],
    "train": {},
    "holdout": {},
    "not_identifiable": [],
    "at_bound": [],
    "ties": [],
    "profiles": {},
    "missed": [],
}


@pytest.fixture
def saved(tmp_path):
    place = MAKERS[optid.results.plan.PlanResult]().save(tmp_path / "out")
    return place, json.loads((place / "plan.json").read_text())


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d.pop("rivals"), "rivals: missing"),
        (lambda d: d.update(seconds="4"), 'seconds: found "4"; expected number'),
        (lambda d: d.update(seconds=True), "seconds: found true"),
    ],
    ids=["missing", "text", "truth"],
)
def test_a_result_that_is_not_whole_is_refused_by_its_field(change, said, saved):
    place, document = saved
    change(document)
    (place / "plan.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=said):
        optid.load(place)


def test_a_field_that_is_missing_is_named_when_it_is_asked_for(tmp_path):
    """Nothing but what a schema asks for is known to be there; whatever reads the rest says what it lacks."""
    place = tmp_path / "fit.json"
    whole = json.loads(json.dumps(FIT))
    place.write_text(json.dumps(whole))
    assert optid.load(place).parameters["mass"].start == 1.0
    del whole["parameters"]["mass"]["start"], whole["values"]
    place.write_text(json.dumps(whole))
    found = optid.load(place)
    for ask, field in (
        (lambda: found.parameters, "start"),
        (lambda: found.values, "values"),
        (lambda: found.covariance, "covariance"),
    ):
        with pytest.raises(InputError, match=f"^[^'].*{field}: missing"):
            ask()


def test_a_field_of_another_type_is_refused_at_once(tmp_path):
    (tmp_path / "fit.json").write_text(json.dumps({**FIT, "values": 3}))
    with pytest.raises(InputError, match="incomplete"):
        optid.load(tmp_path)


def test_an_older_schema_is_read(saved):
    place, document = saved
    (place / "plan.json").write_text(json.dumps({**document, "schema": "optid.plan/0"}))
    assert optid.load(place).document["schema"] == "optid.plan/0"
    assert type(optid.load(place / "plan.json")) is type(optid.load(place))


def test_saving_is_one_set_or_none(saved, monkeypatch):
    place, _ = saved
    result = optid.load(place)
    before = {path.name: path.read_bytes() for path in place.iterdir()}
    monkeypatch.setattr(type(result), "report", lambda self: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        type(result)({**result.document, "version": "another"}, result.tables, {}).save(place)
    assert {path.name: path.read_bytes() for path in place.iterdir()} == before
    told = json.loads(before["manifest.json"])
    assert set(told["files"]) == set(before) - {"manifest.json"}


def test_files_of_two_runs_are_refused(saved):
    place, _ = saved
    result = optid.load(place)
    old = (place / "plan.json").read_bytes()
    type(result)({**result.document, "version": "another"}, result.tables, result.files).save(place)
    assert optid.load(place).document["version"] == "another"
    (place / "plan.json").write_bytes(old)
    with pytest.raises(InputError, match=r"plan\.json: .*older than the results that manifest\.json"):
        optid.load(place)
