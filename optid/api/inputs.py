"""From paths, frames or recordings, one or many, to a rig and recordings with remarks."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optid.core.decimation import brought_down
from optid.core.readers import read_recording as read_file
from optid.core.recording import Recording
from optid.core.recording_set import Experiments
from optid.errors import InputError, NotIdentifiable
from optid.quality.noise import thinned_noise
from optid.quality.quality import quality
from optid.quality.remark import Remark
from optid.rigs.per_recording import for_recordings, told
from optid.rigs.rigfile import Rig, read_rig

if TYPE_CHECKING:
    import pandas as pd

    Data = str | Path | Recording | pd.DataFrame

    Recordings = Data | Sequence[Data] | Experiments

Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class Given:
    """A recording and the remarks of its check."""

    recording: Recording
    remarks: tuple[Remark, ...]


def rig_of(rig: str | Path | Rig) -> Rig:
    """A rig, read where a path is given."""
    return rig if isinstance(rig, Rig) else read_rig(rig)


def recordings_of(rig: Rig, data: Recordings, name: str = "recordings") -> list[Recording]:
    """Recordings, read or mapped as the rig file says.

    Raises
    ------
    InputError
        an argument that is not a path, a frame, a recording or a list of them; an empty list.
    RecordingError
        as `read_recording`.
    """
    several: list[Any] = list(data) if isinstance(data, (list, tuple, Experiments)) else [data]
    if not several:
        raise InputError(
            "none is given", field=name, expected="a path, a DataFrame, a Recording, or a list of them"
        )
    return [_recording(rig, one, name, number) for number, one in enumerate(several, 1)]


def given(
    rig: Rig, train: Recordings, holdout: Recordings = (), rate: float | None = None
) -> tuple[list[Given], list[Given]]:
    """The recordings with their remarks: the first ones, and those held out. None may come twice.

    Remarks are on what was recorded; recordings faster than the axis needs are then decimated.

    Parameters
    ----------
    rig : Rig
        as read.
    train : Recordings
        the first ones.
    holdout : Recordings
        those held out.
    rate : float | None
        Hz to which faster ones are decimated; by default as fast as the fastest visible pole needs.

    Raises
    ------
    RecordingError
        the same samples twice.
    """
    if rate is not None and not (math.isfinite(rate) and rate > 0.0):
        raise InputError(f"{rate}", field="rate", expected="samples a second, more than 0")
    first = recordings_of(rig, train)
    held = [] if is_nothing(holdout) else recordings_of(rig, holdout, "holdout")
    every = [
        Given(_at_rate(rig, one, rate), quality(one, rig.model, _values(rig, one.name)))
        for one in Experiments.of([*first, *held])
    ]
    return every[: len(first)], every[len(first) :]


def _values(rig: Rig, file: str) -> dict[str, float]:
    """Parameters of a recording: the rig's, and its own."""
    known = {q.name for q in rig.model.parameters}
    own = {name: float(value) for name, value in rig.recordings.get(file, {}).items() if name in known}
    return {**rig.parameters, **own}


def _at_rate(rig: Rig, recording: Recording, rate: float | None) -> Recording:
    """Decimated, with the remaining part of each stated noise: rounding and coloured noise do not average out."""
    slow = brought_down(rig.model, rig.parameters, recording, rate)
    if slow is recording:
        return slow
    channels = dict(slow.channels)
    for role, channel in recording.channels.items():
        if channel.sd and not channel.held:
            left = thinned_noise(channel.sd, channel.values, channels[role].values)
            channels[role] = replace(channels[role], sd=left)
    return replace(slow, channels=channels)


def at_their_rate(rig: Rig, data: Sequence[Given]) -> Rig:
    """The rig with the remaining part of its stated noise, where recordings were decimated.

    Parameters
    ----------
    rig : Rig
        as read.
    data : Sequence[Given]
        of `given`.
    """
    left = {}
    for role, channel in rig.channels.items():
        found = [one.recording[role].sd for one in data if channel.sd and role in one.recording]
        sds = [sd for sd in found if sd]
        if sds:
            left[role] = replace(channel, sd=math.sqrt(sum(sd**2 for sd in sds) / len(sds)))
    same = all(
        math.isclose(one.sd or 0.0, rig.channels[role].sd or 0.0, rel_tol=1e-9) for role, one in left.items()
    )
    return rig if same else replace(rig, channels={**rig.channels, **left})


def of_each(rig: Rig, first: list[Given], *others: list[Given]) -> tuple[Rig, list[list[Given]]]:
    """The rig with the first recordings' own parameters, and all recordings labelled with their group."""
    own = for_recordings(rig, [one.recording for one in first])
    groups = [[replace(one, recording=told(own, one.recording)) for one in some] for some in (first, *others)]
    return own, groups


def refuse_unfit(data: Sequence[Given]) -> None:
    """Refuse data that the check calls unfit.

    Raises
    ------
    NotIdentifiable
        names the recording and the gravest remark.
    """
    for one in data:
        for remark in one.remarks:
            if remark.severity == "error":
                raise NotIdentifiable(
                    f"{one.recording.name}: {remark.message} (nothing was fitted or written)"
                )


def silent(share: float, words: str) -> None:
    """No progress is shown."""


def is_nothing(data: Recordings) -> bool:
    """No recording was given."""
    return data is None or (isinstance(data, (list, tuple)) and not data)


def _recording(rig: Rig, data: Data, field: str, number: int) -> Recording:
    if isinstance(data, Recording):
        return data
    if isinstance(data, (str, Path)):
        return read_file(data, rig)
    if hasattr(data, "columns") and hasattr(data, "iloc"):
        return Recording.from_frame(data, rig, name=f"{field}[{number - 1}]")
    raise InputError(
        f"a {type(data).__name__}",
        field=field,
        expected="a path, a DataFrame, a Recording, or a list of them",
    )
