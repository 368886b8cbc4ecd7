"""A folder of results is replaced as a whole or not at all, and a reader is told what does not belong together."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from optid.core import resultset
from optid.core.resultset import COMMITTED, MANIFEST, commit, located, manifest, recover, staging, try_out
from optid.errors import InputError

FIT, TUNE = {"command": "optid fit bench.toml"}, {"command": "optid tune armax.json"}


def put(folder, facts, **files):
    staged = staging(folder)
    for name, text in files.items():
        (staged / name.replace("_", ".")).write_text(text)
    commit(folder, staged, facts)


def shown(folder):
    return {
        path.name: path.read_text() for path in folder.iterdir() if path.is_file() and path.name != MANIFEST
    }


def test_killed_at_every_file_operation_the_old_or_the_new_set_is_read_whole():
    program = Path(__file__).parents[1] / "killed.py"
    done = subprocess.run([sys.executable, program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    operations, faults = (int(word) for word in done.stdout.split()[-4::2])
    assert operations > 100
    assert faults == 0, done.stdout


def test_what_a_command_no_longer_writes_goes_and_what_others_wrote_stays(tmp_path):
    put(tmp_path, FIT, fit_json="1", rig_toml="1")
    put(tmp_path, TUNE, pid_json="1", pid_h="1")
    put(tmp_path, TUNE, pid_json="2")
    assert shown(tmp_path) == {"fit.json": "1", "rig.toml": "1", "pid.json": "2"}
    told = manifest(tmp_path)
    assert set(told["files"]) == {"pid.json"}
    assert set(told["earlier"]) == {"fit.json", "rig.toml"}


def test_what_was_changed_by_hand_is_not_removed(tmp_path):
    put(tmp_path, TUNE, pid_json="1", pid_h="1")
    (tmp_path / "pid.h").write_text("my own")
    put(tmp_path, TUNE, pid_json="2")
    assert shown(tmp_path) == {"pid.json": "2", "pid.h": "my own"}


def test_a_folder_that_refuses_half_way_holds_the_old_set(tmp_path, monkeypatch):
    put(tmp_path, FIT, a_json="old", b_json="old")
    real, moved = Path.replace, []

    def replace(self, target):
        if self.parent.name == COMMITTED:
            if moved:
                raise OSError("the disk is gone")
            moved.append(self)
        return real(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises(OSError, match="gone"):
        put(tmp_path, FIT, a_json="new", b_json="new", c_json="new")
    assert moved
    assert shown(tmp_path) == {"a.json": "old", "b.json": "old"}


def test_a_file_of_another_set_is_refused_by_name(tmp_path):
    put(tmp_path, FIT, fit_json="old")
    put(tmp_path, FIT, fit_json="new")
    assert located(tmp_path / "fit.json") == tmp_path / "fit.json"
    (tmp_path / "fit.json").write_text("old")
    with pytest.raises(InputError, match=r"fit\.json: .*manifest\.json.*run optid fit again"):
        located(tmp_path / "fit.json")
    (tmp_path / "fit.json").write_text("edited by hand")
    assert located(tmp_path / "fit.json") == tmp_path / "fit.json"


def test_a_damaged_manifest_stops_nobody(tmp_path):
    put(tmp_path, FIT, fit_json="old")
    for damage in ("", "[" * 10_000, "null", '{"schema": "optid.manifest/1"}', "\x00"):
        (tmp_path / MANIFEST).write_text(damage)
        assert located(tmp_path / "fit.json") == tmp_path / "fit.json"
    put(tmp_path, FIT, fit_json="new")
    assert shown(tmp_path) == {"fit.json": "new"}


def test_another_program_of_the_same_name_is_not_overwritten(tmp_path):
    (tmp_path / "axis.py").write_text("mine")
    with pytest.raises(FileExistsError):
        put(tmp_path, FIT, axis_py="of the rig")
    (tmp_path / "axis.py").write_text("of the rig")
    put(tmp_path, FIT, axis_py="of the rig")
    put(tmp_path, FIT, axis_py="of the rig, later")
    assert shown(tmp_path) == {"axis.py": "of the rig, later"}


def test_trying_out_leaves_nothing_and_recovering_removes_litter(tmp_path):
    try_out(tmp_path)
    assert list(tmp_path.iterdir()) == []
    (staging(tmp_path) / "half.json").write_text("{")
    (tmp_path / f"{resultset.STAGED}trial").write_text("x")
    (tmp_path / "mine.txt").write_text("mine")
    recover(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_digests_are_those_of_the_files(tmp_path):
    import hashlib

    put(tmp_path, FIT, fit_json="content")
    told = json.loads((tmp_path / MANIFEST).read_text())
    assert told["files"] == {"fit.json": hashlib.sha256(b"content").hexdigest()}
    assert told["command"] == FIT["command"]
