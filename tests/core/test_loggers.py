"""The layouts in which loggers write are read, and what is not read is refused by its name and with a cure."""

import numpy as np
import pytest
from logs import LAYOUTS, N, T, U, X, rows, text

from optid.core.readers import read_recording
from optid.core.recording import ChannelMap
from optid.errors import RecordingError


class Maps:
    """What `read_recording` wants of a rig."""

    FACTORS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "V": 1.0, "mm": 1e-3}  # noqa: RUF012

    def __init__(self, time, command, position, rate=None):
        def one(role, name, si, held=False):
            column, unit = name
            return ChannelMap(role, column, unit, si, factor=self.FACTORS[unit], recorded_unit=si, held=held)

        clock = ChannelMap("time", "", "s", "s", rate=rate) if time is None else one("time", time, "s")
        self.channels = {
            "time": clock,
            "command": one("command", command, "V", held=True),
            "position": one("position", position, "m"),
        }


def written(tmp_path, name, content, encoding="utf-8"):
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode(encoding))
    return path


@pytest.mark.parametrize("end", ["\n", "\r\n"], ids=["unix", "windows"])
@pytest.mark.parametrize("name", LAYOUTS)
def test_layouts_of_loggers_are_read(name, end, tmp_path):
    file, content, maps = LAYOUTS[name]
    rate = 1000.0 if maps[0] is None else None
    found = read_recording(written(tmp_path, file, content.replace("\n", end)), Maps(*maps, rate=rate))
    assert len(found) == N
    np.testing.assert_allclose(found.time - found.time[0], T, atol=3e-7)  # stamps since 1970 as decimals
    np.testing.assert_allclose(found["command"].values, U, atol=1e-9)
    np.testing.assert_allclose(found["position"].values, X / 1000, atol=1e-12)


def test_a_scope_without_its_clock_is_refused_with_the_rate(tmp_path):
    file, content, maps = LAYOUTS["TwinCAT Scope"]
    with pytest.raises(RecordingError, match=r'TwinCAT Scope.*line 12.*rate = "1000 Hz"'):
        read_recording(written(tmp_path, file, content), Maps(("t", "s"), *maps[1:]))
    with pytest.raises(RecordingError, match=r"has 1000 samples a second, the rig file states 500"):
        read_recording(written(tmp_path, file, content), Maps(None, *maps[1:], rate=500.0))


FOREIGN = {
    "run.bag": (b"#ROSBAG V2.0\n", "ROS 1 bag"),
    "run.nc": (b"CDF\x01" + bytes(40), "netCDF file of version 3"),
    "run.blf": (b"LOGG" + bytes(40), "Vector BLF"),
    "run.npy": (b"\x93NUMPY\x01\0", "NumPy"),
    "run.xlsx": (b"PK\x03\x04" + b"xl/workbook.xml" + bytes(40), "Excel workbook"),
    "run.xls": (b"\xd0\xcf\x11\xe0" + bytes(40), "old Excel"),
    "run.trc": (b"#9000000200WAVEDESC" + bytes(40), "LeCroy"),
    "run.isf": (b":WFMPRE:NR_PT 50;", "Tektronix"),
    "run.bin": (b"AG10" + bytes(40), "Keysight"),
    "run.raw": (b"|CF,2,1,1;", "FAMOS"),
    "run.dxd": (b"\0\1DEWE" + bytes(40), "Dewesoft"),
    "run.json": (b'{"t": [0, 1]}', "JSON"),
    "run.pkl": (b"\x80\x05\x95" + bytes(40), "pickle"),
    "run.wav": (b"RIFF" + bytes(40), "WAV"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_formats_that_are_not_read_are_named_with_what_to_do(name, tmp_path):
    content, what = FOREIGN[name]
    with pytest.raises(RecordingError, match=what) as caught:
        read_recording(written(tmp_path, name, content), Maps(("t", "s"), ("u", "V"), ("x", "mm")))
    assert caught.value.hint


def test_only_mapped_columns_count(tmp_path):
    """Twice the same unused name, dates, text and empty columns beside the mapped ones, and decimal commas."""
    lines = [f"02.05.2024;{line};ok;1.000;;a,b" for line in rows(";", comma=True)]
    content = text("day;t;u;x;state;day;n;note", lines)
    found = read_recording(written(tmp_path, "run.csv", content), Maps(("t", "s"), ("u", "V"), ("x", "mm")))
    np.testing.assert_allclose(found["position"].values, X / 1000, atol=1e-12)


def test_the_whole_column_decides_its_decimal_sign(tmp_path):
    """Whole numbers for longer than any head, then the first comma; another column has points all along."""
    lines = [f"{k};{0 if k < 4000 else f'{k - 3999},5'};{k}.25" for k in range(4100)]
    content = text("t;u;x", lines)
    found = read_recording(written(tmp_path, "run.csv", content), Maps(("t", "ms"), ("u", "V"), ("x", "mm")))
    np.testing.assert_allclose(found["command"].values[3999:4002], [0, 1.5, 2.5])
    np.testing.assert_allclose(found["position"].values[:3], [0.25e-3, 1.25e-3, 2.25e-3])


def test_grouped_thousands(tmp_path):
    lines = [f"{k};{1000 * k}.5;{k % 7},5" for k in range(60)]
    lines = [f"{k};{f'{1234.5 + k:,.1f}'.translate(str.maketrans(',.', '.,'))};{k % 7},5" for k in range(60)]
    content = text("t;u;x", lines)
    found = read_recording(written(tmp_path, "run.csv", content), Maps(("t", "ms"), ("u", "V"), ("x", "mm")))
    assert found["command"].values[:2].tolist() == [1234.5, 1235.5]
    lines = [f"{k};{1 + k}.000;{k % 7},5" for k in range(60)]
    content = text("t;u;x", lines)
    with pytest.raises(RecordingError, match=r'line 2 holds "1\.000", which is ambiguous'):
        read_recording(written(tmp_path, "run.csv", content), Maps(("t", "ms"), ("u", "V"), ("x", "mm")))


def test_decimal_commas_between_commas_are_refused_with_a_cure(tmp_path):
    content = text("t,u,x", [line.replace(".", ",") for line in rows()])
    with pytest.raises(RecordingError, match=r"6 fields.*semicolons"):
        read_recording(written(tmp_path, "run.csv", content), Maps(("t", "s"), ("u", "V"), ("x", "mm")))


def test_units_in_the_file_that_contradict_the_rig_file_are_told(tmp_path):
    content = text("t,u,x", "s,mV,mm", rows())
    found = read_recording(written(tmp_path, "run.csv", content), Maps(("t", "s"), ("u", "V"), ("x", "mm")))
    (note,) = found.provenance.notes
    assert "mV" in note
    assert "1000 times too large" in note


def test_a_mapped_column_twice_is_refused_with_its_places(tmp_path):
    content = text("t,u,x,x", rows(columns=("t", "u", "x", lambda k: k)))
    with pytest.raises(RecordingError, match=r'line 1.*"x" occurs twice.*"column 3" or "column 4"'):
        read_recording(written(tmp_path, "run.csv", content), Maps(("t", "s"), ("u", "V"), ("x", "mm")))
    found = read_recording(
        written(tmp_path, "run.csv", content), Maps(("t", "s"), ("u", "V"), ("column 3", "mm"))
    )
    np.testing.assert_allclose(found["position"].values, X / 1000)


def test_utf16_without_a_mark(tmp_path):
    content = text("t;u;x", rows(";"))
    found = read_recording(
        written(tmp_path, "run.csv", content, "utf-16-le"), Maps(("t", "s"), ("u", "V"), ("x", "mm"))
    )
    assert len(found) == N
