"""Is a recording fit for identification? Looked at before any solve, so that a bad one costs no hour."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from optid.core.decimation import FASTEST, decimated
from optid.core.model import Model
from optid.core.recording import Recording
from optid.quality.faults import jumps, outliers, repaired
from optid.quality.feedback import feedback, single_line, tied
from optid.quality.motion import Lag, answer, anticipation, one_sided, polarity, still, travel
from optid.quality.reach import reach
from optid.quality.remark import Remark
from optid.quality.response import signs
from optid.quality.sampling import enough, gaps, missing, pace
from optid.quality.sensors import constant_runs, quantisation, saturation

_LONG, _SOME = 1 << 20, 4  # samples of a part of a long recording; parts that show how its sensors are
_SLOWEST, _MANY = 100.0, 1 << 18  # Hz and samples at which the motion in a long recording is looked at
_RANK = {"error": 0, "warning": 1, "note": 2}
_ALIKE = 0.3  # correlation from which a lag means something
_ANGLES = ("m", "rad")  # positions: what has them cannot jump


def quality(
    recording: Recording, model: Model, parameters: Mapping[str, float] | None = None
) -> tuple[Remark, ...]:
    """Every remark on a recording's channels that a model uses, the gravest first; empty when all is well.

    Args:
        recording: as read.
        model: its inputs and outputs say which channels are causes and which effects. Outputs in metres are
            looked at as positions.
        parameters: SI values by name, for the sign of the model's answer; typical ones where absent.

    Raises:
        RecordingError: an input of the model is not recorded.
    """
    inputs = tuple(recording[port.role].role for port in model.recorded)
    outputs = tuple(port.role for port in model.outputs if port.role in recording)
    absent = (*missing(recording, inputs, outputs), *enough(recording, inputs, outputs), *repaired(recording))
    # A stretch of a recording may hold no sample of a channel: that is said, and all there is to say.
    inputs, outputs = (
        tuple(role for role in roles if recording[role].missing < len(recording))
        for roles in (inputs, outputs)
    )
    commanded = np.flatnonzero(recording.commanded())
    if 2 <= len(commanded) < len(recording):
        recording = recording.taken(commanded)
        inputs, outputs = (
            tuple(role for role in roles if recording[role].missing < len(recording))
            for roles in (inputs, outputs)
        )
    found = [*absent, *_remarks(recording, model, inputs, outputs, parameters)]
    return tuple(sorted(found, key=lambda remark: _RANK[remark.severity]))


def _remarks(
    recording: Recording,
    model: Model,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    parameters: Mapping[str, float] | None,
) -> list[Remark]:
    positions = tuple(port.role for port in model.outputs if port.unit == "m" and port.role in outputs)
    angular = tuple(port.role for port in model.outputs if port.unit in _ANGLES and port.role in outputs)
    # How an axis moves shows as well at a kilohertz; what its sensors do shows in their own samples only.
    slow = _slow(recording, inputs)
    look = functools.cache(functools.partial(answer, slow))
    parts = _stretches(recording)
    some = (
        parts
        if len(parts) <= _SOME
        else tuple(parts[k] for k in np.linspace(0, len(parts) - 1, _SOME, dtype=int))
    )
    return [
        *gaps(recording),
        *_together(some, lambda one: pace(one, outputs)),
        *still(slow, inputs, outputs),
        *_together(parts, lambda one: saturation(one, inputs)),
        *one_sided(recording, inputs),
        *(remark for role in positions for remark in travel(slow, role)),
        *reach(recording, model, parameters),
        *_together(some, lambda one: quantisation(one, outputs)),
        *_together(some, lambda one: constant_runs(one, outputs)),
        *_together(parts, lambda one: jumps(one, outputs, angular)),
        *_together(parts, lambda one: outliers(one, outputs)),
        *anticipation(slow, inputs, outputs, look),
        *polarity(slow, signs(model, parameters, slow), inputs, outputs, look),
        *feedback(recording, inputs, outputs),
        *single_line(slow, inputs),
        *tied(slow, inputs),
    ]


def _slow(recording: Recording, inputs: tuple[str, ...]) -> Recording:
    """A long recording at the rate at which its motion is looked at."""
    return decimated(recording, inputs, min(FASTEST, max(_SLOWEST, _MANY / recording.duration)))


def lags(recording: Recording, model: Model) -> Iterator[tuple[str, str, Lag]]:
    """By how much what is measured follows each input, where they resemble each other beyond chance.

    Args:
        recording: as read.
        model: its inputs and outputs say which channels are causes and which effects.

    Yields:
        What answers (an output, or its speed or acceleration), the input, and by how much it follows.
    """
    inputs = tuple(dict.fromkeys(port.role for port in model.inputs if port.role in recording))
    slow = _slow(recording.part(0, min(len(recording), 2 * _LONG)), inputs)
    for cause, port in itertools.product(inputs, model.outputs):
        answered = answer(slow, cause, port.role) if port.role in recording else None
        if answered is not None and answered[1].correlation > max(answered[1].chance, _ALIKE):
            yield answered[0], cause, answered[1]


def _stretches(recording: Recording) -> tuple[Recording, ...]:
    """A long recording in parts: what is made of one takes little beside it."""
    count = -(-len(recording) // _LONG)
    if count == 1:
        return (recording,)
    return tuple(
        recording.part(a, b)
        for a, b in itertools.pairwise(len(recording) * k // count for k in range(count + 1))
    )


def _together(parts: Sequence[Recording], look: Callable[[Recording], Iterable[Remark]]) -> Iterator[Remark]:
    """The remarks on parts of a recording; of those of one kind on one channel the first one, and how many follow."""
    found: dict[tuple[str, str, str], list[Remark]] = {}
    for part in parts:
        for remark in look(part):
            found.setdefault((remark.kind, remark.severity, remark.channel), []).append(remark)
    for several in found.values():
        if len(parts) == 1:
            yield from several
            continue
        more = f" (and in {len(several) - 1} more parts of the recording)" if len(several) > 1 else ""
        yield replace(several[0], message=several[0].message + more)
