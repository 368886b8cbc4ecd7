"""A remark on data: what was found, where, and how serious it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["note", "warning", "error"]


@dataclass(frozen=True)
class Remark:
    """One finding on the quality of a recording.

    Attributes:
        kind: "gap", "jitter", "slow", "missing", "saturated", "beyond_scale", "quantised", "clipped",
            "stuck", "lag", "still", "excitation", "repaired", "jump", "outliers", "polarity", "feedback", "tied" or
            "reach".
        severity: "note" is harmless by itself, "warning" biases results, "error" makes a fit useless.
        channel: role of the channel, or "time".
        message: a plain sentence with the numbers, in SI units.
        interval: from and to, s on the recording's clock, where the remark concerns one stretch.
    """

    kind: str
    severity: Severity
    channel: str
    message: str
    interval: tuple[float, float] | None = None
