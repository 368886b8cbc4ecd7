"""optid's own JSON files: whatever stands in them, the answer is a value or one line that names file and field."""

import json
import os

import pytest

from optid.core.document import (
    finite,
    optional_document,
    parsed_toml,
    read_bounded,
    read_document,
    whole,
)
from optid.errors import InputError

SCHEMA = "optid.fit/2"


def read(tmp_path, content):
    path = tmp_path / "fit.json"
    path.write_bytes(content if isinstance(content, bytes) else json.dumps(content).encode())
    return read_document(path, SCHEMA, "a file of `optid fit`")


@pytest.mark.parametrize("schema", ["optid.fit/1", "optid.fit/2"])
def test_the_same_and_older_schemas_are_read(tmp_path, schema):
    assert read(tmp_path, {"schema": schema})["schema"] == schema


def test_a_newer_schema_is_refused_by_name(tmp_path):
    with pytest.raises(InputError, match=r"fit\.json: schema: optid\.fit/3 is newer.*0\.9.*upgrade"):
        read(tmp_path, {"schema": "optid.fit/3", "version": "0.9"})


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"{",
        b"[1]",
        b"\xff\xfe",
        b"\x00" * 100,
        b"[" * 200_000,
        b'{"a":' * 100_000,
        b"1e999",
        b"nul",
        b'{"schema": NaN}',
        b'{"schema": 3}',
        b'{"schema": "optid.pid/1"}',
        b'{"schema": "optid.fit/1x"}',
        b"9" * 5000,
        b'{"schema": "optid.fit/' + b"9" * 5000 + b'"}',
        {},
        None,
    ],
    ids=range(17),
)  # the ids would be longer than the names of files may be
def test_anything_else_is_refused_in_one_line(tmp_path, content):
    with pytest.raises(InputError) as caught:
        read(tmp_path, content)
    assert str(caught.value).startswith(f"{tmp_path / 'fit.json'}: ")
    assert len(str(caught.value)) < 1300


def test_no_more_is_read_than_asked_for():
    with pytest.raises(ValueError, match="larger than 1000 bytes"):
        read_bounded(os_path("/dev/zero"), 1000)


def os_path(name):
    from pathlib import Path

    if not os.path.exists(name):  # noqa: PTH110
        pytest.skip("no such device here")
    return Path(name)


@pytest.mark.parametrize("value", ["1", True, None, [1.0], float("inf"), float("nan"), 1e101, 10**400])
def test_what_is_no_number_of_an_axis_is_refused(value):
    with pytest.raises(InputError, match=r"gains\.kp"):
        finite(value, "gains.kp", "pid.json")


@pytest.mark.parametrize("value", [-1, 10_001, 1.5, "3", False, 10**30])
def test_what_is_no_count_is_refused(value):
    with pytest.raises(InputError, match="nk"):
        whole(value, "nk", "armax.json")


def test_numbers_pass():
    assert finite(3, "x") == 3.0
    assert whole(4, "x") == 4


@pytest.mark.parametrize("text", ["[" * 100_000, "[]", "{", "\xff"])
def test_a_document_that_may_be_there_is_none_where_it_is_nothing(text, tmp_path):
    (tmp_path / "fit.json").write_text(text, encoding="latin-1")
    assert optional_document(tmp_path / "fit.json") is None
    assert optional_document(tmp_path / "absent.json") is None
    (tmp_path / "fit.json").write_text('{"a": 1}')
    assert optional_document(tmp_path / "fit.json") == {"a": 1}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a" + ".a" * 50 + " = 1", r"more than 32 parts \(line 1\)"),
        ("x = 1\n[a" + ' . "b c"' * 50 + "]", r"line 2"),
        ("x = 1\n[a" + " . 'b.c'" * 50 + "]", r"line 2"),
        ("a = " + "[" * 50_000, "nested too deeply"),
        ("a = " + "{a = " * 50_000, "nested too deeply"),
    ],
)
def test_tables_nested_beyond_reason_are_refused_at_once(text, said):
    with pytest.raises(ValueError, match=said):
        parsed_toml(text)


def test_tables_of_a_rig_pass():
    words = ". ".join(["Beside the rod"] * 40)
    text = f'# {words}\nname = "{words}"\nlevels = [{", ".join(["0.5"] * 200)}]\n' + "".join(
        f"[a.b{k}]\nv1.2 = 3\n" for k in range(50)
    )
    assert parsed_toml(text)["name"] == words
