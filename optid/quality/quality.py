"""Check whether a recording is fit for identification, before any long computation."""

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
from optid.quality.motion import Lag, anticipation, one_sided, polarity, responses, still, travel
from optid.quality.reach import reach
from optid.quality.remark import Remark
from optid.quality.response import signs
from optid.quality.sampling import enough, gaps, missing, pace
from optid.quality.sensors import constant_runs, quantisation, saturation

_LONG, _SOME = 1 << 20, 4  # samples of a part of a long recording; number of parts that show its sensors
_SLOWEST, _MANY = 100.0, 1 << 18  # Hz and samples at which the motion of a long recording is examined
_RANK = {"error": 0, "warning": 1, "note": 2}
_ALIKE = 0.3  # correlation from which a lag is meaningful
_ANGLES = ("m", "rad")  # units of positions, which cannot jump


def quality(
    recording: Recording, model: Model, parameters: Mapping[str, float] | None = None
) -> tuple[Remark, ...]:
    """All remarks on a recording's channels that a model uses, the most serious first; empty if there are none.

    Args:
        recording: as read.
        model: its inputs and outputs say which channels are causes and which effects. Outputs in metres are treated as
            positions.
        parameters: SI values by name, for the sign of the model's answer; typical ones where absent.

    Raises:
        RecordingError: an input of the model is not recorded.
    """
    inputs = tuple(recording[port.role].role for port in model.recorded)
    outputs = tuple(port.role for port in model.outputs if port.role in recording)
    absent = (*missing(recording, inputs, outputs), *enough(recording, inputs, outputs), *repaired(recording))
    # A stretch without a sample of a channel gets only that remark.
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
    # The motion of an axis is visible at 1 kHz; faults of its sensors only in their own samples.
    slow = _slow(recording, inputs)
    look = functools.cache(functools.partial(responses, slow))
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
    """A long recording at the rate at which its motion is examined."""
    return decimated(recording, inputs, min(FASTEST, max(_SLOWEST, _MANY / recording.duration)))


def lags(recording: Recording, model: Model) -> Iterator[tuple[str, str, Lag]]:
    """The lag of each measured signal behind each input, where they are significantly correlated.

    Args:
        recording: as read.
        model: its inputs and outputs say which channels are causes and which effects.

    Yields:
        The response (an output, or its speed or acceleration), the input, and the lag.
    """
    inputs = tuple(dict.fromkeys(port.role for port in model.inputs if port.role in recording))
    slow = _slow(recording.part(0, min(len(recording), 2 * _LONG)), inputs)
    for cause, port in itertools.product(inputs, model.outputs):
        for what, found in responses(slow, cause, port.role)[:1] if port.role in recording else ():
            if found.correlation > max(found.chance, _ALIKE):
                yield what, cause, found


def _stretches(recording: Recording) -> tuple[Recording, ...]:
    """A long recording in parts, so that intermediate arrays stay small."""
    count = -(-len(recording) // _LONG)
    if count == 1:
        return (recording,)
    return tuple(
        recording.part(a, b)
        for a, b in itertools.pairwise(len(recording) * k // count for k in range(count + 1))
    )


def _together(parts: Sequence[Recording], look: Callable[[Recording], Iterable[Remark]]) -> Iterator[Remark]:
    """The remarks on parts of a recording, merged: the first of each kind and channel, with the number of others."""
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
