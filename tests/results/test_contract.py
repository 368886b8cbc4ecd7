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
        ({"fit.json": '{"schema": "optid.fit/99"}'}, "optid.fit/99"),
        ({"plan.json": '{"schema": "optid.plan/1"}', "tables.npz": "no zip"}, "tables of a result"),
    ],
    ids=["none", "two", "cut", "list", "schema", "tables"],
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
