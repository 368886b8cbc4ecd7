"""Recordings rebuilt from symptoms that people in the field reported: told right, or refused with a cure.

They lie beside the checkout and are no part of the project; where they are absent this skips. What needs minutes (fits
and diagnoses of them) is left to their own tests.
"""

import numpy as np
import pytest
from click.testing import CliRunner

from optid import cli
from optid.core.readers import read_recording
from optid.errors import RecordingError
from optid.quality.quality import quality
from optid.rigs.rigfile import read_rig

READ = {  # case -> file, samples, words among its notes
    "01-mat-wide-matrix": ("run.mat", 4000, ""),
    "02-mat-to-file-rows": ("run.mat", 4000, ""),
    "04-mat73-strings": ("run.mat", 4000, ""),
    "06-german-date-column": ("run.csv", 2000, ""),
    "07-decimal-comma-after-rest": ("run.csv", 2000, ""),
    "08-ros-percent-header": ("run.csv", 2000, "times count from the first sample"),
    "12-plain-hdf5": ("run.h5", 4000, ""),
    "13-parquet-duration": ("run.parquet", 4000, ""),
    "15-tdms-start-offset": ("run.tdms", 7900, "50 ms"),
    "24-time-of-day-rollover": ("run.csv", 4000, "midnight"),
    "40-duplicate-unused-column": ("run.csv", 1000, ""),
    "42-iso-stamps": ("run.csv", 1000, ""),
    "45-mixed-rates-outer-join": ("run.csv", 4000, "every 10 rows (100 Hz)"),
}
REFUSED = {
    "10-twincat-scope": ("run.csv", r'TwinCAT Scope export.*line 13.*rate = "1000 Hz"'),
    "19-bursty-stamps": ("run.csv", r'bursts.*rate = "100 Hz"'),
}
REMARKED = {
    "18-stale-samples": ("run.csv", "repaired", "every 4th row"),
    "37-encoder-wrap": ("run.csv", "repaired", "2^16 steps"),
    "38-dropouts-to-zero": ("run.csv", "repaired", "exactly 0"),
    "46-inverted-polarity": ("run.csv", "polarity", "opposes command"),
    "52-hold-out-mostly-missing": ("mixed.csv.gz", "missing", "too few to fit"),
    "53-absurd-readings": ("steps.csv.gz", "repaired", "e+69"),
}


@pytest.fixture
def case(shared, monkeypatch):
    def enter(name):
        folder = shared / "cases" / name
        if not folder.is_dir():
            pytest.skip(f"{folder} is absent")
        monkeypatch.chdir(folder)
        return folder

    return enter


@pytest.mark.parametrize("name", READ)
def test_read_as_it_was_meant(name, case):
    folder = case(name)
    file, samples, words = READ[name]
    found = read_recording(folder / file, read_rig(folder / "rig.toml"))
    assert len(found) == samples
    assert found.duration == pytest.approx((samples - 1) * found.interval, rel=1e-6)
    assert np.isfinite(found["command"].values).all()
    assert words in " ".join(found.provenance.notes)


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_a_cure(name, case):
    folder = case(name)
    file, words = REFUSED[name]
    with pytest.raises(RecordingError, match=words):
        read_recording(folder / file, read_rig(folder / "rig.toml"))


@pytest.mark.parametrize("name", REMARKED)
def test_told_by_the_check(name, case):
    folder = case(name)
    file, kind, words = REMARKED[name]
    rig = read_rig(folder / "rig.toml")
    remarks = quality(read_recording(folder / file, rig), rig.model, rig.parameters)
    assert any(remark.kind == kind and words in remark.message for remark in remarks), remarks


def test_an_axis_against_its_command_is_refused_before_a_fit(case, tmp_path):
    case("46-inverted-polarity")
    result = CliRunner().invoke(cli.cli, ["fit", "rig.toml", "run.csv", "--out", str(tmp_path / "out")])
    assert result.exit_code == 1
    assert "opposes command" in result.stderr
    assert not (tmp_path / "out").exists()
