"""Recordings that come with the package, and public benchmarks from files that a user has.

rig, train, holdout = optid.datasets.load("worn")
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from optid.core.readers import read_recording
from optid.core.recording import Recording
from optid.errors import InputError, nearest
from optid.rigs.rigfile import Rig, read_rig

# Name -> rig file, recording to fit to, recording to judge on.
SHIPPED = {
    "bench": ("bench.toml", "bench.csv", "bench_holdout.csv"),
    "worn": ("bench.toml", "worn.csv", "worn_holdout.csv"),
}
# Name -> rig file, and the files of the benchmark, to be had from its authors (data/README.md says where).
BENCHMARKS = {
    "emps": ("emps.toml", "DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"),
    "cascaded-tanks": ("cascaded_tanks.toml", "dataBenchmark.csv", "dataBenchmark.csv"),
}


class Dataset(NamedTuple):
    """A rig with recordings to fit to and to judge on.

    Attributes
    ----------
    rig : Rig
        rig file, understood.
    train : Recording
        to fit to.
    holdout : Recording
        to judge on.
    """

    rig: Rig
    train: Recording
    holdout: Recording


def load(name: str, folder: str | Path | None = None) -> Dataset:
    """Read a data set.

    Parameters
    ----------
    name : str
        "bench" (a servo-pneumatic axis whose physics the plant knows) or "worn" (the same with a leak that its
        rig file does not know), both in the package; "emps" or "cascaded-tanks", public benchmarks that are not.
    folder : str | Path | None
        with the files of a public benchmark.

    Returns
    -------
    Dataset
        rig, recording to fit to, recording to judge on.

    Raises
    ------
    InputError
        an unknown name, or a benchmark without its folder.
    RecordingError
        a file of the benchmark is missing.
    """
    if name in SHIPPED:
        with folder_of_data() as place:
            return _read(place, place, *SHIPPED[name])
    if name not in BENCHMARKS:
        raise InputError(f'no data set "{name}"', field="name", hint=nearest(name, [*SHIPPED, *BENCHMARKS]))
    rig, train, holdout = BENCHMARKS[name]
    if folder is None:
        raise InputError(
            f'"{name}" is not in the package',
            field="folder",
            expected=f"a folder with {train}, as its authors give it",
        )
    with folder_of_data() as place:
        return _read(place, Path(folder), rig, train, holdout)


def example(folder: str | Path) -> list[Path]:
    """Copy the rig file and the recordings of the package into a folder, made if absent.

    Parameters
    ----------
    folder : str | Path
        to be made or empty.

    Returns
    -------
    list[Path]
        the files that were written.

    Raises
    ------
    InputError
        a file of such a name is there already, or the folder cannot be written.
    """
    target = Path(folder)
    names = [name for entry in SHIPPED.values() for name in entry]
    with folder_of_data() as place:
        try:
            there = [name for name in dict.fromkeys(names) if (target / name).exists()]
            if there:
                raise InputError(
                    f"{', '.join(there)} there already", where=target, expected="an empty or a new folder"
                )
            target.mkdir(parents=True, exist_ok=True)
            for name in dict.fromkeys(names):
                (target / name).write_bytes((place / name).read_bytes())
        except (OSError, ValueError) as error:  # the latter of a name with a null
            raise InputError(f"cannot be written ({error})", where=target) from None
    return [target / name for name in dict.fromkeys(names)]


@contextmanager
def folder_of_data() -> Iterator[Path]:
    """The folder with the package's data: in the wheel beside the code, in a clone `data/`."""
    inside = resources.files("optid") / "data"
    with resources.as_file(inside) as place:
        if place.is_dir():
            yield place
            return
    yield Path(__file__).resolve().parents[1] / "data"


def _read(rigs: Path, recordings: Path, rig: str, train: str, holdout: str) -> Dataset:
    understood = read_rig(rigs / rig)
    first, second = (read_recording(recordings / name, understood) for name in (train, holdout))
    return Dataset(understood, first, second)
