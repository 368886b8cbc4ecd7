"""A file asks for no more memory and time than its real content can need, and a sound one is read all the same."""

import gzip
import io
import struct
import sys
import types
import zlib

import numpy as np
import pandas as pd
import pytest

from optid.core.readers import limits, mat, read_table
from optid.core.readers.layout import bare_name, unit_in
from optid.core.readers.limits import Budget
from optid.errors import RecordingError

h5py = pytest.importorskip("h5py")
pa = pytest.importorskip("pyarrow")
pq = pytest.importorskip("pyarrow.parquet")

N = 60
T = np.arange(N) * 1e-3
WANTED = ("t", "u", "x")


def hdf5(path, change=lambda file: None, **options):
    with h5py.File(path, "w", **options) as file:
        for name in WANTED:
            file[name] = T
        change(file)
    return path


def parquet(path, **columns):
    pq.write_table(pa.table({"t": T, "u": T, **columns}), path, compression="zstd")
    return path


def read(path, wanted=WANTED):
    table, _ = read_table(path, wanted)
    return table


def element(kind, data):
    return struct.pack("<II", kind, len(data)) + data + bytes(-len(data) % 8)


def variable(name, values):
    flags, size = element(6, struct.pack("<II", 6, 0)), element(5, struct.pack("<ii", len(values), 1))
    return element(14, flags + size + element(1, name) + element(9, values.tobytes()))


def mat_file(*compressed):
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack("<H", 0x0100) + b"IM"
    return head + b"".join(struct.pack("<II", 15, len(z)) + z for z in (zlib.compress(c) for c in compressed))


@pytest.fixture
def small(monkeypatch):
    """Bounds so low that a test reaches them at once."""
    monkeypatch.setattr(limits, "FLOOR", 1 << 20)
    monkeypatch.setattr(limits, "RATIO", 2)


@pytest.mark.parametrize("window", [15, 31])
@pytest.mark.parametrize("size", [0, 1, 5000, 10_000_000])
def test_a_stream_unpacks_to_what_was_packed(window, size, tmp_path):
    content = np.random.default_rng(size).bytes(size // 2) + bytes(size // 2)
    packed = zlib.compress(content) if window == 15 else gzip.compress(content)
    assert Budget(1 << 20, tmp_path).inflate(packed, "it", window) == content
    with pytest.raises(zlib.error):
        Budget(1 << 20, tmp_path).inflate(packed[:-3], "it", window)
    if window == 31:
        assert Budget(1 << 20, tmp_path).inflate(packed * 3 + bytes(100), "it", window) == content * 3


def test_what_a_stream_may_not_unpack_to_is_not_made(small, tmp_path, monkeypatch):
    made = []
    monkeypatch.setattr(
        Budget,
        "take",
        lambda self, count, what, real=Budget.take: (made.append(count), real(self, count, what)),
    )
    packed = zlib.compress(bytes(64 << 20))
    with pytest.raises(RecordingError, match="far more than a file of this size"):
        Budget(len(packed), tmp_path).inflate(packed, "it")
    assert sum(made) <= 8 << 20


def test_endless_short_streams_are_refused(monkeypatch, tmp_path):
    monkeypatch.setattr(limits, "MEMBERS", 50)
    with pytest.raises(zlib.error, match="more than 50 parts"):
        Budget(1 << 20, tmp_path).inflate(gzip.compress(b"") * 60, "it", 31)


def test_a_compressed_variable_is_one_variable(tmp_path, monkeypatch):
    """Zeros behind it are no elements: a file of 2 MB could hold a hundred million."""
    monkeypatch.setattr(mat, "_MOST", 100)
    sound = [variable(name, T) for name in (b"t", b"u", b"x")]
    (tmp_path / "run.mat").write_bytes(mat_file(*(one + bytes(100_000) for one in sound)))
    assert set(read(tmp_path / "run.mat").columns) == set(WANTED)
    (tmp_path / "run.mat").write_bytes(mat_file(*sound) + bytes(8 * 200))
    with pytest.raises(RecordingError, match="too many elements"):
        read(tmp_path / "run.mat")


def test_a_chunk_may_not_be_larger_than_what_a_file_can_hold(small, tmp_path):
    def change(file):
        del file["x"]
        chunked = file.create_dataset(
            "x", (N,), "f8", maxshape=(None,), chunks=(1 << 20,), compression="gzip"
        )
        chunked.id.write_direct_chunk((0,), zlib.compress(bytes(8 << 20)))

    with pytest.raises(RecordingError, match=r'dataset "/x" would take 8\.38'):
        read(hdf5(tmp_path / "run.h5", change))


def test_cells_of_cells_of_cells_are_looked_at_within_bounds(tmp_path, monkeypatch):
    from optid.core.readers import hdf5 as reader

    looked = []
    real = reader._Walk._node
    monkeypatch.setattr(reader, "_MOST", 200)
    monkeypatch.setattr(reader._Walk, "_node", lambda *given: (looked.append(1), real(*given))[1])

    def change(file):
        within, cells = file["t"], file.create_group("#refs#")
        for level in range(2):
            inner, within = within, cells.create_dataset(f"c{level}", (50,), h5py.ref_dtype)
            within[:] = [inner.ref] * 50
        file["cell"] = np.array([within.ref], h5py.ref_dtype)

    assert set(read(hdf5(tmp_path / "run.h5", change)).columns) == set(WANTED)
    assert len(looked) <= 202  # of 2554


def test_of_endless_objects_those_asked_for_are_found(tmp_path, monkeypatch):
    from optid.core.readers import hdf5 as reader

    monkeypatch.setattr(reader, "_MOST", 5)
    path = hdf5(tmp_path / "run.h5", lambda file: [file.create_group(f"a{k}") for k in range(20)])
    assert set(read(path).columns) == set(WANTED)


def test_what_else_is_in_a_file_does_not_hinder(tmp_path):
    def change(file):
        file["operator"] = "Anna"
        file["words"] = np.array(["a", "b"], dtype=object)
        file["round"], file["about"] = h5py.SoftLink("/about"), h5py.SoftLink("/round")
        file["t"].attrs["MATLAB_class"] = np.zeros(300_000, "S4")

    assert set(read(hdf5(tmp_path / "run.h5", change, libver="latest")).columns) == set(WANTED)


def test_a_text_that_repeats_is_not_unfolded(tmp_path):
    texts = pa.array(["1" * 100_000] * N)
    assert "texts of up to 100000 bytes" in read(parquet(tmp_path / "run.parquet", x=texts)).left_out["x"]
    numbers = [f"{value:.3f}" for value in T]
    found = read(parquet(tmp_path / "run.parquet", x=pa.array(numbers))).columns["x"].values
    assert found.tolist() == numbers


@pytest.mark.parametrize("name", ["rows.csv.gz", "rows.parquet"])
def test_a_small_file_has_no_endless_rows(name, tmp_path, monkeypatch):
    """Rows of two or three bytes, or of none: what is made of each takes 80."""
    monkeypatch.setattr(limits, "ROWS", 1000)
    path, count = tmp_path / name, 100_000
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(b"t,y\n" + b"0,0\n" * count))
    else:
        zeros = np.zeros(count, dtype=np.int8)
        pd.DataFrame({"t": zeros, "y": zeros}).to_parquet(path, compression="zstd")
    assert path.stat().st_size < 4000
    with pytest.raises(RecordingError, match=r"10000[01] rows, far more than a file of this size holds"):
        read_table(path, ["t", "y"])


def test_lists_count_with_all_they_hold(small, tmp_path):
    path = parquet(tmp_path / "run.parquet", x=pa.array([np.zeros(100_000)] * N))
    with pytest.raises(RecordingError, match="would take 48"):
        read(path, ("t", "u", "x[0]"))


def test_patterns_see_no_endless_cell():
    assert bare_name("u [V]") == "u" and unit_in("u [V]") == "V"
    endless = "u" + 300 * " " + 300 * "b"
    assert bare_name(endless) == endless and unit_in(endless) == ""


@pytest.mark.parametrize("column", ["t", "x"])
def test_numbers_that_nothing_can_have_are_refused_by_line(column, tmp_path):
    from optid.core.readers import read_recording
    from optid.core.recording import ChannelMap

    frame = pd.DataFrame(dict.fromkeys(WANTED, T))
    frame[column] = frame[column].where(frame.index < 20, 1e300 * (1 + T))
    frame.to_csv(tmp_path / "run.csv", index=False)
    maps = types.SimpleNamespace(
        channels={
            "time": ChannelMap("time", "t", "s", "s"),
            "command": ChannelMap("command", "u", "V", "V", held=True),
            "position": ChannelMap("position", "x", "m", "m"),
        }
    )
    with pytest.raises(RecordingError, match=rf'column "{column}": line 22 holds 1.*e\+300'):
        read_recording(tmp_path / "run.csv", maps)


@pytest.mark.parametrize(
    "error", [ValueError("numpy.dtype size changed"), ImportError("no symbol"), AttributeError("x")]
)
def test_a_broken_library_is_told(error, tmp_path, monkeypatch):
    path = hdf5(tmp_path / "run.h5")

    class Broken:
        def find_spec(self, name, *_):
            if name == "h5py":
                raise error

    monkeypatch.delitem(sys.modules, "h5py")
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    with pytest.raises(
        RecordingError, match=rf"it is installed but cannot be imported: {type(error).__name__}.*pip install"
    ):
        read(path)


def test_an_array_file_that_announces_more_than_it_holds(tmp_path):
    from optid.errors import InputError
    from optid.results.tables import read_tables, write_tables

    frame = pd.DataFrame({"time": T, "use": ["training"] * N, "sound": [True] * N})
    write_tables(tmp_path / "sound.npz", {"nodes": frame})
    assert read_tables(tmp_path / "sound.npz")["nodes"].equals(frame)
    buffer = io.BytesIO()
    np.save(buffer, T)
    for name, content in (
        ("announced", buffer.getvalue().replace(b"(60,)", b"(9e9,)".replace(b"9e9", b"99"))),
        ("deep", buffer.getvalue().replace(b"(60,)", b"(((((")),
        ("bomb", bytes(300 << 20)),
    ):
        import zipfile

        with zipfile.ZipFile(tmp_path / f"{name}.npz", "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("nodes|time.npy", content)
        with pytest.raises(InputError, match="tables of a result"):
            read_tables(tmp_path / f"{name}.npz")
