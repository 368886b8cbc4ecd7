"""A signal that comes late."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.anywhere import Anywhere

SAMPLES = Parameter(
    "samples",
    "1",
    2.0,
    "delay in sampling intervals of the recording",
    "from one sample on",
    0.0,
    (0.0, 100.0),
)
STAGES = 4


class Delay(Anywhere):
    """Four lags in a row, each (1 + T p) / (1 + (t + T) p): p = d/dt, t a quarter of the delay, T a sample."""

    kind = "delay"
    parameters = (SAMPLES,)
    strength = {"samples": 0.5}
    usual = ({"samples": 2.0}, {"samples": 8.0}, {"samples": 30.0})
    law = "the signal of some time ago, smoothed by a quarter of that time"
    says = "the signal comes {samples} samples late"
    needs = "signals that change fast"
    experiment = "steps, sampled fast"

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The late signal."""
        sample = sheet.interval()
        lag = sample * self.own(SAMPLES, near, sheet) / STAGES
        for stage in range(STAGES):
            s = sheet.state(f"stage_{stage + 1}", "1", near["size"], spread=2 * near["size"])
            rate = (nominal - s) / (sample + lag)
            sheet.rate(s, rate)
            nominal = s + sample * rate
        return nominal
