"""Every mistake in a file is refused in one line that says where and what."""

import errno
from pathlib import Path

import pytest
from malformed import CASES, RIG, SOUND_RECORDING, SOUND_RIG, Case, make

from optid.core.readers import read_recording
from optid.errors import RecordingError, RigError
from optid.rigs.rigfile import read_rig


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_mistake_is_named(case, tmp_path):
    rig_path, recording_path = make(case, tmp_path)
    kind, culprit = (RigError, rig_path) if case.fault == "rig" else (RecordingError, recording_path)
    with pytest.raises(kind) as caught:
        read_recording(recording_path, read_rig(rig_path))
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 600
    assert message.startswith(f"{culprit}: ")
    for fragment in case.fragments:
        assert fragment in message


def test_names_are_unique():
    assert len({case.name for case in CASES}) == len(CASES) >= 60


def test_sound_files_pass(tmp_path):
    rig, recording = make(Case("sound", "none", (), SOUND_RIG, SOUND_RECORDING), tmp_path)
    assert len(read_recording(recording, read_rig(rig))) == 60


@pytest.mark.parametrize("file", ["bench.toml", "steps.csv"])
def test_no_permission_is_named(file, tmp_path, monkeypatch):
    rig, recording = make(Case("sound", "none", (), SOUND_RIG, SOUND_RECORDING), tmp_path)
    for way in ("read_bytes", "open"):
        real = getattr(Path, way)

        # The superuser may read everything, so permissions alone would not show it.
        def refuse(path, *arguments, real=real, **options):
            if path.name == file:
                raise PermissionError(errno.EACCES, "Permission denied", str(path))
            return real(path, *arguments, **options)

        monkeypatch.setattr(Path, way, refuse)
    with pytest.raises(RigError if file == "bench.toml" else RecordingError, match="no permission") as caught:
        read_recording(recording, read_rig(rig))
    assert file in str(caught.value)


def test_path_through_a_file_is_named(tmp_path):
    (tmp_path / "bench.toml").write_text(RIG)
    with pytest.raises(RigError, match="cannot be read"):
        read_rig(tmp_path / "bench.toml" / "inner.toml")
