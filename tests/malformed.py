"""Rig files and recordings with one thing wrong each, and what a message about them must say.

`CASES` is data; `make` writes one case's two files into a folder. The same table serves the readers and every
command that takes RIG RECORDING.
"""

from __future__ import annotations

import gzip
import io
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

RIG = """\
name = "bench-3"
model = "servo-pneumatic"

[parameters]
supply_pressure = "7 bar"
exhaust_pressure = "1 bar"
atmospheric_pressure = "1 bar"
port_width = "6.2 mm"
spool_travel = "4 mm"
bore_diameter = "42 mm"
rod_diameter = "16 mm"
stroke = "260 mm"
residual_length = "12 mm"
payload_mass = "1.9 kg"
discharge_coefficient = 0.8
viscous_friction = "78 N s/m"
coulomb_friction = "83 N"

[fit]
discharge_coefficient = { bounds = [0.4, 1.0] }
viscous_friction = { bounds = ["0 N s/m", "400 N s/m"], sd = "50 N s/m" }

[channels]
time = { column = "t", unit = "s" }
command = { column = "u", unit = "V", full_scale = "5 V" }
position = { column = "x", unit = "mm" }
"""


@dataclass(frozen=True)
class Case:
    """One mistake.

    Attributes:
        name: what is wrong.
        fault: "rig" or "recording": the file the message must name.
        fragments: what else the message must hold.
        rig: writes the rig file at a path.
        recording: writes the recording at a path.
        file: name of the recording.
    """

    name: str
    fault: str
    fragments: tuple[str, ...]
    rig: Callable[[Path], object]
    recording: Callable[[Path], object]
    file: str = "steps.csv"


def make(case: Case, folder: Path) -> tuple[Path, Path]:
    """Write a case's files; returns the paths of rig and recording."""
    rig, recording = folder / "bench.toml", folder / case.file
    case.rig(rig)
    recording.parent.mkdir(exist_ok=True)
    case.recording(recording)
    return rig, recording


def table(rows: int = 60) -> pd.DataFrame:
    """A sound recording: t in s, u in V, x in mm."""
    t = np.arange(rows) * 1e-3
    return pd.DataFrame({"t": t, "u": 4 * np.sin(20 * t), "x": 30 * np.sin(10 * t)})


def lines(rows: int = 60) -> list[str]:
    """The same as CSV lines; line 1 is the header, so line n holds row n - 2."""
    frame = table(rows)
    return ["t,u,x", *(f"{t:.4f},{u:.5f},{x:.4f}" for t, u, x in frame.itertuples(index=False))]


def text(content: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(content, encoding="utf-8")


def raw(content: bytes) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(content)


SOUND_RIG = text(RIG)
SOUND_RECORDING = text("\n".join(lines()) + "\n")


def rig(name: str, old: str, new: str, *fragments: str) -> Case:
    """A rig file in which `old` is replaced."""
    assert old in RIG, old
    return Case(name, "rig", fragments, text(RIG.replace(old, new, 1)), SOUND_RECORDING)


def rig_bytes(name: str, content: bytes, *fragments: str) -> Case:
    return Case(name, "rig", fragments, raw(content), SOUND_RECORDING)


def row(name: str, number: int, new: str, *fragments: str) -> Case:
    """A CSV in which one line is replaced."""
    changed = lines()
    changed[number - 1] = new
    return Case(f"row: {name}", "recording", fragments, SOUND_RIG, text("\n".join(changed) + "\n"))


def recording(name: str, file: str, content: bytes | Callable[[Path], object], *fragments: str) -> Case:
    write = raw(content) if isinstance(content, bytes) else content
    return Case(name, "recording", fragments, SOUND_RIG, write, file)


def plant(name: str, source: str, function: str, *fragments: str) -> Case:
    """A user's own plant that cannot be used."""

    def write(path: Path) -> None:
        (path.parent / "axis.py").write_text(source, encoding="utf-8")
        path.write_text(RIG.replace("servo-pneumatic", f"axis.py:{function}"), encoding="utf-8")

    return Case(name, "rig", fragments, write, SOUND_RECORDING)


def parquet(frame: pd.DataFrame) -> bytes:
    buffer = io.BytesIO()
    frame.to_parquet(buffer)
    return buffer.getvalue()


def mat(version: str, **variables: np.ndarray) -> bytes:
    import scipy.io

    buffer = io.BytesIO()
    scipy.io.savemat(buffer, variables, format=version, do_compression=version == "5")
    return buffer.getvalue()


def mat73(**variables: np.ndarray) -> bytes:
    """HDF5 with MATLAB's user block: what a file of version 7.3 is."""
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=512) as file:
        for name, values in variables.items():
            file[name] = np.atleast_2d(values)
    data = bytearray(buffer.getvalue())
    data[:19] = b"MATLAB 7.3 MAT-file"
    return bytes(data)


def tdms(frame: pd.DataFrame) -> bytes:
    import nptdms

    buffer = io.BytesIO()
    with nptdms.TdmsWriter(buffer) as file:
        file.write_segment([nptdms.ChannelObject("bench", name, frame[name].to_numpy()) for name in frame])
    return buffer.getvalue()


def vectors(rows: int = 60) -> dict[str, np.ndarray]:
    return {name: column.to_numpy() for name, column in table(rows).items()}


SUPPLY, FIT = 'supply_pressure = "7 bar"', "discharge_coefficient = { bounds = [0.4, 1.0] }"
POSITION = 'position = { column = "x", unit = "mm" }'
COMMAND = 'command = { column = "u", unit = "V", full_scale = "5 V" }'
TIME = 'time = { column = "t", unit = "s" }'

RIG_CASES = (
    rig(
        "unit misspelt", SUPPLY, 'supply_pressure = "7 baar"', "parameters.supply_pressure", '"baar"', '"bar"'
    ),
    rig("unit of habit", SUPPLY, 'supply_pressure = "6 barg"', "parameters.supply_pressure", '"bar_gauge"'),
    rig("wrong dimension", SUPPLY, 'supply_pressure = "7 mm"', "parameters.supply_pressure", '"mm"', "7 bar"),
    rig("no unit", SUPPLY, "supply_pressure = 7", "parameters.supply_pressure", "no unit", '"Pa"'),
    rig("unit on a number", "coefficient = 0.8", 'coefficient = "0.8 m"', "parameters.discharge_coefficient"),
    rig("only a unit", SUPPLY, 'supply_pressure = "bar"', "parameters.supply_pressure", "number"),
    rig(
        "decimal comma", SUPPLY, 'supply_pressure = "7,5 bar"', "parameters.supply_pressure", "comma", "point"
    ),
    rig("infinite value", SUPPLY, 'supply_pressure = "inf bar"', "parameters.supply_pressure", "not finite"),
    rig("overflowing value", SUPPLY, 'supply_pressure = "1e999 bar"', "supply_pressure", "not finite"),
    rig("NaN value", "coefficient = 0.8", "coefficient = nan", "discharge_coefficient", "not finite"),
    rig("a truth value", "coefficient = 0.8", "coefficient = true", "discharge_coefficient", "number"),
    rig("a list", "coefficient = 0.8", "coefficient = [0.8]", "discharge_coefficient", "[0.8]"),
    rig("an endless power", SUPPLY, 'supply_pressure = "7 m**9**9**9"', "supply_pressure", "not a unit"),
    rig("code for a unit", SUPPLY, 'supply_pressure = "7 __import__(1)"', "supply_pressure", "not a unit"),
    rig("unknown parameter", "payload_mass", "payload_mas", "parameters.payload_mas", '"payload_mass"'),
    rig("missing parameter", 'stroke = "260 mm"\n', "", "parameters", "no value for stroke"),
    rig("outside physics", '"1.9 kg"', '"-1.9 kg"', "parameters.payload_mass", '"-1.9 kg"', "physical"),
    rig(
        "gauge atmosphere",
        'atmospheric_pressure = "1 bar"',
        'atmospheric_pressure = "0 bar_gauge"',
        "parameters.atmospheric_pressure",
        "absolute",
    ),
    rig("gauge length", '"260 mm"', '"260 mm_gauge"', "parameters.stroke", "gauge"),
    rig("unknown table", "[fit]", "[fitt]", '"fitt"', '"fit"'),
    rig("unknown top key", 'name = "bench-3"', 'nane = "bench-3"', '"nane"', '"name"'),
    rig("name is a number", 'name = "bench-3"', "name = 3", "name", "found 3"),
    rig("unknown plant", '"servo-pneumatic"', '"servo_pneumatic"', "model", '"servo-pneumatic"'),
    rig("no model", 'model = "servo-pneumatic"\n', "", "model", "missing"),
    rig(
        "plant file's name too long",
        '"servo-pneumatic"',
        f'"{"a/" * 5000}p.py:axis"',
        "model",
        "is not a path",
    ),
    rig("plant file absent", '"servo-pneumatic"', '"no/such.py:axis"', "model", "such.py", "does not exist"),
    rig(
        "unknown option",
        "[parameters]",
        "[options]\nfrictoin = 'smooth'\n[parameters]",
        "options",
        '"friction"',
    ),
    rig("option value", "[parameters]", "[options]\nfriction = 'smoth'\n[parameters]", "options", "'smooth'"),
    rig(
        "unknown effect", "[fit]", "[effects.stribek_friction]\n[fit]", "effects.stribek", "stribeck_friction"
    ),
    rig("effect no table", "[fit]", "[effects]\nvalve_lag = 3\n[fit]", "effects.valve_lag", "found 3"),
    rig(
        "unknown effect parameter",
        "[fit]",
        "[effects.valve_lag]\ntime_constnat = '3 ms'\n[fit]",
        "effects.valve_lag.time_constnat",
        "time_constant",
    ),
    rig(
        "wrong effect unit",
        "[fit]",
        "[effects.valve_lag]\ntime_constant = '3 mm'\n[fit]",
        "effects.valve_lag.time_constant",
        "wrong dimension",
    ),
    rig(
        "unphysical effect",
        "[fit]",
        "[effects.valve_lag]\ntime_constant = '3 s'\n[fit]",
        "effects.valve_lag.time_constant",
        "outside the physical range",
    ),
    rig("no effect file", "[fit]", "[effects.'my.py:mine']\n[fit]", "effects.my.py:mine", "does not exist"),
    rig(
        "fit of a stranger",
        FIT,
        "discharge = { bounds = [0.4, 1.0] }",
        "fit.discharge",
        '"discharge_coefficient"',
    ),
    rig("fit without bounds", FIT, "discharge_coefficient = {}", "fit.discharge_coefficient", "bounds"),
    rig("fit as a list", FIT, "discharge_coefficient = [0.4, 1.0]", "fit.discharge_coefficient", "bounds ="),
    rig(
        "three bounds", FIT, "discharge_coefficient = { bounds = [0, 1, 2] }", "discharge_coefficient.bounds"
    ),
    rig("bounds reversed", "[0.4, 1.0]", "[1.0, 0.4]", "fit.discharge_coefficient.bounds", "not below"),
    rig(
        "bounds without unit", '["0 N s/m", "400 N s/m"]', "[0, 400]", "fit.viscous_friction.bounds", "N s/m"
    ),
    rig("start out of bounds", "[0.4, 1.0]", "[0.9, 1.0]", "fit.discharge_coefficient", "0.8", "0.9 to 1"),
    rig(
        "bounds out of physics",
        "[0.4, 1.0]",
        "[-0.4, 1.0]",
        "fit.discharge_coefficient.bounds",
        "1e-06 to 10",
    ),
    rig("unknown fit key", "[0.4, 1.0] }", "[0.4, 1.0], sdd = 1 }", "discharge_coefficient.sdd", '"sd"'),
    rig("sd of nothing", 'sd = "50 N s/m"', 'sd = "0 N s/m"', "fit.viscous_friction.sd", "positive"),
    rig("sd in another unit", 'sd = "50 N s/m"', 'sd = "50 N"', "fit.viscous_friction.sd", '"N"'),
    rig(
        "unknown role", POSITION, 'positon = { column = "x", unit = "mm" }', "channels.positon", '"position"'
    ),
    rig("no command", COMMAND + "\n", "", "channels.command", "needs it as an input"),
    rig("no output", POSITION, "", "channels", "position, pressure_a, pressure_b"),
    rig("no time", TIME, "", "channels.time", "rate"),
    rig("time and rate", TIME, TIME + '\nrate = "1 kHz"', "channels.rate", "one of the two"),
    rig("rate in seconds", TIME, 'rate = "1 ms"', "channels.rate", '"Hz"'),
    rig("negative rate", TIME, 'rate = "-1 kHz"', "channels.rate", "positive"),
    rig("time in metres", 'unit = "s"', 'unit = "m"', "channels.time.unit", '"s"'),
    rig("position in volts", '"x", unit = "mm"', '"x", unit = "V"', "channels.position.unit", '"m"'),
    rig("channel without unit", '"x", unit = "mm"', '"x"', "channels.position.unit", "missing"),
    rig("no full scale", ', full_scale = "5 V"', "", "channels.command.full_scale", '"5 V"'),
    rig("full scale of 0", '"5 V"', '"0 V"', "channels.command.full_scale", "positive"),
    rig("full scale in mm", '"5 V"', '"5 mm"', "channels.command.full_scale", '"V"'),
    rig("unknown channel key", "full_scale", "fullscale", "channels.command.fullscale", '"full_scale"'),
    rig("channel as a text", POSITION, 'position = "x"', "channels.position", "column ="),
    rig("one column twice", 'column = "x"', 'column = "u"', "channels.position", '"u"', "command"),
    rig("parameters no table", "[parameters]", "[[parameters]]", "parameters", "table"),
    rig("TOML syntax", SUPPLY, "supply_pressure = 7 bar", "TOML", "line 5"),
    rig("key twice", SUPPLY, SUPPLY + "\n" + SUPPLY, "TOML", "line 6"),
    rig_bytes("rig empty", b"", "model", "missing"),
    rig_bytes("rig not UTF-8", b'name = "\xff\xfe"', "UTF-8"),
    rig_bytes("rig binary", bytes(range(128)) * 4, "TOML"),
    Case("rig a directory", "rig", ("directory",), Path.mkdir, SOUND_RECORDING),
    Case("rig absent", "rig", ("no such file",), lambda path: None, SOUND_RECORDING),
    plant("plant: no function", "def axle(s): pass", "axis", "model", '"axis"', "axle"),
    plant("plant: not callable", "axis = 3", "axis", "model", "int"),
    plant("plant: a class", "class axis: pass", "axis", "model", "a class"),
    plant("plant: syntax", "def axis(s)\n", "axis", "model", "SyntaxError", "line 1"),
    plant("plant: import raises", "import math\nmath.sqrt(-1)", "axis", "model", "ValueError", "line 2"),
    plant("plant: exits", "raise SystemExit(3)", "axis", "model", "SystemExit"),
    plant(
        "plant: equations raise", "def axis(s):\n    return nothing", "axis", "model", "NameError", "line 2"
    ),
    plant("plant: no rate", "def axis(s):\n    s.state('x', 'm', 1.0)", "axis", "model", "no rate for x"),
)

RECORDING_CASES = (
    recording(
        "missing column", "steps.csv", text("\n".join(["t,u,xx", *lines()[1:]])), "position", '"x"', '"xx"'
    ),
    row("text in numbers", 7, "0.0050,oops,0.3", 'column "u"', "line 7", '"oops"'),
    row("words in numbers", 6, "s,V,mm", 'column "u"', "line 6", '"V"'),
    row("two numbers in a cell", 9, "0.0070,1 2,0.3", 'column "u"', "line 9"),
    row("infinite value", 12, "0.0100,inf,0.3", 'column "u"', "line 12", "infinite"),
    row("overflowing value", 12, "0.0100,1e999,0.3", 'column "u"', "line 12", "infinite"),
    row("no time", 8, ",1.0,0.3", 'column "t"', "line 8", "no time"),
    row("NaN time", 8, "NaN,1.0,0.3", 'column "t"', "line 8", "no time"),
    row("time repeats", 9, lines()[7], 'column "t"', "line 9", "repeats", "rate"),
    row("time goes back", 9, "0.0010,1.0,0.3", 'column "t"', "line 9", "goes back from 0.006 to 0.001"),
    row("row too long", 20, "0.0180,1.0,0.3,4", "line 20", "4 fields", "3, as in the header"),
    row("row too short", 20, "0.0180,1.0", "line 20", "2 fields", "3, as in the header"),
    row("last row cut off", 61, "0.0590,1", "line 61", "truncated"),
    row("one line of prose", 33, "the valve was exchanged here", "line 33", "1 field"),
    row("duplicated column", 1, "t,u,u", "line 1", '"u"', "twice"),
    row("no header", 1, "0.0,1.0,2.0", "line 1", "header"),
    recording("empty file", "steps.csv", b"", "empty"),
    recording("blank file", "steps.csv", b"\n \n\n", "empty"),
    recording("comments only", "steps.csv", b"# a\n% b\n", "comments"),
    recording("header only", "steps.csv", b"t,u,x\n", "only a header"),
    recording("one row", "steps.csv", b"t,u,x\n0,1,2\n", "fewer than two"),
    recording(
        "channel without values",
        "steps.csv",
        text("\n".join(["t,u,x", *(f"{k},1.0," for k in range(9))])),
        'column "x"',
        "no row has a value",
    ),
    recording("binary garbage", "steps.csv", bytes(range(256)) * 20, "neither text"),
    recording("a spreadsheet", "steps.xlsx", b"PK\x03\x04" + bytes(100), "spreadsheet"),
    recording("a directory", "steps.csv", Path.mkdir, "directory"),
    recording("absent", "steps.csv", lambda path: None, "no such file"),
    recording("gzip cut off", "steps.csv.gz", gzip.compress("\n".join(lines()).encode())[:-40], "truncated"),
    recording("no gzip at all", "steps.csv.gz", "\n".join(lines()).encode(), "gzip"),
    recording("gzip of nothing", "steps.csv.gz", gzip.compress(b""), "empty"),
    recording("Parquet cut off", "steps.parquet", parquet(table())[:-100], "Parquet", "truncated"),
    recording("no Parquet at all", "steps.parquet", b"t,u,x\n0,1,2\n", "Parquet"),
    recording(
        "Parquet: missing column",
        "steps.parquet",
        parquet(table().rename(columns={"x": "pos_x"})),
        "position",
        '"x"',
    ),
    recording(
        "Parquet: text",
        "steps.parquet",
        parquet(table().astype({"u": str}).replace({"u": {"0.0": "off"}})),
        'column "u"',
        "row 1",
        '"off"',
    ),
    recording(
        "Parquet: dates",
        "steps.parquet",
        parquet(table().assign(u=pd.date_range("2024", periods=60))),
        'column "u"',
        "dates",
    ),
    recording(
        "Parquet: time repeats", "steps.parquet", parquet(table().assign(t=0.5)), 'column "t"', "row 2"
    ),
    recording(".mat 4 cut off", "steps.mat", mat("4", **vectors())[:-200], ".mat", "truncated"),
    recording(".mat 5 cut off", "steps.mat", mat("5", **vectors())[:-200], ".mat", "truncated"),
    recording(".mat 7.3 cut off", "steps.mat", mat73(**vectors())[:-500], ".mat", "truncated"),
    recording(".mat of garbage", "steps.mat", bytes(range(256)) * 4, ".mat"),
    recording(".mat of scalars", "steps.mat", mat("5", a=np.array(3.0)), "no vector"),
    recording(
        ".mat: lengths differ",
        "steps.mat",
        mat("5", **{**vectors(), "x": np.arange(7.0)}),
        "position",
        '"x"',
        "7 values",
        "60",
    ),
    recording(
        ".mat: missing column",
        "steps.mat",
        mat73(t=vectors()["t"], U=vectors()["u"], x=vectors()["x"]),
        "command",
        '"u"',
    ),
    recording(".mat: complex", "steps.mat", mat("5", **{**vectors(), "u": vectors()["u"] * 1j}), '"u"'),
    recording("TDMS cut off", "steps.tdms", tdms(table())[:-300], "TDMS"),
    recording("TDMS of garbage", "steps.tdms", bytes(range(256)) * 4, "TDMS"),
    recording(
        "TDMS: missing column", "steps.tdms", tdms(table().rename(columns={"u": "U1"})), "command", '"u"'
    ),
)

CASES = RIG_CASES + RECORDING_CASES
