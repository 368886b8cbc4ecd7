"""Every format gives the same recording, and the quirks of real files do no harm."""

import gzip

import numpy as np
import pytest
from malformed import RIG, lines, mat, mat73, parquet, table, tdms, vectors

from optid.core.readers import read_recording, read_table
from optid.core.recording import ChannelMap
from optid.errors import RecordingError
from optid.rigs.rigfile import read_rig

CSV = "\n".join(lines()) + "\n"


@pytest.fixture
def rig(tmp_path):
    (tmp_path / "rig.toml").write_text(RIG)
    return read_rig(tmp_path / "rig.toml")


def read(tmp_path, rig, name, content):
    (tmp_path / name).write_bytes(content)
    return read_recording(tmp_path / name, rig)


FORMATS = {
    "steps.csv": CSV.encode(),
    "steps.csv.gz": gzip.compress(CSV.encode()),
    "semicolon.csv": CSV.replace(",", ";").encode(),
    "german.csv": CSV.replace(",", ";").replace(".", ",").encode(),
    "tab.tsv": CSV.replace(",", "\t").encode(),
    "tab german.tsv": CSV.replace(",", "\t").replace(".", ",").encode(),
    "bar.txt": CSV.replace(",", "|").encode(),
    "blanks.dat": CSV.replace(",", "   ").encode(),
    "spaced.csv": CSV.replace(",", " , ").encode(),
    "quoted.csv": CSV.replace("t,u,x", '"t","u","x"').encode(),
    "windows.csv": CSV.replace("\n", "\r\n").encode(),
    "mac.csv": CSV.replace("\n", "\r").encode(),
    "bom.csv": b"\xef\xbb\xbf" + CSV.encode(),
    "utf16.csv": CSV.encode("utf-16"),
    "comments.csv": ("# bench 3\n% valve 7\n\n" + CSV.replace("\n0.0100", "\n# here\n0.0100")).encode(),
    "trailing.csv": CSV.replace("\n", ",\n").encode(),
    "trailing data.csv": ("t,u,x\n" + CSV.split("\n", 1)[1].replace("\n", ",\n")).encode(),
    "latin.csv": "\n".join(["t,u,x,y [µm]", *(f"{line},1" for line in lines()[1:])]).encode("latin-1"),
    "steps.parquet": parquet(table()),
    "v4.mat": mat("4", **vectors()),
    "v5.mat": mat("5", **vectors(), gain=np.array(3.0), note=np.array("text")),
    "v73.mat": mat73(**vectors(), gain=np.array(3.0)),
    "steps.tdms": tdms(table()),
}


@pytest.mark.parametrize("name", FORMATS)
def test_formats_agree(name, tmp_path, rig):
    found = read(tmp_path, rig, name, FORMATS[name])
    expected = table()
    np.testing.assert_allclose(found.time, expected.t, atol=1e-12)
    np.testing.assert_allclose(found["command"].values, expected.u / 5, atol=2e-6)
    np.testing.assert_allclose(found["command"].recorded, expected.u, atol=1e-5)
    np.testing.assert_allclose(found["position"].values, expected.x / 1000, atol=1e-7)
    assert found.provenance is not None
    assert found.provenance.rows_read == len(expected)
    assert found.provenance.columns == {"time": "t", "command": "u", "position": "x"}
    assert len(found.provenance.sha256) == 64


def test_missing_samples_are_nan_and_blank_lines_are_noted(tmp_path, rig):
    text = CSV.splitlines()
    text[6] = "0.0050,,NaN"
    text.insert(20, "")
    text.append(",,")
    found = read(tmp_path, rig, "steps.csv", "\n".join(text).encode())
    assert found.missing == {"command": 1, "position": 1}
    assert len(found) == 60
    notes = " ".join(found.provenance.notes)
    assert "1 blank lines" in notes
    assert "1 rows without any value" in notes


def test_line_numbers_count_comments_and_blanks(tmp_path, rig):
    text = "# one\n\n" + CSV.replace("\n0.0030,", "\n% two\n0.0030,oops")
    with pytest.raises(RecordingError, match="line 8 holds"):
        read(tmp_path, rig, "steps.csv", text.encode())


def test_text_in_a_column_nobody_maps_is_no_error(tmp_path, rig):
    text = "t,u,x,note\n" + "\n".join(f"{line},good" for line in lines()[1:])
    assert len(read(tmp_path, rig, "steps.csv", text.encode())) == 60


def test_one_column_with_decimal_commas_and_a_missing_sample(tmp_path):
    (tmp_path / "one.csv").write_text("x\n0,5\n\n1,5\n2,5\n\n")
    found, _ = read_table(tmp_path / "one.csv", ["x"])
    np.testing.assert_array_equal(found.columns["x"].values, [0.5, np.nan, 1.5, 2.5])


def test_rate_stands_in_for_a_time_column(tmp_path):
    for time in ('rate = "500 Hz"', 'time = { rate = "500 Hz" }'):
        (tmp_path / "rig.toml").write_text(RIG.replace('time = { column = "t", unit = "s" }', time))
        found = read(tmp_path, read_rig(tmp_path / "rig.toml"), "steps.csv", CSV.encode())
        np.testing.assert_allclose(found.time, np.arange(60) / 500)


def test_offset_noise_gauge_and_reference(tmp_path):
    text = RIG.replace(
        'position = { column = "x", unit = "mm" }',
        'position = { column = "x", unit = "mm", offset = "13 cm", sd = "0.03 mm" }\n'
        'reference = { column = "r", unit = "mm" }\n'
        'pressure_a = { column = "pa", unit = "bar_gauge" }',
    )
    (tmp_path / "rig.toml").write_text(text)
    frame = table().assign(r=1.0, pa=5.0)
    found = read(tmp_path, read_rig(tmp_path / "rig.toml"), "steps.parquet", parquet(frame))
    np.testing.assert_allclose(found["position"].values, frame.x / 1000 - 0.13, atol=1e-15)
    assert found["position"].sd == pytest.approx(3e-5)
    assert found["reference"].unit == "m"
    np.testing.assert_allclose(found["pressure_a"].values, 6e5)


def test_command_at_full_scale_is_one(tmp_path, rig):
    found = read(tmp_path, rig, "steps.parquet", parquet(table().assign(u=5.0)))
    assert found["command"].full_scale == 1.0
    assert (found["command"].recorded_unit, found["command"].per_unit) == ("V", 5.0)
    np.testing.assert_array_equal(found["command"].values, 1.0)


def test_matrices_structs_and_other_lengths_of_mat(tmp_path):
    content = mat("5", y=np.arange(12.0).reshape(6, 2), log={"t": np.arange(6.0)}, short=np.arange(3.0))
    (tmp_path / "m.mat").write_bytes(content)
    found, _ = read_table(tmp_path / "m.mat", ["log.t", "y[1]", "short", "y"])
    assert sorted(found.names) == ["log.t", "short", "y[0]", "y[1]"]
    assert found.columns["y[1]"].values.tolist() == [1, 3, 5, 7, 9, 11]
    assert found.columns["short"].values.tolist() == [0, 1, 2]
    assert "2 signals" in found.left_out["y"]


def test_tdms_names_groups_only_where_needed(tmp_path):
    import nptdms

    channels = [nptdms.ChannelObject(g, n, np.arange(4.0)) for g, n in [("a", "x"), ("b", "x"), ("b", "u")]]
    with nptdms.TdmsWriter(str(tmp_path / "m.tdms")) as file:
        file.write_segment(channels)
    found, _ = read_table(tmp_path / "m.tdms", ["a/x", "u", "b/u", "x"])
    assert sorted(found.names) == ["a/x", "b/x", "u"]
    assert sorted(found.columns) == ["a/x", "b/u", "u"]
    assert "2 groups" in found.left_out["x"]


@pytest.mark.parametrize(
    ("module", "name", "content"),
    [
        ("pyarrow", "steps.parquet", parquet(table())),
        ("h5py", "v73.mat", mat73(**vectors())),
        ("nptdms", "steps.tdms", tdms(table())),
    ],
)
def test_absent_library_names_the_extra(module, name, content, tmp_path, rig, monkeypatch):
    import sys

    for loaded in [key for key in sys.modules if key.split(".")[0] == module]:
        monkeypatch.setitem(sys.modules, loaded, None)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(RecordingError, match=r'pip install "optid\[formats\]"'):
        read(tmp_path, rig, name, content)


class Maps:
    """What `read_recording` wants of a rig."""

    def __init__(self, *channels):
        self.channels = {channel.role: channel for channel in channels}


def test_cascaded_tanks(shared):
    maps = Maps(
        ChannelMap("time", "", "s", "s", rate=0.25),
        ChannelMap("pump", "uEst", "V", "V"),
        ChannelMap("level", "yEst", "V", "V"),
    )
    found = read_recording(shared / "recordings" / "cascaded_tanks" / "dataBenchmark.csv", maps)
    assert (len(found), found.interval) == (1024, 4.0)
    assert found["pump"].values[0] == 3.2567
    assert found.provenance.notes == ()


def test_emps(shared):
    maps = Maps(
        ChannelMap("time", "t", "s", "s"),
        ChannelMap("command", "vir", "V", "V"),
        ChannelMap("position", "qm", "m", "m"),
    )
    found = read_recording(shared / "recordings" / "emps" / "DATA_EMPS.mat", maps)
    assert len(found) == 24841
    assert found.rate == pytest.approx(1000, rel=1e-4)


@pytest.mark.parametrize("case", ["plain", "one_effect", "two_effects_with_pressures"])
def test_example_rigs(case, shared):
    rig = read_rig(shared / "examples" / case / "rig.toml")
    for name in ("steps", "multisine", "ramps", "mixed"):
        found = read_recording(shared / "examples" / case / f"{name}.csv", rig)
        assert len(found) == 8000
        assert np.abs(found["command"].values).max() <= 1.0
        assert found.gaps() == ()
