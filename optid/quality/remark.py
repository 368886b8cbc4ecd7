"""A remark on data: what was seen, where, and how much it matters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["note", "warning", "error"]


@dataclass(frozen=True)
class Remark:
    """One thing about a recording that its user should know.

    Attributes:
        kind: "gap", "jitter", "slow", "missing", "saturated", "beyond_scale", "quantised", "clipped",
            "stuck", "lag", "still", "excitation", "repaired", "jump", "outliers", "polarity", "feedback", "tied" or
            "reach".
        severity: "note" does no harm by itself, "warning" bends results, "error" makes a fit pointless.
        channel: role of the channel, or "time".
        message: a plain sentence with the numbers, in SI units.
        interval: from and to, s on the recording's clock, where one stretch stands for the remark.
    """

    kind: str
    severity: Severity
    channel: str
    message: str
    interval: tuple[float, float] | None = None
