"""Is a recording fit for identification? Looked at before any solve, so that a bad one costs no hour."""

from __future__ import annotations

from optid.core.model import Model
from optid.core.recording import Recording
from optid.quality.motion import anticipation, one_sided, still, travel
from optid.quality.remark import Remark
from optid.quality.sampling import missing, sampling
from optid.quality.sensors import constant_runs, quantisation, saturation

_RANK = {"error": 0, "warning": 1, "note": 2}


def quality(recording: Recording, model: Model) -> tuple[Remark, ...]:
    """Every remark on a recording's channels that a model uses, the gravest first; empty when all is well.

    Args:
        recording: as read.
        model: its inputs and outputs say which channels are causes and which effects. Outputs in metres are
            looked at as positions.

    Raises:
        RecordingError: an input of the model is not recorded.
    """
    inputs = tuple(recording[port.role].role for port in model.recorded)
    outputs = tuple(port.role for port in model.outputs if port.role in recording)
    absent = tuple(missing(recording, inputs, outputs))
    # A stretch of a recording may hold no sample of a channel: that is said, and all there is to say.
    inputs, outputs = (
        tuple(role for role in roles if recording[role].missing < len(recording))
        for roles in (inputs, outputs)
    )
    positions = [port.role for port in model.outputs if port.unit == "m" and port.role in outputs]
    found = [
        *absent,
        *sampling(recording, outputs),
        *still(recording, inputs, outputs),
        *saturation(recording, inputs),
        *one_sided(recording, inputs),
        *(remark for role in positions for remark in travel(recording, role)),
        *quantisation(recording, outputs),
        *constant_runs(recording, outputs),
        *anticipation(recording, inputs, outputs),
    ]
    return tuple(sorted(found, key=lambda remark: _RANK[remark.severity]))
