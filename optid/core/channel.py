"""Channels of a recording: the mapping from columns, their content, and their provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ChannelMap:
    """How a column becomes a channel: ``model value = factor * recorded + shift``.

    Attributes
    ----------
    role : str
        role of the channel in the model: "time", an input, an output, or "reference".
    column : str
        name of the column; empty for a time that is given by `rate`.
    unit : str
        unit as measured, as the rig file states it.
    model_unit : str
        SI unit the model wants ("1" for a command divided by its full scale).
    factor : float
        converts recorded to model values, with `shift`; both account for unit, full scale, offset and gauge zero.
    shift : float
        see `factor`, in `model_unit`.
    sd : float | None
        standard deviation of the noise in `model_unit`, where known.
    colour : float | None
        its correlation from sample to sample, where that was estimated from other data than a fit's.
    full_scale : float | None
        largest value the channel can show, in `model_unit`, where known.
    per_unit : float
        size of one `model_unit` in `recorded_unit`: the full scale that was divided by, else 1.
    recorded_unit : str
        SI unit of the recorded quantity, "V" for a valve command.
    rate : float | None
        samples per second, for a time without a column.
    held : bool
        the value is held from each sample to the next, as a command is.
    linear : bool | None
        an input is interpolated linearly between samples instead, as a measured one is; None where the rig file does
        not say.
    """

    role: str
    column: str
    unit: str
    model_unit: str
    factor: float = 1.0
    shift: float = 0.0
    sd: float | None = None
    full_scale: float | None = None
    per_unit: float = 1.0
    recorded_unit: str = "1"
    rate: float | None = None
    held: bool = False
    linear: bool | None = None
    colour: float | None = None


@dataclass(frozen=True, eq=False)
class Channel:
    """One measured signal.

    Attributes
    ----------
    role : str
        its role in the model.
    column : str
        the column it was read from.
    unit : str
        SI unit of `values`, the one the model wants.
    values : Array
        shape (samples,), read-only float64; NaN marks a missing sample.
    sd : float | None
        standard deviation of the noise in `unit`, where known.
    full_scale : float | None
        largest value the channel can show, in `unit`, where known.
    per_unit : float
        size of one `unit` in `recorded_unit` (5 for a command of +-1 that was +-5 V).
    recorded_unit : str
        SI unit of what was recorded, "V" for a valve command.
    held : bool
        the value is held from each sample to the next, as a command is; where it is unknown, nothing is simulated.
    """

    role: str
    column: str
    unit: str
    values: Array
    sd: float | None = None
    full_scale: float | None = None
    per_unit: float = 1.0
    recorded_unit: str = "1"
    held: bool = False

    @property
    def recorded(self) -> Array:
        """The values in `recorded_unit`, before the division by a full scale, shape (samples,)."""
        return self.values * self.per_unit

    @property
    def missing(self) -> int:
        """Number of missing samples."""
        return int(np.isnan(self.values).sum())


@dataclass(frozen=True)
class Repair:
    """A fault of a channel that was corrected while the file was read.

    Attributes
    ----------
    role : str
        of the channel.
    message : str
        what was found and what was done, with the numbers of the file.
    row : int
        the first row affected, counted from 0 in the recording.
    """

    role: str
    message: str
    row: int


@dataclass(frozen=True)
class Provenance:
    """The source of a recording and what was done to it.

    Attributes
    ----------
    path : Path
        the file.
    sha256 : str
        of the file's bytes.
    reader : str
        the format it was read as.
    columns : Mapping[str, str]
        role -> column.
    rows_read : int
        rows of data in the file.
    notes : tuple[str, ...]
        everything that was left out, as sentences; empty if nothing was.
    repairs : tuple[Repair, ...]
        faults of channels that were corrected.
    """

    path: Path
    sha256: str
    reader: str
    columns: Mapping[str, str]
    rows_read: int
    notes: tuple[str, ...] = ()
    repairs: tuple[Repair, ...] = ()
