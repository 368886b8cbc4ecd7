"""The driver interface, and how a driver is found: built in by name, a user's own from a file."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from optid.core.loading import blame, load_file
from optid.errors import InputError, RigError, nearest
from optid.live.settings import Settings, Wiring, driver_options
from optid.rigs.fields import Table
from optid.rigs.rigfile import Rig


class EndOfData(Exception):
    """A driver has no more samples: the session ends as planned."""


class Driver(Protocol):
    """The access to a rig. Values are in the units of the rig file's columns: volts, mm, bar.

    It runs in the guard's process, which outlives the loop. `read` and `write` may take a part of
    the sampling period; an exception ends the session with the safe command. `time` is the session's, in
    seconds from sample 0. A driver that rounds the command may have an attribute `resolution`, the step of it in
    the unit of its column.
    """

    def read(self, time: float) -> Sequence[float]:
        """One value for each measured channel, in the wiring's order; NaN where a sensor gave none.

        Parameters
        ----------
        time : float
            s, of the session.

        Raises
        ------
        EndOfData
            there are no more samples.
        """

    def write(self, command: float, time: float) -> float:
        """Write a command, in the unit of its column; returns the command that is really applied from now on.

        Parameters
        ----------
        command : float
            in the unit of its column.
        time : float
            s, of the session.
        """

    def close(self) -> None:
        """Close the connection to the rig; the safe command was written before, if that was possible."""


@dataclass(frozen=True, eq=False)
class Order:
    """The arguments of a driver.

    Attributes
    ----------
    rig : Rig
        the parsed rig file.
    wiring : Wiring
        the columns to read and the one to write.
    settings : Settings
        rate and limits.
    options : Table
        the rig file's `[live.NAME]`, `[live.file]` for a user's own.
    recording : Path | None
        for `replay`.
    seed : int
        of everything random.
    """

    rig: Rig
    wiring: Wiring
    settings: Settings
    options: Table
    recording: Path | None = None
    seed: int = 0


VIRTUAL = ("simulated", "replay")  # without hardware: they end with the guard's process
Maker = Callable[[Order], Driver]

# Name -> "module:function"; a module, and the package it needs, is imported when its driver is used.
BUILT_IN = {
    "simulated": "optid.live.drivers.simulated:simulated",
    "replay": "optid.live.drivers.replay:replay",
    "nidaqmx": "optid.live.drivers.nidaqmx:cards",
    "opcua": "optid.live.drivers.opcua:server",
}


def check_driver_name(name: str) -> None:
    """Refuse a name of no driver, without importing or running anything.

    Parameters
    ----------
    name : str
        a built-in driver, or "path/to/file.py:function" for a user's own.

    Raises
    ------
    InputError
        neither.
    """
    file, colon, _ = name.rpartition(":")
    if name not in BUILT_IN and not (colon and file.endswith(".py")):
        raise InputError(
            f'no driver "{name}"',
            where="--driver",
            expected='a built-in name or "path/to/file.py:function"',
            hint=nearest(name, BUILT_IN),
        )


def find_driver(name: str) -> Maker:
    """The function that makes a driver.

    Parameters
    ----------
    name : str
        a built-in driver, or "path/to/file.py:function" for a user's own.

    Raises
    ------
    InputError
        no such driver, or its package is not installed.
    """
    if name in BUILT_IN:
        module, function = BUILT_IN[name].split(":")
        found: Maker = getattr(importlib.import_module(module), function)
        return found
    check_driver_name(name)
    file, _, function = name.rpartition(":")
    module_of_file = load_file(Path(file))
    made = getattr(module_of_file, function, None)
    if not callable(made):
        own = [key for key, value in vars(module_of_file).items() if callable(value) and key[0] != "_"]
        raise InputError(
            f'"{file}" has no function "{function}"', where="--driver", hint=nearest(function, own)
        )
    own_maker: Maker = made
    return own_maker


def open_driver(name: str, rig: Rig, order: dict[str, Any]) -> Driver:
    """Make a driver; `order` holds the remaining fields of an `Order`.

    Raises
    ------
    InputError
        as `find_driver`, or the driver refuses its options.
    """
    maker = find_driver(name)
    options = driver_options(rig, name if name in BUILT_IN else "file")
    try:
        return maker(Order(rig, options=options, **order))
    except InputError:
        raise
    except Exception as error:
        if name in BUILT_IN:
            raise
        file = Path(name.rpartition(":")[0])
        raise RigError(f"the driver raised {blame(error, file)}", where=file) from error


def needed(module: str, extra: str) -> Any:
    """Import the package that a driver needs.

    Raises
    ------
    InputError
        it is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise InputError(
            f"{module} cannot be imported ({error})", where="--driver", hint=f'pip install "optid[{extra}]"'
        ) from None
