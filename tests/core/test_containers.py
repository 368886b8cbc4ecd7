"""MATLAB, HDF5, Parquet and TDMS in the shapes in which they are saved; their clocks; bounds on what they ask for."""

import io
import os
import struct
import zlib

import numpy as np
import pandas as pd
import pytest
import scipy.io
from logs import N, T, U, X

from optid.core.readers import read_recording, read_table
from optid.core.recording import ChannelMap
from optid.errors import RecordingError

h5py = pytest.importorskip("h5py")


class Maps:
    """What `read_recording` wants of a rig: plain SI columns."""

    def __init__(self, time, command, position, rate=None, unit="s", factor=1.0):
        self.channels = {
            "time": ChannelMap("time", time or "", unit, "s", factor=factor, rate=rate),
            "command": ChannelMap("command", command, "V", "V", held=True),
            "position": ChannelMap("position", position, "m", "m"),
        }


PLAIN = Maps("t", "u", "x")


def same(found, begin=0):
    np.testing.assert_allclose(found.time - found.time[0], T[: len(found)], atol=1e-9)
    np.testing.assert_allclose(found["command"].values, U[begin : begin + len(found)], atol=1e-9)
    np.testing.assert_allclose(found["position"].values, X[begin : begin + len(found)], atol=1e-9)


def saved(path, compress=True, **variables):
    scipy.io.savemat(path, variables, do_compression=compress, long_field_names=True)
    return path


def hdf5(path, matlab=False, **content):
    """Datasets and groups; with `matlab` behind its user block."""

    def put(group, items):
        for name, value in items.items():
            if isinstance(value, dict):
                put(group.create_group(name), value)
            else:
                group[name] = value

    with h5py.File(path, "w", userblock_size=512 if matlab else 0) as file:
        put(file, content)
    if matlab:
        data = bytearray(path.read_bytes())
        data[:19] = b"MATLAB 7.3 MAT-file"
        path.write_bytes(bytes(data))
    return path


CELLS = np.empty(2, dtype=object)
CELLS[:] = [U, X]
RECORDS = np.rec.fromarrays([T, U, X], names="t,u,x")
SHAPES = {
    "columns": ({"t": T[:, None], "u": U[:, None], "x": X[:, None]}, PLAIN),
    "rows": ({"t": T, "u": U, "x": X}, PLAIN),
    "one signal a row": ({"t": T, "log": np.stack([U, X, U])}, Maps("t", "log[0]", "log[1]")),
    "one signal a column": ({"t": T, "log": np.stack([U, X], 1)}, Maps("t", "log[0]", "log[1]")),
    "MATLAB's own indices": ({"ans": np.stack([T, U, X])}, Maps("ans(1,:)", "ans(2,:)", "ans(3,:)")),
    "a wide matrix beside": ({"t": T, "u": U, "x": X, "acc": np.zeros((3, N))}, PLAIN),
    "struct": ({"log": {"t": T, "u": U, "x": X}}, Maps("log.t", "log.u", "log.x")),
    "structure with time": (
        {
            "out": {
                "time": T[:, None],
                "signals": np.array(
                    [(U[:, None], "u"), (X[:, None], "x")], dtype=[("values", object), ("label", object)]
                ),
            }
        },
        Maps("out.time", "out.signals(1).values", "out.signals(2).values"),
    ),
    "by Simulink's labels": (
        {
            "out": {
                "time": T[:, None],
                "signals": np.array(
                    [(U[:, None], "cmd"), (X[:, None], "pos")], dtype=[("values", object), ("label", object)]
                ),
            }
        },
        Maps("out.time", "cmd", "pos"),
    ),
    "one sample a page": ({"t": T, "u": U, "x": X.reshape(1, 1, N)}, PLAIN),
    "cells": ({"t": T, "c": CELLS}, Maps("t", "c{1}", "c{2}")),
    "small types": ({"t": T, "u": U, "x": X, "n": np.arange(N, dtype=np.int16), "flag": U > 0}, PLAIN),
    "dSPACE": (
        {
            "rec": {
                "X": {"Name": "time", "Data": T},
                "Y": np.array([("Model/u", U), ("Model/x", X)], dtype=[("Name", object), ("Data", object)]),
            }
        },
        Maps("rec.X.Data", "Model/u", "Model/x"),
    ),
}


@pytest.mark.parametrize("name", SHAPES)
def test_shapes_of_mat_files(name, tmp_path):
    variables, maps = SHAPES[name]
    same(read_recording(saved(tmp_path / "run.mat", **variables), maps))


HDF5 = {
    "matrix of samples": ({"log": np.stack([T, U, X], 1)}, Maps("log[0]", "log[1]", "log[2]")),
    "matrix of signals": ({"log": np.stack([T, U, X])}, Maps("log[0]", "log[1]", "log[2]")),
    "groups": ({"run": {"t": T, "axis": {"u": U, "x": X}}}, Maps("run/t", "/run/axis/u", "run.axis.x")),
    "records": ({"log": RECORDS}, Maps("log.t", "log.u", "log.x")),
    "records of vectors": (
        {
            "df": {
                "table": np.array([(k, v) for k, v in enumerate(np.stack([T, U, X], 1))], dtype="i8, (3,)f8")
            }
        },
        Maps("df.table.f1[0]", "df.table.f1[1]", "df.table.f1[2]"),
    ),
}


@pytest.mark.parametrize("matlab", [False, True])
@pytest.mark.parametrize("name", HDF5)
def test_shapes_of_hdf5_files(name, matlab, tmp_path):
    content, maps = HDF5[name]
    same(read_recording(hdf5(tmp_path / "run.h5", matlab, **content), maps))


def test_objects_of_matlab_are_passed_over_or_named_with_the_line_to_type(tmp_path):
    path = hdf5(tmp_path / "run.mat", True, t=T, u=U, x=X)
    with h5py.File(path, "r+") as file:
        for name in ("who", "log"):
            file[name] = np.array([[3707764736, 2, 1, 1, 1, 1]], dtype=np.uint32)
            file[name].attrs["MATLAB_object_decode"] = 3
        file["who"].attrs["MATLAB_class"] = np.bytes_("string")
        file["log"].attrs["MATLAB_class"] = np.bytes_("timeseries")
    same(read_recording(path, PLAIN))
    with pytest.raises(
        RecordingError, match=r"timeseries object, which only MATLAB can read \(in MATLAB: t = log\.Time"
    ):
        read_recording(path, Maps("t", "u", "log"))


@pytest.mark.parametrize("kind", ["external", "virtual", "link"])
def test_hdf5_data_outside_the_file_is_not_opened(kind, tmp_path):
    (tmp_path / "other.bin").write_bytes(np.ones(N).tobytes())
    path = hdf5(tmp_path / "run.h5", t=T, u=U)
    hdf5(tmp_path / "other.h5", x=X)
    with h5py.File(path, "r+") as file:
        if kind == "external":
            file.create_dataset("x", (N,), "f8", external=[(str(tmp_path / "other.bin"), 0, 8 * N)])
        elif kind == "link":
            file["x"] = h5py.ExternalLink(str(tmp_path / "other.h5"), "/x")
        else:
            layout = h5py.VirtualLayout((N,), "f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "x", (N,))
            file.create_virtual_dataset("x", layout)
    with pytest.raises(RecordingError, match="another file"):
        read_recording(path, PLAIN)


def test_a_maze_of_hard_links_is_walked_once(tmp_path):
    path = hdf5(tmp_path / "run.h5", t=T, u=U, x=X)
    with h5py.File(path, "r+") as file:
        inner = file.create_group("g0")
        for level in range(1, 26):
            outer = file.create_group(f"g{level}")
            outer["a"] = outer["b"] = inner
            inner = outer
    same(read_recording(path, PLAIN))


def test_what_a_file_announces_but_does_not_hold_is_not_made(tmp_path):
    path = hdf5(tmp_path / "run.h5", t=T, u=U)
    with h5py.File(path, "r+") as file:
        file.create_dataset("x", (1 << 30,), "f8", chunks=(1 << 16,))
    with pytest.raises(RecordingError, match="never written"):
        read_recording(path, PLAIN)
    with h5py.File(path, "r+") as file:
        file["x"][0] = 1.0
    with pytest.raises(RecordingError, match="far more than a file of this size"):
        read_recording(path, PLAIN)
    bomb = zlib.compress(bytes(300 << 20), 9)
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    (tmp_path / "run.mat").write_bytes(head + struct.pack("<II", 15, len(bomb)) + bomb)
    with pytest.raises(RecordingError, match="far more than a file of this size"):
        read_recording(tmp_path / "run.mat", PLAIN)
    zipped = zlib.compressobj(9, wbits=31)
    (tmp_path / "run.csv.gz").write_bytes(zipped.compress(bytes(300 << 20)) + zipped.flush())
    with pytest.raises(RecordingError, match="far more than a file of this size"):
        read_recording(tmp_path / "run.csv.gz", PLAIN)


def test_devices_and_endless_lines_are_refused(tmp_path):
    with pytest.raises(RecordingError, match="device"):
        read_recording("/dev/zero", PLAIN)
    (tmp_path / "run.csv").write_text("t,u,x\n" + "1" * 130_000 + ",1,1\n" + "0.1,1,1\n" * 3)
    with pytest.raises(RecordingError) as caught:
        read_recording(tmp_path / "run.csv", PLAIN)
    assert len(str(caught.value)) < 400
    wide = ",".join(f"column_{k}" for k in range(60_000))
    (tmp_path / "run.csv").write_text(f"{wide}\n{','.join('1' * 60_000)}\n")
    with pytest.raises(RecordingError) as caught:
        read_recording(tmp_path / "run.csv", PLAIN)
    assert len(str(caught.value)) < 800


@pytest.mark.parametrize("make", ["duration", "stamp", "zoned", "struct", "list", "decimal", "category"])
def test_kinds_of_parquet_columns(make, tmp_path):
    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    ns = np.round(T * 1e9).astype("i8")
    times = {"duration": pd.to_timedelta(ns), "stamp": pd.to_datetime(ns + 10**18)}
    times["zoned"] = times["stamp"].tz_localize("UTC")
    t, x, maps = pa.array(times.get(make, T)), pa.array(X), PLAIN
    if make == "struct":
        x, maps = pa.StructArray.from_arrays([pa.array(X), pa.array(U)], ["x", "y"]), Maps("t", "u", "x.x")
    elif make == "list":
        x, maps = pa.array([[b, a] for a, b in zip(X, U, strict=True)]), Maps("t", "u", "x[1]")
    elif make == "decimal":
        x = pa.array(X).cast(pa.decimal128(12, 4))
    elif make == "category":
        x = pa.array(X).dictionary_encode()
    pq.write_table(pa.table({"t": t, "u": U, "x": x, "twice": X}), tmp_path / "run.parquet")
    same(read_recording(tmp_path / "run.parquet", maps))


def tdms(path, *groups):
    import nptdms

    noon = np.datetime64("2024-05-02T12:00:00")
    with nptdms.TdmsWriter(str(path)) as file:
        file.write_segment(
            [
                nptdms.ChannelObject(
                    group,
                    name,
                    values,
                    {
                        "wf_increment": step,
                        "wf_start_time": noon + np.timedelta64(late, "us"),
                        "wf_start_offset": 0.0,
                    },
                )
                for group, name, values, step, late in groups
            ]
        )
    return path


def test_channels_that_begin_later_are_put_there(tmp_path):
    path = tdms(tmp_path / "run.tdms", ("a", "u", U, 1e-3, 0), ("b", "x", X, 1e-3, 10_000))
    found = read_recording(path, Maps(None, "u", "x", rate=1000.0))
    assert len(found) == N - 10
    np.testing.assert_allclose(found["command"].values, U[10:])
    np.testing.assert_allclose(found["position"].values, X[: N - 10])
    assert "10 ms" in " ".join(found.provenance.notes)
    path = tdms(tmp_path / "odd.tdms", ("a", "u", U, 1e-3, 0), ("b", "x", X, 1e-3, 300))
    found = read_recording(path, Maps(None, "u", "x", rate=1000.0))
    exact = 30 * np.cos(25 * (found.time + 1e-3 - 0.3e-3))
    np.testing.assert_allclose(found["position"].values, exact, atol=5e-4)


def test_channels_of_several_rates_are_measured_where_they_have_samples(tmp_path):
    path = tdms(tmp_path / "run.tdms", ("a", "u", U, 1e-3, 0), ("b", "x", X[::5], 5e-3, 0))
    found = read_recording(path, Maps(None, "u", "x", rate=1000.0))
    assert np.flatnonzero(np.isfinite(found["position"].values)).tolist() == list(range(0, 46, 5))
    path = tdms(tmp_path / "slow.tdms", ("a", "u", U[::5], 5e-3, 0), ("b", "x", X, 1e-3, 0))
    found = read_recording(path, Maps(None, "u", "x", rate=1000.0))
    np.testing.assert_allclose(found["command"].values, np.repeat(U[::5], 5)[: len(found)])
    np.testing.assert_allclose(found["position"].values, X[: len(found)])


def test_a_rate_that_contradicts_the_file_is_refused(tmp_path):
    path = tdms(tmp_path / "run.tdms", ("a", "u", U, 1e-3, 0), ("b", "x", X, 1e-3, 0))
    with pytest.raises(RecordingError, match=r"1000 samples a second, the rig file states 2000 Hz"):
        read_recording(path, Maps(None, "u", "x", rate=2000.0))
    with pytest.raises(RecordingError, match=r'own clock: give the rate: rate = "1000 Hz"'):
        read_recording(path, PLAIN)


def test_time_channels_of_tdms_groups(tmp_path):
    import nptdms

    with nptdms.TdmsWriter(str(tmp_path / "run.tdms")) as file:
        parts = [("a", "Time", T), ("a", "u", U), ("b", "Time", T[10:]), ("b", "x", X[10:])]
        file.write_segment([nptdms.ChannelObject(group, name, values) for group, name, values in parts])
    found = read_recording(tmp_path / "run.tdms", Maps("a/Time", "u", "x"))
    np.testing.assert_allclose(found.time - found.time[0], T[: N - 10], atol=1e-9)
    same(found, begin=10)


def test_structs_with_clocks_of_their_own(tmp_path):
    path = saved(tmp_path / "run.mat", u={"time": T, "values": U}, x={"time": T[::5], "values": X[::5]})
    found = read_recording(path, Maps("u.time", "u.values", "x.values"))
    assert np.flatnonzero(np.isfinite(found["position"].values)).tolist() == list(range(0, 46, 5))


def frame(t, **more):
    buffer = io.BytesIO()
    pd.DataFrame({"t": t, "u": np.resize(U, len(t)), "x": np.resize(X, len(t)), **more}).to_parquet(buffer)
    return buffer.getvalue()


@pytest.mark.parametrize(
    ("raw", "factor"),
    [
        (np.r_[86399.98 + T[:20], T[:30]], 1.0),
        (np.mod(65500 + np.arange(N), 65536).astype(float), 1e-3),
        ((2**32 - 20_000 + 1000 * np.arange(N, dtype=np.int64)) % 2**32, 1e-6),
        (((2**31 - 20 + np.arange(N)) + 2**31) % 2**32 - 2**31, 1e-3),
        (np.mod(3599.98 + T, 3600.0), 1.0),
        (np.mod(604_799.98 + T, 604_800.0), 1.0),
    ],
    ids=["midnight", "16 bits of ms", "32 bits of us", "signed 32 bits", "an hour", "a week"],
)
def test_clocks_that_begin_anew_are_unwrapped_and_told(raw, factor, tmp_path):
    (tmp_path / "run.parquet").write_bytes(frame(raw))
    found = read_recording(tmp_path / "run.parquet", Maps("t", "u", "x", factor=factor))
    np.testing.assert_allclose(found.time - found.time[0], T, atol=1e-9)
    assert "clock restarts" in " ".join(found.provenance.notes)


def test_fractions_of_a_second_turn_more_than_once(tmp_path):
    t = np.arange(300) * 0.01
    (tmp_path / "run.parquet").write_bytes(frame(t % 1.0))
    np.testing.assert_allclose(read_recording(tmp_path / "run.parquet", PLAIN).time, t, atol=1e-9)
    (tmp_path / "run.parquet").write_bytes(frame(t[:150] % 1.0))  # two recordings of a second may look so
    with pytest.raises(RecordingError, match="goes back"):
        read_recording(tmp_path / "run.parquet", PLAIN)


def test_a_second_recording_in_the_file_is_no_roll_over(tmp_path):
    (tmp_path / "run.parquet").write_bytes(frame(np.r_[T, T]))
    with pytest.raises(RecordingError, match=r"goes back from 0\.049 to 0"):
        read_recording(tmp_path / "run.parquet", PLAIN)


def test_stamps_of_arrival_are_refused_with_the_rate(tmp_path):
    k = np.arange(300)
    held_up = np.maximum.accumulate(
        np.where(k % 60 > 8, k * 0.01, (k // 60 * 60 + 8) * 0.01 + (k % 60) * 1e-6)
    )
    for stamps in ((k // 3) * 0.03 + (k % 3) * 0.001, held_up):
        (tmp_path / "run.parquet").write_bytes(frame(stamps))
        with pytest.raises(RecordingError, match=r'in bursts.*rate = "100(\.\d+)? Hz"'):
            read_recording(tmp_path / "run.parquet", PLAIN)
    rng = np.random.default_rng(0)
    (tmp_path / "run.parquet").write_bytes(frame(np.cumsum(rng.exponential(0.01, 300))))
    assert len(read_recording(tmp_path / "run.parquet", PLAIN)) == 300


@pytest.mark.parametrize("seed", range(20))
def test_damaged_mat_files_are_refused_in_words(seed, tmp_path):
    """Bytes of a sound file changed at random: read, or refused; never another exception."""
    rng = np.random.default_rng(seed)
    variables = {"t": T, "u": U, "x": X, "log": {"a": U, "b": [X, "text"]}}
    data = bytearray(saved(tmp_path / "run.mat", seed % 2 == 0, **variables).read_bytes())
    for at in rng.integers(124, len(data), 6):
        data[at] = int(rng.integers(0, 256))
    (tmp_path / "bad.mat").write_bytes(bytes(data))
    try:
        table, _ = read_table(tmp_path / "bad.mat", ["t", "log.a"])
        assert set(table.columns) <= {"t", "log.a"}
    except RecordingError as error:
        assert len(str(error)) < 600


def test_a_pipe_is_read_like_a_file(tmp_path):
    import threading

    os.mkfifo(tmp_path / "run.csv")
    lines = "t,u,x\n" + "".join(f"{t},{u},{x}\n" for t, u, x in zip(T, U, X, strict=True))
    feeder = threading.Thread(target=lambda: (tmp_path / "run.csv").write_text(lines))
    feeder.start()
    same(read_recording(tmp_path / "run.csv", PLAIN))
    feeder.join()
