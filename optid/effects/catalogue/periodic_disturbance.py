"""A periodic force independent of the axis: an unbalanced fan, a compressor, a neighbouring machine."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from optid.core.model import Array
from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

AMPLITUDE = Parameter("amplitude", "N", 3.0, "amplitude of the force", "usual: 1 to 30 N", 0.0, (0.0, 1e3))
FREQUENCY = Parameter(
    "frequency",
    "Hz",
    3.0,
    "frequency of the force",
    "usual: 0.2 to 30 Hz",
    3.0,
    (0.05, 200.0),
    logarithmic=True,
)


PHASE = Parameter(
    "phase",
    "1",
    1.0,
    "mean phase at the start of a recording, rad; every recording has its own around it",
    "any",
    0.0,
    (-7.0, 7.0),
)
THIRD = {
    name: Parameter(
        f"third_{name}",
        "1",
        0.1,
        f"third harmonic in {words} the fundamental, as a share of the amplitude",
        "a vane or a slack drive pushes harder during a part of the turn",
        0.0,
        (-0.5, 0.5),
    )
    for name, words in (("in_phase", "phase with"), ("across", "quadrature to"))
}
SCATTER = Parameter(
    "scatter",
    "1",
    0.3,
    "scatter of the quadratures between recordings, sd as a share of the amplitude",
    "1 where recordings begin at any time, near 0 where force and recording begin together",
    1.0,
    (0.002, 1.0),
    fitted=False,
)
ALIKE = 0.3  # scatter up to which recordings share their phase
PURE = {"third_in_phase": 0.0, "third_across": 0.0, "scatter": 1.0}  # start value of the search
TINY = 1e-9
LOUDEST = 3  # lines of a spectrum that are tried
NEIGHBOURS = 41  # bins of the spectrum whose median a line is compared with


class PeriodicDisturbance(Effect):
    """A sin(2 pi f t + phase) and its third harmonic; each recording has its own part of both quadratures.

    These parts are constant states. The force is nearly linear in them, so that a filter finds a recording's phase
    from any start. If the recordings turn out to share one phase, it is known for others even while the axis is at
    rest.
    """

    name = "periodic_disturbance"
    sites = ("force.external",)
    equation = "11"
    parameters = (AMPLITUDE, FREQUENCY, PHASE, *THIRD.values(), SCATTER)
    strength = {"amplitude": 0.6}
    usual = tuple(
        {"amplitude": 4.0, "frequency": f, "phase": phase, **PURE}
        for f in (0.4, 0.8, 1.6, 3.2, 6.4, 12.0, 24.0)
        for phase in (0.0, math.pi)
    )
    law = "a force A (sin a + b sin 3 a + c cos 3 a), a = 2 pi f t + phase"
    says = (
        "a force of {amplitude} oscillates at {frequency}, independently of the axis (phase {phase} rad, scatter "
        "between recordings {scatter} of the amplitude; third harmonic {third_in_phase} in phase, {third_across} in "
        "quadrature)"
    )
    depends_on = ("time",)
    needs = "several of its periods"
    look_alikes = ("constant_force", "friction_drift")
    experiment = (
        "change the period of the reference: a line in the spectrum that stays does not come from the axis"
    )
    source = "a sinusoid with its third harmonic"

    def tries(self, heard: Sequence[Array], interval: float) -> Sequence[Mapping[str, float]]:
        """The strongest lines of the mean spectrum, at four phases each: a fit finds a frequency only from nearby."""
        from scipy.fft import next_fast_len  # loaded when there is something to search
        from scipy.ndimage import median_filter
        from scipy.signal import argrelmax, periodogram

        n = next_fast_len(4 * max(len(e) for e in heard))
        spectra = [periodogram(np.nan_to_num(e), 1 / interval, "hann", nfft=n) for e in heard]
        f, power = spectra[0][0], np.mean([p / p.mean() for _, p in spectra], axis=0)
        clear = power / (median_filter(power, NEIGHBOURS, mode="nearest") + 1e-12 * power.max())
        low, high = FREQUENCY.bounds
        clear[(f < max(low, 3 / (max(map(len, heard)) * interval))) | (f > high)] = 0.0
        lines = [i for i in argrelmax(clear, order=8)[0] if clear[i] > 0]
        best = sorted(lines, key=lambda i: -clear[i])[:LOUDEST]
        return [
            {"amplitude": 4.0, "frequency": float(f[i]), "phase": quarter * math.pi / 2, **PURE}
            for i in best
            for quarter in (-1, 0, 1, 2)
        ]

    def centred(self, values: Mapping[str, float], shown: Mapping[str, Array]) -> Mapping[str, float]:
        """Amplitude and phase of the recordings' mean force, or their mean amplitude where phases differ.

        The states may represent any part of the force, so that the split is arbitrary after a fit.
        """
        a, b = np.cos(values["phase"]) + shown["sine"], np.sin(values["phase"]) + shown["cosine"]
        mean, power = np.hypot(a.mean(), b.mean()), float(np.mean(a**2 + b**2))
        apart = math.sqrt(max(power - mean**2, 0.0) / 2 * len(a) / max(len(a) - 1, 1)) / max(mean, TINY)
        alike = len(a) > 1 and apart <= ALIKE
        ahead = math.atan2(b.mean(), a.mean()) - values["phase"]
        return {
            "amplitude": values["amplitude"] * (float(mean) if alike else math.sqrt(power)),
            "phase": values["phase"] + math.remainder(ahead, 2 * math.pi),
            "scatter": max(apart, SCATTER.bounds[0]) if alike else SCATTER.bounds[1],
        }

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """External force, N."""
        scatter = sheet.param(SCATTER)
        sine, cosine = (sheet.state(name, "1", 0.3, spread=scatter) for name in ("sine", "cosine"))
        for own in (sine, cosine):
            sheet.rate(own, 0.0)
        phase, turns = sheet.param(PHASE), 2 * math.pi * sheet.param(FREQUENCY) * sheet.clock()
        a, b = ca.cos(phase) + sine, ca.sin(phase) + cosine
        swing, across = a * ca.sin(turns) + b * ca.cos(turns), a * ca.cos(turns) - b * ca.sin(turns)
        squared = a**2 + b**2 + TINY  # sin 3 a = 3 sin a - 4 sin^3 a, cos 3 a = 4 cos^3 a - 3 cos a
        third = sheet.param(THIRD["in_phase"]) * (3 * swing - 4 * swing**3 / squared)
        third += sheet.param(THIRD["across"]) * (4 * across**3 / squared - 3 * across)
        return nominal + sheet.param(AMPLITUDE) * (swing + third)
