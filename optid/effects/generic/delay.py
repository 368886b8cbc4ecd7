"""A delayed signal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import casadi as ca

from optid.core.model import Array
from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.anywhere import Anywhere
from optid.effects.delay import input_ago

SAMPLES = Parameter(
    "samples",
    "1",
    2.0,
    "delay in sampling intervals",
    "from one sample on",
    0.0,
    (0.0, 100.0),
)
# A search decimates recordings, and a model is used on other ones: the law keeps its own sampling interval.
INTERVAL = Parameter(
    "interval",
    "s",
    1e-3,
    "sampling interval in which the delay is counted; 0 for the recording's own",
    "that of the recordings in which it was found",
    0.0,
    (0.0, math.inf),
    fitted=False,
)
STAGES = 4


class Delay(Anywhere):
    """A delayed input; any other signal through four lags in series, each (1 + T p) / (1 + (t + T) p).

    p = d/dt, t a quarter of the delay, T a sampling interval.
    """

    kind = "delay"
    parameters = (SAMPLES, INTERVAL)
    strength = {"samples": 0.5}
    # Inside a hold: at its end, an input that switches there has no slope with respect to its delay.
    usual = tuple({"samples": samples, "interval": 0.0} for samples in (1.5, 7.5, 30.0))
    law = "the delayed signal; a signal other than an input is also smoothed over a quarter of the delay"
    says = "the signal is delayed by {samples} samples of {interval}"
    needs = "signals that change fast"
    look_alikes = ("sensor_lag",)
    experiment = "apply steps and sample fast"
    # The skew between channels is within a sample; from position alone it cannot be distinguished from a delay.
    resolved = MappingProxyType({"samples": 0.5})

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The delayed signal."""
        own = self.own(INTERVAL, near, sheet)
        sample = ca.if_else(own > 0, own, sheet.interval())
        time = sample * self.own(SAMPLES, near, sheet)
        if (role := sheet.input_at(nominal)) is not None:
            return input_ago(sheet, nominal, time, role)
        lag = time / STAGES
        for stage in range(STAGES):
            s = sheet.state(f"stage_{stage + 1}", "1", near["size"], spread=2 * near["size"])
            rate = (nominal - s) / (sample + lag)
            sheet.rate(s, rate)
            nominal = s + sample * rate
        return nominal

    def tries(self, heard: Sequence[Array], interval: float) -> Sequence[Mapping[str, float]]:
        """The usual delays in these recordings' samples."""
        return [{**point, INTERVAL.name: interval} for point in self.usual]
