"""Damaged and absurd inputs for every reader and parser: each must give a value or one line that says what is wrong.

    python -m studies.fuzz [COUNT] [--seed SEED] [--first N] [--workers N]

Input number n is made from sound files by mutations drawn from the seed and n alone, so that `--first N` with a count
of 1 repeats one. A fault is an exception that optid did not raise on purpose, a process that ends, more than 5 s of its
own time, or more than 1 GB. Prints each fault and how many inputs of each kind were read, refused and faulty.
"""

from __future__ import annotations

import argparse
import collections
import gzip
import io
import json
import multiprocessing
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

ROOT = Path(__file__).resolve().parents[1]
SECONDS, MEMORY = 5, 2**30
HANGS = 120 * SECONDS  # s of the clock after which a process that cannot even be interrupted is ended

Generator = np.random.Generator
Work = Callable[[bytes, Path], object]

# What tends to break parsers, in places where a sound file has something else.
TOKENS = (
    b"NaN",
    b"nan",
    b"Infinity",
    b"-inf",
    b"1e999",
    b"-1e308",
    b"1e300",
    b"1e-320",
    b"9" * 400,
    b"9" * 5000,
    b"0x10",
    b"1_0",
    b"1,5",
    b"--1",
    b"+-1",
    b"1e",
    b".",
    b"",
    b"\x00",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
    b"\xed\xa0\x80",
    b"\r",
    b"\n",
    b"\r\n",
    b"\t",
    b";",
    b",",
    b'"',
    b"'",
    b"[",
    b"]",
    b"{",
    b"}",
    b"[" * 3000,
    b'{"a":' * 3000,
    b"#",
    b"%",
    b"null",
    b"true",
    b"1 dB",
    b"1 Ym^14 m^-13",
    b"1 m**9**9",
    b"1 bar_gauge",
    b"-300 degC",
    b"1 m^-400",
    b" " * 20000,
    b"../../../etc/passwd",
    b"/dev/zero",
    b"a" * 70000,
    b"1e5" * 3000,
    "é".encode("latin-1"),
    "µ".encode(),
    b"2024-05-02T10:00:00",
    b"12:00:00",
    b"__import__('os')",
    b"1 __import__('os')",
)


def mutated(content: bytes, rng: Generator) -> bytes:
    """A sound file with one to six things wrong."""
    data = bytearray(content)
    for _ in range(min(int(rng.geometric(0.5)), 6)):
        size = max(len(data), 1)
        at, until = sorted(int(x) for x in rng.integers(0, size + 1, 2))
        until = min(until, at + 1 + int(rng.exponential(60)))
        token = TOKENS[int(rng.integers(len(TOKENS)))]
        way = int(rng.integers(8))
        if way == 0 and data:
            data[at % size] ^= 1 << int(rng.integers(8))
        elif way == 1:
            del data[at:until]
        elif way == 2:
            data[at:at] = data[at:until] * int(rng.integers(1, 40))
        elif way == 3:
            data[at:until] = token
        elif way == 4:
            del data[at:]
        elif way == 5:
            data[at:until] = rng.bytes(until - at)
        elif way == 6:
            data[:] = swapped(data, rng)
        else:
            data[at:at] = token
    return bytes(data[: 4 * 2**20])


def swapped(data: bytearray, rng: Generator) -> bytes:
    """A word of the text in the place of another, or one replaced by a token: keeps the form, breaks the sense."""
    for separator in (b'"', b" ", b",", b"\n"):
        parts = bytes(data).split(separator)
        if len(parts) > 2 and rng.random() < 0.5:
            i, j = (int(x) for x in rng.integers(0, len(parts), 2))
            parts[i] = parts[j] if rng.random() < 0.5 else TOKENS[int(rng.integers(len(TOKENS)))]
            return separator.join(parts)
    return bytes(data)


def table() -> pd.DataFrame:
    """A sound recording."""
    t = np.arange(120) * 1e-3
    return pd.DataFrame({"t": t, "u": 3 * np.sin(30 * t), "x": 40 * np.sin(15 * t) + 120})


def written(kind: str) -> bytes:
    """A sound file of a kind."""
    frame, buffer = table(), io.BytesIO()
    if kind in ("csv", "csv.gz"):
        text = frame.to_csv(index=False).encode()
        return gzip.compress(text, mtime=0) if kind == "csv.gz" else text
    if kind == "parquet":
        frame.to_parquet(buffer)
        return buffer.getvalue()
    columns = {name: frame[name].to_numpy() for name in frame}
    if kind in ("mat4", "mat5"):
        import scipy.io

        scipy.io.savemat(buffer, columns, format=kind[-1], do_compression=kind == "mat5")
        return buffer.getvalue()
    if kind == "tdms":
        import nptdms

        with nptdms.TdmsWriter(buffer) as file:
            file.write_segment(
                [nptdms.ChannelObject("bench", name, values) for name, values in columns.items()]
            )
        return buffer.getvalue()
    return _hdf5(columns, user_block=kind == "mat73")


def _hdf5(columns: dict[str, Any], user_block: bool) -> bytes:
    import h5py

    buffer = io.BytesIO()
    with h5py.File(buffer, "w", userblock_size=512 if user_block else 0) as file:
        for name, values in columns.items():
            file[name] = np.atleast_2d(values)
    data = bytearray(buffer.getvalue())
    if user_block:
        data[:19] = b"MATLAB 7.3 MAT-file"
    return bytes(data)


ARMAX = {
    "schema": "optid.armax/1",
    "input": "command",
    "output": "position",
    "recommended": 1,
    "models": [
        {
            "na": 1,
            "nb": 1,
            "nc": 1,
            "nk": 1,
            "a": [1.0, -0.9],
            "b": [0.1],
            "c": [1.0, 0.1],
            "sample_time": 0.001,
            "noise_variance": 1e-9,
            "covariance": None,
            "audit": [{"name": "x", "grave": False, "text": "y"}],
        }
    ],
}
PID = {
    "schema": "optid.pid/1",
    "sample_time": 0.001,
    "limits": {"low": -5.0, "high": 5.0, "rate": None},
    "gains": {"kp": 60.0, "ki": 80.0, "kd": 1.5, "derivative_filter": 0.005, "setpoint_weight": 1.0},
    "anti_windup": {"kind": "clamping", "tracking_time": 0.1},
}
DIAGNOSIS = {
    "schema": "optid.diagnosis/1",
    "not_testable": [{"effect": "sensor_lag"}],
    "findings": [{"effect": "valve_lag", "indistinguishable_from": ["input_delay"]}],
}
ESTIMATE = {"value": 83.0, "unit": "N", "ci95": [79.0, None], "start": 80.0}
SCORE = {"position": {"fit_percent": 99.0, "rmse": 3e-5, "unit": "m"}}
FIT = {
    "schema": "optid.fit/1",
    "outcome": "converged",
    "seconds": 3.0,
    "horizon": 0.5,
    "asked": ["coulomb_friction"],
    "parameters": {"coulomb_friction": ESTIMATE},
    "values": {"coulomb_friction": 83.0},
    "process_noise": [1e-6, 1e-4],
    "train": SCORE,
    "holdout": SCORE,
    "not_identifiable": [],
    "at_bound": ["coulomb_friction"],
    "ties": ["a and b cannot be told apart"],
    "profiles": {"coulomb_friction": {"words": "known from one side"}},
    "missed": [{"channel": "position", "percent": 13.0, "advice": "the model's error is 13 %"}],
}
FLEET = """[defaults]
job = "fit"
memory = "1.5 GB"
time_limit = 100
options = { starts = 3 }
[statistics]
level = 0.05
siblings = "line"
[[rows]]
rig = "a.toml"
train = ["a1.csv", "a2.csv"]
holdout = ["a3.csv"]
tags = { line = "3" }
[[rows]]
rig = "b.toml"
train = ["b1.csv"]
job = "diagnose"
threads = 2
"""
CHANNELS = """[channels]
time = { column = "t", unit = "s" }
command = { column = "u", unit = "V" }
position = { column = "x", unit = "mm" }
"""
UNITS = (
    "7 bar",
    "6 bar_gauge",
    "20 degC",
    "78 N s/m",
    "287 J/(kg K)",
    "0.03 mm",
    "1.9 kg",
    "2e-3 m^3/s",
    "5 %",
)


def results() -> dict[str, list[bytes]]:
    """Tables and manifest of a sound result folder."""
    from optid.core import resultset
    from optid.results.tables import TABLES, write_tables

    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        staged = resultset.staging(folder)
        (staged / "fit.json").write_text(json.dumps(FIT), encoding="utf-8")
        write_tables(
            staged / TABLES, {"covariance": pd.DataFrame({"coulomb_friction": [4.0]}), "nodes": table()}
        )
        resultset.commit(
            folder, staged, {"version": "1", "command": "optid fit", "inputs": {"a.csv": "0" * 64}}
        )
        kept = {"tables": folder / TABLES, "manifest": folder / resultset.MANIFEST}
        return {kind: [path.read_bytes()] for kind, path in kept.items()}


def sources() -> dict[str, list[bytes]]:
    """Sound files by kind."""
    rigs = [path.read_bytes() for path in sorted((ROOT / "data").glob("*.toml"))]
    kinds = ("csv", "csv.gz", "parquet", "mat4", "mat5", "mat73", "h5", "tdms")
    documents = {"armax": ARMAX, "pid": PID, "diagnosis": DIAGNOSIS}
    return {
        "rig": rigs,
        "unit": [text.encode() for text in UNITS],
        **{name: [json.dumps(content).encode()] for name, content in documents.items()},
        "fleet": [FLEET.encode()],
        "fit": [json.dumps(FIT).encode()],
        **results(),
        **{kind: [written(kind)] for kind in kinds},
    }


# Of 60 inputs in a row; kinds that take long come less often.
SHARES = {
    "rig": 6,
    "unit": 8,
    "armax": 7,
    "pid": 5,
    "diagnosis": 3,
    "csv": 8,
    "csv.gz": 2,
    "parquet": 3,
    "mat4": 2,
    "mat5": 2,
    "mat73": 1,
    "h5": 1,
    "tdms": 2,
    "fleet": 3,
    "fit": 3,
    "tables": 2,
    "manifest": 2,
}
ORDER = tuple(kind for kind, share in SHARES.items() for _ in range(share))


def readers() -> dict[str, Work]:
    """What reads each kind, as the commands do."""
    from optid.armax.files import load as load_armax
    from optid.core.readers import read_recording
    from optid.core.units import si_unit_of, to_si
    from optid.experiments.rivals import from_diagnosis
    from optid.fleet.fleetfile import read_fleet
    from optid.quality.quality import quality
    from optid.results.fit import FitResult
    from optid.results.loading import load as load_result
    from optid.results.tables import read_tables
    from optid.rigs.rigfile import read_rig
    from optid.tuning.files import load as load_pid

    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "rig.toml"
        text, _, _ = (ROOT / "data" / "emps.toml").read_text(encoding="utf-8").partition("[channels]")
        place.write_text(text + CHANNELS, encoding="utf-8")
        rig = read_rig(place)

    def recording(_: bytes, path: Path) -> object:
        read = read_recording(path, rig)
        return quality(read, rig.model)

    def unit(content: bytes, _: Path) -> object:
        value = content.decode("utf-8", "surrogateescape")
        for wanted in ("Pa", "m", "K", "1", "N s/m"):
            try:
                return to_si(value, wanted, atmospheric=1e5)
            except InputErrors:
                continue
        return si_unit_of(value.partition(" ")[2])

    def result(content: bytes, path: Path) -> object:
        """A fit in a folder, whose manifest may be the input."""
        (path.parent / "fit.json").write_bytes(content if path.suffix == ".fit" else json.dumps(FIT).encode())
        try:
            loaded = load_result(path.parent)
            assert isinstance(loaded, FitResult)
            return loaded.parameters, repr(loaded)
        finally:
            (path.parent / "fit.json").unlink()

    found: dict[str, Work] = dict.fromkeys(ORDER, recording)
    found |= {
        "rig": lambda _, path: read_rig(path),
        "unit": unit,
        "armax": lambda _, path: load_armax(path),
        "pid": lambda _, path: load_pid(path),
        "diagnosis": lambda _, path: from_diagnosis(path),
        "fleet": lambda _, path: read_fleet(path),
        "fit": result,
        "manifest": result,
        "tables": lambda _, path: read_tables(path),
    }
    return found


ENDINGS = {
    "rig": "toml",
    "armax": "json",
    "pid": "json",
    "diagnosis": "json",
    "fleet": "toml",
    "tables": "npz",
    "mat4": "mat",
    "mat5": "mat",
    "mat73": "mat",
}
InputErrors: Any = ()


class TooLong(BaseException):
    """More than `SECONDS`; no reader catches it by chance."""


def worker(numbers: list[int], seed: int, link: Connection) -> None:
    """Try inputs one after the other; says the number of each before, and how it ended after."""
    global InputErrors
    from optid.errors import OptidError

    InputErrors = OptidError
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGVTALRM, _too_long)
    known, read = sources(), readers()
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + MEMORY, hard))
    with tempfile.TemporaryDirectory() as folder:
        for number in numbers:
            link.send((number, None, ""))
            link.send((number, *tried(number, seed, known, read, Path(folder))))
    link.send(None)


def _too_long(*_: object) -> None:
    raise TooLong


def tried(
    number: int, seed: int, known: dict[str, list[bytes]], read: dict[str, Work], folder: Path
) -> tuple[str, str]:
    """How one input ends: "read", "refused" or "fault", and what there is to say."""
    rng = np.random.default_rng((seed, number))
    kind = ORDER[number % len(ORDER)]
    sound = known[kind][int(rng.integers(len(known[kind])))]
    content = mutated(sound, rng)
    path = folder / ("manifest.json" if kind == "manifest" else f"input.{ENDINGS.get(kind, kind)}")
    path.write_bytes(content)
    signal.setitimer(signal.ITIMER_VIRTUAL, SECONDS)
    began = time.process_time()
    try:
        read[kind](content, path)
        return "read", ""
    except InputErrors as error:
        long = len(str(error)) > 2000 or "\n" in str(error)
        return ("fault", f"a message of {len(str(error))} characters") if long else ("refused", "")
    except TooLong:
        return "fault", f"more than {SECONDS} s"
    except MemoryError:
        return "fault", "more than 1 GB"
    except Exception as error:
        return "fault", f"{type(error).__name__}: {str(error)[:120]} ({time.process_time() - began:.1f} s)"
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        path.unlink(missing_ok=True)


def tries(numbers: list[int], seed: int) -> Iterator[tuple[int, str, str]]:
    """The end of each input, in processes of their own: what ends one is a fault, and another goes on behind it."""
    context = multiprocessing.get_context("spawn")
    left = numbers
    while left:
        here, there = context.Pipe(duplex=False)
        process = context.Process(target=worker, args=(left, seed, there))
        process.start()
        there.close()
        at: int | None = None
        why = ""
        try:
            while here.poll(HANGS if at is not None else None) and (message := here.recv()) is not None:
                number, how, words = message
                at = number
                if how is not None:
                    yield number, how, words
                    left = left[left.index(number) + 1 :]
                    at = None
            why = "it hangs" if at is not None else ""
        except EOFError:
            why = "the process ended"
        process.kill()
        process.join()
        if at is None and why:
            raise RuntimeError(f"the process ended between inputs, before {left[:1]}")
        if at is not None:
            yield at, "fault", why
            left = left[left.index(at) + 1 :]


def _share(arguments: tuple[list[int], int]) -> list[tuple[int, str, str]]:
    return list(tries(*arguments))


def fuzz(count: int, seed: int = 0, first: int = 0, workers: int = 1) -> dict[str, collections.Counter[str]]:
    """Try inputs.

    Returns:
        Kind -> how many were "read", "refused" and "fault"; faults also by what they were, under "faults".
    """
    from concurrent.futures import ThreadPoolExecutor

    shares = [(list(range(first + k, first + count, workers)), seed) for k in range(workers)]
    counts: dict[str, collections.Counter[str]] = collections.defaultdict(collections.Counter)
    with ThreadPoolExecutor(workers) as pool:
        for ends in pool.map(_share, shares):
            for number, how, words in ends:
                kind = ORDER[number % len(ORDER)]
                counts[kind][how] += 1
                if how == "fault":
                    counts["faults"][f"{kind} {number}: {words}"] += 1
    return counts


def main() -> None:
    """Try as many as asked for and say how they ended."""
    parser = argparse.ArgumentParser(description="Damaged and absurd inputs for every reader and parser.")
    parser.add_argument("count", nargs="?", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    chosen = parser.parse_args()
    counts = fuzz(chosen.count, chosen.seed, chosen.first, chosen.workers)
    for words in counts.pop("faults", {}):
        print(words)
    print(f"{'kind':12}{'read':>8}{'refused':>9}{'faults':>8}")
    for kind in SHARES:
        print(
            f"{kind:12}"
            + "".join(
                f"{counts[kind][how]:{width}}" for how, width in (("read", 8), ("refused", 9), ("fault", 8))
            )
        )
    faults = sum(counter["fault"] for counter in counts.values())
    print(f"{chosen.count} inputs of seed {chosen.seed}, {faults} faults")
    sys.exit(faults > 0)


if __name__ == "__main__":
    main()
