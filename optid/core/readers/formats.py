"""The choice of the reader by a file's first bytes; a format without a reader is named, with advice."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from pathlib import Path

from optid.core.readers.content import file_bytes, unzipped
from optid.core.readers.limits import Budget
from optid.core.readers.table import FORMATS, Table
from optid.errors import RecordingError

Reader = Callable[[bytes, Path, tuple[str, ...], Budget], Table]

_CSV = "export it as CSV"
# First bytes of formats that are not read -> what it is, and what to do.
_FOREIGN: tuple[tuple[bytes, str, str], ...] = (
    (
        b"UnFinMF ",
        "an MDF measurement file that was never finished",
        "open and save it in the program that wrote it",
    ),
    (
        b"LOGG",
        "a Vector BLF bus log",
        "export the decoded signals as CSV or MDF in CANoe, CANalyzer or CANape",
    ),
    (b"#ROSBAG V", "a ROS 1 bag", "write one topic as a table: rostopic echo -b FILE -p /topic > run.csv"),
    (
        b"CDF\x01",
        "a netCDF file of version 3",
        "convert it to netCDF 4, which is HDF5 (nccopy -k netCDF-4 IN OUT), or to CSV",
    ),
    (b"CDF\x02", "a netCDF file of version 3", "convert it to netCDF 4: nccopy -k netCDF-4 IN OUT"),
    (b"\x93NUMPY", "a NumPy .npy file", "save the columns as CSV or .mat (scipy.io.savemat)"),
    (b"ARROW1", "an Arrow or Feather file", "save it as Parquet: pandas.read_feather(file).to_parquet(out)"),
    (b"\xd0\xcf\x11\xe0", "an old Excel workbook (.xls)", "save the sheet as CSV"),
    (b"RIFF", "a WAV file", "save the channels as CSV or .mat"),
    (b"BZh", "bzip2 data", "unpack it first: bunzip2 FILE"),
    (b"\xfd7zXZ", "xz data", "unpack it first: unxz FILE"),
    (b"\x28\xb5\x2f\xfd", "zstd data", "unpack it first: unzstd FILE"),
    (b"7z\xbc\xaf", "a 7z archive", "unpack it first"),
    (b"Rar!", "a RAR archive", "unpack it first"),
    (b"|CF,", "an imc FAMOS file", "export it as CSV or .mat in FAMOS"),
    (b"AG10", "a Keysight oscilloscope binary", "save it as CSV on the oscilloscope"),
    (b"RG01", "a Rigol oscilloscope binary", "save it as CSV on the oscilloscope"),
    (b"WAVEDESC", "a LeCroy waveform (.trc)", "save it as text (ASCII, spreadsheet) on the oscilloscope"),
    (b"#9", "a LeCroy or Tektronix waveform (.trc, .wfm)", "save it as CSV on the oscilloscope"),
    (b":WFMPRE", "a Tektronix internal waveform (.isf)", "save it as CSV on the oscilloscope"),
    (b":WFMO", "a Tektronix internal waveform (.isf)", "save it as CSV on the oscilloscope"),
    (b"\x0f\x0f:WFM", "a Tektronix waveform (.wfm)", "save it as CSV on the oscilloscope"),
    (b"\xf0\xf0:WFM", "a Tektronix waveform (.wfm)", "save it as CSV on the oscilloscope"),
    (b"%PDF", "a PDF document", _CSV),
    (b"\x89PNG", "a picture", _CSV),
    (
        b"\x80\x04",
        "a Python pickle, which is not opened because it can run code",
        "save it as Parquet or CSV",
    ),
    (
        b"\x80\x05",
        "a Python pickle, which is not opened because it can run code",
        "save it as Parquet or CSV",
    ),
    (b"<!DOCTYPE", "a web page", _CSV),
    (b"<html", "a web page", _CSV),
    (b"<?xml", "an XML document", _CSV),
)
_SUFFIXES = {
    ".dxd": ("a Dewesoft file", "export it as CSV, .mat or HDF5 in DewesoftX"),
    ".d7d": ("a Dewesoft file", "export it as CSV, .mat or HDF5 in DewesoftX"),
    ".tst": ("an HBM catman file", "export it as ASCII or .mat in catman"),
    ".svdx": ("a TwinCAT Scope file", "export it as CSV: File, Export in the Scope"),
    ".svbx": ("a TwinCAT Scope file", "export it as CSV: File, Export in the Scope"),
    ".idf": ("a dSPACE ControlDesk recording", "export it as .mat, CSV or MF4 in ControlDesk"),
    ".psdata": ("a PicoScope file", "save it as CSV or .mat in PicoScope"),
    ".wdf": ("a Yokogawa waveform", "convert it to CSV with Xviewer or the WDF converter"),
    ".perspective": ("an ibaAnalyzer file", "export the channels as text"),
}
_INSIDE = (
    (b"xl/", "an Excel workbook (.xlsx)", "save the sheet as CSV"),
    (b"mimetypeapplication/vnd.oasis", "an OpenDocument spreadsheet", "save the sheet as CSV"),
    (b".npy", "a NumPy .npz archive", "save the columns as CSV or .mat (scipy.io.savemat)"),
    (b"simulink/", "a Simulink model (.slx)", "save the logged signals: save('run.mat', 't', 'u', 'x')"),
)


def read_table(path: Path, wanted: Iterable[str]) -> tuple[Table, str]:
    """Read the requested columns; the format follows from the file's first bytes, or else from its suffix.

    Returns:
        The table and the sha256 of the file's bytes.

    Raises:
        RecordingError: missing, not a file, empty, truncated, larger unpacked than it can be, or of no format known.
    """
    data = file_bytes(path)
    digest = hashlib.sha256(data).hexdigest()
    budget, name = Budget(len(data), path), path.name.lower()
    if data[:2] == b"\x1f\x8b" or name.endswith(".gz"):
        data, name = unzipped(data, budget, path), name.removesuffix(".gz")
    reader, held = reader_of(data, name, path), [data]
    if name != path.name.lower():
        budget.rows(max(data.count(b"\n"), data.count(b"\r")) if _is_text(reader) else 0)
    del data  # the reader may free it once it has what it needs
    table = reader(held.pop(), path, tuple(dict.fromkeys(wanted)), budget)
    budget.rows(max((len(column.values) for column in table.columns.values()), default=0))
    return table, digest


def _is_text(reader: Reader) -> bool:
    from optid.core.readers import text

    return reader is text.read


def reader_of(data: bytes, name: str, path: Path) -> Reader:
    """The reader of a format; each is imported only when a file needs it.

    Raises:
        RecordingError: an empty file, or a format without a reader, which is named.
    """
    from optid.core.readers import bags, hdf5, mat, mdf, parquet, tdms, text

    suffix = Path(name).suffix
    if not data[:4096].strip() and not data.strip():
        raise RecordingError("the file is empty", where=path, expected=f"a table as {FORMATS}")
    if data[:4] == b"PAR1" or suffix in (".parquet", ".pq"):
        return parquet.read
    if data[:4] in (b"TDSm", b"TDSh") or suffix == ".tdms":
        return tdms.read
    if data[:8] == b"MDF     ":
        return mdf.read
    if data[:6] == b"\x89MCAP0" or data[:15] == b"SQLite format 3":
        return bags.read
    if hdf5.is_hdf5(data):
        return hdf5.read
    if data[:6] == b"MATLAB" or suffix == ".mat":
        return mat.read
    _refuse_foreign(data, suffix, path)
    return text.read


def _refuse_foreign(data: bytes, suffix: str, path: Path) -> None:
    found = next(((what, cure) for magic, what, cure in _FOREIGN if data.startswith(magic)), None)
    if data[:4] == b"PK\x03\x04":
        head = data[: 1 << 16] + data[-(1 << 16) :]
        inside = ((what, cure) for mark, what, cure in _INSIDE if mark in head)
        found = next(inside, ("a zip archive or a spreadsheet", "unpack it, or save the sheet as CSV"))
    elif data[:2] == b"PK":
        found = ("a zip archive or a spreadsheet", "unpack it, or save the sheet as CSV")
    elif b"WAVEDESC" in data[:64]:
        found = ("a LeCroy waveform (.trc)", "save it as text (ASCII, spreadsheet) on the oscilloscope")
    elif data[:64].lstrip().startswith((b"{", b"[{", b"[[")):
        found = ("JSON text", _CSV)
    if found is None and suffix in _SUFFIXES and b"\0" in data[:4096]:
        found = _SUFFIXES[suffix]
    if found is None and suffix in (".h5", ".hdf5"):
        found = ("not an HDF5 file in spite of its name, or a damaged one", "check the program that wrote it")
    if found is not None:
        what, cure = found
        raise RecordingError(
            f"this is {what}, which is not read", where=path, expected=f"a table as {FORMATS}", hint=cure
        )
