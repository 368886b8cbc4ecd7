"""Recordings with their predictions as tables and as entries of a document."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from optid.core.recording import Recording
from optid.estimation.prediction import Prediction
from optid.quality.remark import Remark
from optid.rigs.per_recording import measured_inputs
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Exhibit:
    """One recording as a result shows it.

    Attributes
    ----------
    use : str
        "training", "held out" or "simulated".
    recording : Recording
        as read.
    prediction : Prediction
        of that recording.
    remarks : tuple[Remark, ...]
        of the check.
    """

    use: str
    recording: Recording
    prediction: Prediction
    remarks: tuple[Remark, ...]


def about(rig: Rig, exhibits: Sequence[Exhibit]) -> dict[str, Any]:
    """Rig, recordings and outputs of a prediction, for a document."""
    shown = [one.recording for one in exhibits]
    return {
        "rig": rig.name,
        "rig_file": str(rig.path),
        "plant": rig.model_name,
        "horizon": max(one.prediction.horizon for one in exhibits),
        "outputs": {
            port.role: port.unit
            for port in rig.model.outputs
            if any(port.role in recording for recording in shown)
        },
        "channel_inputs": {
            port.role: shown[0][port.role].recorded_unit for port in measured_inputs(rig.model)
        },
        "sensor_noise": {
            role: channel.sd for role, channel in rig.channels.items() if channel.sd is not None
        },
        "recordings": [_entry(one) for one in exhibits],
    }


def _entry(one: Exhibit) -> dict[str, Any]:
    recording, source = one.recording, one.recording.provenance
    return {
        "name": recording.name,
        "path": str(source.path) if source else recording.name,
        "use": one.use,
        "samples": len(recording),
        "duration": recording.duration,
        "rate": recording.rate,
        "sha256": source.sha256 if source else None,
        "notes": list(source.notes) if source else [],
        "remarks": [{"severity": r.severity, "message": r.message} for r in one.remarks],
    }


def prediction_table(exhibits: Sequence[Exhibit]) -> pd.DataFrame:
    """All predictions, one row per sample: use, recording, and the columns of `Prediction.frame`."""
    import pandas as pd

    parts = []
    for one in exhibits:
        frame = one.prediction.frame.reset_index(drop=True)
        frame.insert(0, "recording", one.recording.name)
        frame.insert(0, "use", one.use)
        parts.append(frame)
    return pd.concat(parts, ignore_index=True)


def input_table(rig: Rig, exhibits: Sequence[Exhibit]) -> pd.DataFrame:
    """The inputs of the recordings: recording, time (s), and each input as recorded."""
    import pandas as pd

    roles = [port.role for port in measured_inputs(rig.model)]
    parts = [
        pd.DataFrame(
            {
                "recording": one.recording.name,
                "time": one.recording.time,
                **{role: one.recording[role].recorded for role in roles},
            }
        )
        for one in exhibits
    ]
    return pd.concat(parts, ignore_index=True)
