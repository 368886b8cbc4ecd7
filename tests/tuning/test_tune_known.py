"""What lies beside a rig file is taken for a fit of it only as far as it is one."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from optid.rigs.rigfile import read_rig
from optid.tuning.known import fitted

DATA = Path(__file__).resolve().parents[2] / "data"


def beside(folder, ci95, text=None):
    """Is this fit.json taken for the bench's own?"""
    rig = replace(read_rig(DATA / "bench.toml"), path=folder / "rig.toml")
    value = rig.parameters["viscous_friction"]
    document = {"schema": "optid.fit/1", "parameters": {"viscous_friction": {"value": value, "ci95": ci95}}}
    (folder / "fit.json").write_text(json.dumps(document) if text is None else text)
    return fitted(rig)


@pytest.mark.parametrize("ci95", [[70.0, 90.0], [None, 90.0], [70.0, None]])
def test_an_interval_of_the_same_value_is_a_fit(ci95, tmp_path):
    assert beside(tmp_path, ci95)


@pytest.mark.parametrize(
    "ci95", [None, [], "ab", 3, {"low": 1}, [None, None], ["a", "b"], [10**400, 10**400]]
)
def test_what_is_no_interval_is_none(ci95, tmp_path):
    assert not beside(tmp_path, ci95)


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "{", "[]", "null", '{"schema": "optid.fit/1", "parameters": 3}']
)
def test_what_is_no_document_is_none(text, tmp_path):
    assert not beside(tmp_path, None, text)
