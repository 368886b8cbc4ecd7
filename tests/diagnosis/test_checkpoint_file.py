"""What a diagnosis kept is gone on from only if it is whole and all that decides is the same."""

import json
from dataclasses import replace
from types import MappingProxyType

import pytest

from optid.core.checkpoint import Checkpoint
from optid.core.parameter import Parameter
from optid.diagnosis.checkpoint import key_of
from optid.effects.effect import Effect
from optid.rigs.rigfile import read_rig
from tests.diagnosis.trolley import problem_of, recording, rig

STAGE = {"model": {"effects": [], "p": [0.1, 2.5], "level": -6.0}, "open_variance": [[1e-7]]}
SIZE = Parameter("size", "1", 0.1, "share lost", "a test", 0.0, (0.0, 1.0))


def loss(power):
    """An effect of a user's own; the same name whatever it does."""

    class Loss(Effect):
        name, sites, equation, parameters = "loss", ("drive.command",), "1", (SIZE,)
        strength, usual = MappingProxyType({"size": 0.05}), ({"size": 0.2},)
        law, says, depends_on, needs, source = (
            "u (1 - s)",
            "a loss of {size}",
            ("command",),
            "motion",
            "a test",
        )

        def apply(self, site, nominal, near, sheet):
            return nominal * (1 - sheet.param(SIZE)) ** power

    return Loss()


@pytest.fixture
def kept(tmp_path):
    one = Checkpoint(tmp_path / "kept.json", "key")
    one.save("base fit", STAGE)
    one.save("selection", {"rounds": []})
    return one


def test_stages_come_back_as_they_were(kept):
    assert kept.load("base fit") == STAGE
    assert kept.load("selection") == {"rounds": []}
    assert [path.name for path in kept.path.parent.iterdir()] == ["kept.json"]


@pytest.mark.parametrize("damage", ["digit", "half", "empty", "list", "deep", "no stages", "other schema"])
def test_one_that_was_damaged_counts_as_empty(kept, damage):
    text = kept.path.read_text()
    document = json.loads(text)
    made = {
        "digit": text.replace("2.5", "2.6"),
        "half": text[: len(text) // 2],
        "empty": "",
        "list": "[]",
        "deep": "[" * 100_000,
        "no stages": json.dumps({**document, "stages": []}),
        "other schema": json.dumps({**document, "schema": "optid.checkpoint/1"}),
    }
    kept.path.write_text(made[damage])
    assert kept.load("base fit") is None
    kept.save("base fit", STAGE)
    assert kept.load("base fit") == STAGE


def test_where_nothing_can_be_kept_nothing_is_left(tmp_path):
    (tmp_path / "kept.json").mkdir()
    one = Checkpoint(tmp_path / "kept.json", "key")
    one.save("base fit", STAGE)
    assert one.load("base fit") is None
    assert [path.name for path in tmp_path.iterdir()] == ["kept.json"]


def test_the_key_follows_what_decides(tmp_path):
    """The plant's program, its equations, effects by what they do, noise, values and recordings."""
    problem = problem_of(tmp_path, [recording(1, "run.csv", seconds=1.0)])
    key = key_of(problem)
    assert key_of(replace(problem, _questions={})) == key
    first, same = (key_of(replace(problem, own=(loss(1),))) for _ in range(2))
    others = [
        key_of(replace(problem, noise={"position": 1e-3})),
        key_of(replace(problem, train=(recording(2, "run.csv", seconds=1.0),))),
        first,
        key_of(replace(problem, own=(loss(2),))),
    ]
    plant = tmp_path / "plant.py"
    plant.write_text(plant.read_text().replace("s.param(GAIN) * u", "s.param(GAIN) * u * 0.5"))
    others.append(key_of(replace(problem, rig=read_rig(tmp_path / "trolley.toml"))))
    assert len({key, *others}) == 6
    assert first == same


def test_the_key_is_the_same_in_another_reading_of_the_same_files(tmp_path):
    train = [recording(1, "run.csv", seconds=1.0)]
    assert key_of(problem_of(tmp_path, train)) == key_of(
        replace(problem_of(tmp_path, train), rig=rig(tmp_path))
    )


def test_the_key_follows_optids_own_code(tmp_path, monkeypatch):
    from optid.diagnosis import checkpoint

    problem = problem_of(tmp_path, [recording(1, "run.csv", seconds=1.0)])
    key = key_of(problem)
    monkeypatch.setattr(checkpoint, "sources", lambda file: "other code")
    assert key_of(problem) != key
