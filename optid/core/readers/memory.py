"""Recordings from data in memory: a frame or arrays instead of a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from optid.core.readers.mapping import Mapped, recording_of, wanted_columns
from optid.core.readers.table import Column, Table
from optid.errors import RecordingError

if TYPE_CHECKING:
    import pandas as pd

    from optid.core.recording import Recording


def recording_from_frame(frame: pd.DataFrame, rig: Mapped, name: str) -> Recording:
    """See `Recording.from_frame`."""
    named = _by_column(frame, rig)
    names = [str(column) for column in named]
    columns = {column: Column(named[column].to_numpy()) for column in wanted_columns(rig) if column in named}
    return recording_of(Table(columns, names, "memory"), None, rig, Path(name))


def recording_from_arrays(arrays: Mapping[str, ArrayLike], rig: Mapped, name: str) -> Recording:
    """See `Recording.from_arrays`."""
    import numpy as np
    import pandas as pd

    columns = {key: np.asarray(values) for key, values in arrays.items()}
    lengths = {key: values.shape for key, values in columns.items()}
    if any(len(shape) != 1 for shape in lengths.values()) or len(set(lengths.values())) > 1:
        said = ", ".join(f"{key} {shape}" for key, shape in lengths.items())
        raise RecordingError(f"shapes {said}", where=name, expected="arrays of one dimension and one length")
    return recording_from_frame(pd.DataFrame(columns), rig, name)


def _by_column(frame: pd.DataFrame, rig: Mapped) -> pd.DataFrame:
    """Columns named by their role are the rig file's columns, in its units."""
    named = {
        role: channel.column
        for role, channel in rig.channels.items()
        if channel.column and channel.column not in frame and role in frame
    }
    return frame.rename(columns=named)
