"""What a call that was cut short has kept is gone on from only by the same work: same code, inputs and programs."""

import click
import pytest

from optid.cli import checkpoint as module
from optid.cli.checkpoint import checkpoint
from optid.cli.run import begun, note_inputs

RIG = """
model = "axis.py:axis"
[effects."pull.py:Pull"]
"""


@pytest.fixture
def kept(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    files = {
        "rig.toml": RIG,
        "axis.py": "x = 1",
        "pull.py": "y = 1",
        "run.csv": "t,u\n0,1\n",
        "more.py": "z = 1",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text)

    def call(folder="out", resume=True):
        """A call's checkpoint, which it leaves written."""
        context = click.Context(click.Command("diagnose"))
        context.params = {"rig": str(tmp_path / "rig.toml"), "recordings": (str(tmp_path / "run.csv"),)}
        context.params["effects"] = (str(tmp_path / "more.py"),)
        with begun(["diagnose"]):
            note_inputs(context)
            path = checkpoint(tmp_path / folder, resume)
        fresh = not path.exists()
        path.write_text("{}")
        return fresh

    return call


def test_the_same_call_goes_on_and_another_folder_does_not(kept):
    assert kept()
    assert not kept()
    assert kept("other")
    assert not kept()
    assert kept(resume=False)


@pytest.mark.parametrize("name", ["rig.toml", "axis.py", "pull.py", "more.py", "run.csv"])
def test_what_was_edited_since_begins_anew(name, kept, tmp_path):
    assert kept()
    (tmp_path / name).write_text((tmp_path / name).read_text() + "\n# edited")
    assert kept()
    assert len(list((tmp_path / "cache" / "optid" / "fits").iterdir())) == 1


def test_another_version_of_optid_begins_anew(kept, monkeypatch):
    assert kept()
    monkeypatch.setattr(module, "sources", lambda file: "other code")
    assert kept()
