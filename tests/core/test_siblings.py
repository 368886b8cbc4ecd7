"""Siblings of files that practice has shown: other languages, orders, marks and stamps; read, or refused by name."""

import numpy as np
import pytest
from logs import N, T, U, X, rows, text
from test_loggers import Maps, written

from optid.core.readers import read_recording
from optid.errors import RecordingError

UX = ("u", "x")
COMMAS = rows(";", comma=True)
PLAIN = (("t", "s"), ("u", "V"), ("x", "mm"))


def beside(cell, delimiter=";"):
    return [f"{cell}{delimiter}{line}" for line in rows(delimiter, comma=True)]


def quoted(lines, delimiter=";", out=","):
    return [out.join(f'"{cell}"' for cell in line.split(delimiter)) for line in lines]


def named(time, command, position):
    return (time, "s"), (command, "V"), (position, "mm")


READ = {  # name -> text, encoding, maps
    "weekday and month in words": (text("Datum;t;u;x", beside("Do, 02. Mai 2024")), "utf-8", PLAIN),
    "text with the delimiter": (text("Note;t;u;x", beside('"läuft; ok"')), "utf-8", PLAIN),
    "Windows 1252": (
        text("Gerät;t;u [µV];x", beside("Prüfstand")),
        "cp1252",
        (("t", "s"), ("u [µV]", "V"), ("x", "mm")),
    ),
    "Windows 1251": (
        text("Дата;Время;Команда;Положение", beside("02.05.2024")),
        "cp1251",
        named("Время", "Команда", "Положение"),
    ),
    "GBK": (
        text("日期,时间,命令,位置", rows(columns=(lambda k: "2024年5月2日", "t", *UX))),
        "gbk",
        named("时间", "命令", "位置"),
    ),
    "Shift-JIS": (
        text("日付,時間,指令,位置", rows(columns=(lambda k: "2024/05/02", "t", *UX))),
        "cp932",
        named("時間", "指令", "位置"),
    ),
    "units and types below": (
        text("D;t;u;x", "[];[s];[V];[mm]", "REAL;REAL;REAL;REAL", beside("02.05.24")),
        "utf-8",
        PLAIN,
    ),
    "tabs": (text("Datum\tt\tu\tx", beside("02.05.2024", "\t")), "utf-16", PLAIN),
    "pipes": (text("Datum|t|u|x", beside("02/05/2024", "|")), "utf-8", PLAIN),
    "blanks and commas": (
        text("  t    u    x", ["   ".join(line.split(";")) for line in COMMAS]),
        "utf-8",
        PLAIN,
    ),
    "exponents": (
        text(
            "t;u;x", [f"{t:.6E};{u:.6E};{x:.6E}".replace(".", ",") for t, u, x in zip(T, U, X, strict=True)]
        ),
        "utf-8",
        PLAIN,
    ),
    "a true minus sign": (text("t;u;x", [line.replace("-", "\u2212") for line in COMMAS]), "utf-8", PLAIN),
    "no-break blanks": (
        text("t;u;x", [";".join(f"\u00a0{c}" for c in line.split(";")) for line in COMMAS]),
        "utf-8",
        PLAIN,
    ),
    "units in cells": (
        text("t;u;x", [f"{t:.3f} s;{u} V;{x} mm" for t, u, x in zip(T, U, X, strict=True)]),
        "utf-8",
        PLAIN,
    ),
    "each line one quoted cell": (text('"t,u,x"', [f'"{line}"' for line in rows()]), "utf-8", PLAIN),
    "quotes within such lines": (
        text('"""t"",""u"",""x"""', [f'"{line}"' for line in rows()]),
        "utf-8",
        PLAIN,
    ),
    "header behind a star": (text("* t u x", rows(" ")), "utf-8", PLAIN),
    "header behind a semicolon": (text("; t u x", rows(" ")), "utf-8", PLAIN),
    "the last of several comments": (text("# rig 3", "# 2024", "# t u x", rows(" ")), "utf-8", PLAIN),
    "row names as R writes them": (
        text('"t" "u" "x"', [f'"{k}" {line}' for k, line in enumerate(rows(" "), 1)]),
        "utf-8",
        PLAIN,
    ),
    "an index without a name": (
        text("t,u,x", [f"{k},{line}" for k, line in enumerate(rows())]),
        "utf-8",
        PLAIN,
    ),
    "text in braces beside": (
        text("t,u,x,meta", rows(columns=("t", *UX, lambda k: '"{""a"": [1, 2]}"'))),
        "utf-8",
        PLAIN,
    ),
    "two headers": (text("time,command,position", "t,u,x", rows()), "utf-8", PLAIN),
    "a table in Markdown": (
        text("| t | u | x |", "|---|---|---|", [f"| {' | '.join(line.split(','))} |" for line in rows()]),
        "utf-8",
        PLAIN,
    ),
    "first lines that end in carriage returns": (text("t,u,x", rows(), end="\r"), "utf-8", PLAIN),
    "names that hold quotes": (
        text('t;"""Data"".u";"""Data"".x"', COMMAS),
        "utf-8",
        named("t", '"Data".u', '"Data".x'),
    ),
    "signs apart from their numbers": (
        text(
            "t,u,x",
            [
                ",".join(
                    (cell[:1] + "  " + cell[1:]) if "-" in cell else "+ " + cell for cell in line.split(",")
                )
                for line in rows()
            ],
        ),
        "utf-8",
        PLAIN,
    ),
    "dates among the facts of the channels": (
        text(
            "TraceName,u,x",
            "SampleRate,1000,1000",
            "Date,2024/05/02,2024/05/02",
            "Time,10:00:00.00,10:00:00.00",
            rows(),
        ),
        "utf-8",
        (("column 1", "s"), *PLAIN[1:]),
    ),
    "a row of scales above the rows": (text("t;u;x", "[s];[V];[mm]", "0,01;1;1", COMMAS), "utf-8", PLAIN),
    "an old end mark": (text("t,u,x", rows()) + "\x1a", "utf-8", PLAIN),
}


@pytest.mark.parametrize("name", READ)
def test_read_right(name, tmp_path):
    content, encoding, maps = READ[name]
    found = read_recording(written(tmp_path, "run.csv", content, encoding), Maps(*maps))
    assert len(found) == N
    np.testing.assert_allclose(found.time, T, atol=1e-9)
    np.testing.assert_allclose(found["command"].values, U, atol=1e-6)
    np.testing.assert_allclose(found["position"].values, X / 1000, atol=1e-9)


STAMPS = [
    "2024-05-02 10:00:00.{:03d}",
    "20240502T100000.{:03d}",
    "2024/05/02-10:00:00.{:03d}",
    "02-May-2024 10:00:00.{:03d}",
    "May 2 2024 10:00:00.{:03d}",
    "2024-123T10:00:00.{:03d}",
    "Thu May  2 10:00:00.{:03d} 2024",
    "02. Mai 2024 10:00:00.{:03d}",
    "[2024-05-02 10:00:00.{:03d}]",
    "2024-05-02_10-00-00.{:03d}",
    "10h00m00.{:03d}s",
    "lundi 2 mai 2024 10:00:00.{:03d}",
    "DT#2024-05-02-10:00:00.{:03d}",
    "TOD#10:00:00.{:03d}",
    "T#1s{}ms",
    "PT0.{:03d}S",
    "0 days 00:00:00.{:03d}000",
    "00:00.{:03d}",
    "2024-05-02T10:00:00.{:03d}+02:00[Europe/Berlin]",
    "2024-05-02 10:00:00.{:03d} CEST",
    "10:00:00.{:03d} vorm.",
    "2024-05-02T10:00:00.{:03d}000000Z",
    "20240502 10:00:00.{:03d}",
    "5/2/2024 10:00:00.{:03d} AM",
    "2024年5月2日 10:00:00.{:03d}",
]


@pytest.mark.parametrize("stamp", STAMPS)
def test_stamps(stamp, tmp_path):
    content = text("t;u;x", [f"{stamp.format(k)};{line}" for k, line in enumerate(rows(";", columns=UX))])
    found = read_recording(written(tmp_path, "run.csv", content), Maps(*PLAIN))
    np.testing.assert_allclose(found.time - found.time[0], T, atol=1e-9)


REFUSED = {
    "a date alone": (
        text("t,u,x", rows(columns=(lambda k: "2024-05-02", *UX))),
        r'line 2 holds "2024-05-02".*rate = ',
    ),
    "words for times": (
        text("t,u,x", rows(columns=(lambda k: f"sample {k}", *UX))),
        r'line 2 holds "sample 0".*line 1',
    ),
    "a long table": (
        text("t,name,value", [f"{T[k]},{n},{v[k]}" for k in range(N) for n, v in (("u", U), ("x", X))]),
        r'value of column "name".*pivot',
    ),
    "two recordings": (text("t,u,x", rows()[:25], "t,u,x", rows()[25:]), r"line 27 repeats the header"),
    "one value too many": (
        text("t,u,x", rows(columns=("t", *UX, lambda k: 3 * k))),
        r"4 fields.*by position",
    ),
    "a comma late": (
        text("t,u,x", [f"{k},{0 if k < 30 else f'{k},5'},{k}" for k in range(N)]),
        r"line 32 has 4 fields.*semicolons",
    ),
    "lines within a cell": (
        text("t,u,x,note", rows(columns=("t", *UX, lambda k: '"two\nlines"'))),
        r"line 3 has 1 field.*spans several lines",
    ),
    "whole seconds": (
        text("t,u,x", rows(columns=(lambda k: f"10:00:{k // 10:02d}", *UX))),
        r"repeats.*rate =",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused_with_place_and_cure(name, tmp_path):
    content, words = REFUSED[name]
    with pytest.raises(RecordingError, match=words):
        read_recording(written(tmp_path, "run.csv", content), Maps(*PLAIN))


def test_lines_are_counted_past_comments_and_blank_lines(tmp_path):
    lines = rows()
    lines[40] = "0.040,bad,1"
    content = text("# head", "t,u,x", lines[:10], "", "# more", "", lines[10:30], "# again", lines[30:])
    with pytest.raises(RecordingError, match=r'line 47 holds "bad"'):
        read_recording(written(tmp_path, "run.csv", content), Maps(*PLAIN))


def test_pieces_of_a_long_table_are_put_together(tmp_path, monkeypatch):
    """Whole numbers in the first pieces, then fractions; what a piece holds besides numbers is read all the same."""
    monkeypatch.setattr("optid.core.readers.rows._PIECE", 64)
    lines = [f"{k},{k if k < 30 else k + 0.5},{k}" for k in range(N)]
    maps = (("t", "ms"), ("u", "V"), ("x", "mm"))
    found = read_recording(written(tmp_path, "run.csv", text("t,u,x", lines)), Maps(*maps))
    assert found["command"].values.tolist() == [k if k < 30 else k + 0.5 for k in range(N)]
    stamps = [f"10:00:00.{k:03d},{k},{k}" for k in range(N)]
    found = read_recording(written(tmp_path, "run.csv", text("t,u,x", stamps)), Maps(*PLAIN))
    np.testing.assert_allclose(found.time, 36000 + T)
