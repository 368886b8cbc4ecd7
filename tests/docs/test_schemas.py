"""Every kind of document is what its schema file says, and a schema file says what it means."""

import copy
import json
from pathlib import Path

import pytest

import optid
from optid.live.results import SCHEMA as LIVE
from optid.results.loading import RESULTS
from tests.results.examples import MAKERS

jsonschema = pytest.importorskip("jsonschema")
FOLDER = Path(optid.__file__).parent / "results" / "schemas"
SCHEMAS = {
    content["properties"]["schema"]["const"]: content
    for content in (json.loads(path.read_text(encoding="utf-8")) for path in FOLDER.glob("*.schema.json"))
}


def validator(name):
    return jsonschema.Draft202012Validator(SCHEMAS[name])


def test_every_kind_has_a_schema_and_every_schema_is_sound():
    assert set(SCHEMAS) == {*(kind.SCHEMA for kind in RESULTS), LIVE}
    for content in SCHEMAS.values():
        jsonschema.Draft202012Validator.check_schema(content)


@pytest.mark.parametrize("kind", RESULTS, ids=lambda kind: kind.__name__)
def test_a_result_is_what_its_schema_says(kind):
    document = json.loads(json.dumps(MAKERS[kind]().to_dict()))
    assert [error.message for error in validator(kind.SCHEMA).iter_errors(document)] == []


@pytest.mark.parametrize("kind", RESULTS, ids=lambda kind: kind.__name__)
def test_a_schema_refuses_what_lacks_a_key_or_has_another_type(kind):
    document, check = MAKERS[kind]().to_dict(), validator(kind.SCHEMA)
    for key in SCHEMAS[kind.SCHEMA]["required"]:
        other = copy.deepcopy(document)
        del other[key]
        assert not check.is_valid(other), key
    for key in SCHEMAS[kind.SCHEMA]["properties"].keys() & document.keys() - {"identifiability"}:
        assert not check.is_valid({**document, key: object}), key
