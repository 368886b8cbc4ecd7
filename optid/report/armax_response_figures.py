"""Figures of identified models' responses: frequency response, poles and zeros, step response."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from optid.armax.candidate import Candidate
from optid.armax.frequency import FrequencyResponse, model_response, step_response
from optid.armax.model import Armax
from optid.armax.physical import PhysicalPole
from optid.report.figures import ALARM, FREE, INK, QUIET, STYLE, WINDOW
from optid.report.interactive import interactive

COLOURS = (WINDOW, FREE, ALARM, "#6a4c93", "#4c8c4a", QUIET)
TRUSTED = 0.5  # coherence above which a measured point is drawn in full colour
POINTS = 400
STEP_SAMPLES = (40, 4000)  # of the step response, at least and at most


def bode(
    models: Sequence[Armax], measured: FrequencyResponse | None, gain_unit: str, input: int = 0
) -> Markup:
    """Magnitude, phase and coherence: models as lines, the measured response as dots.

    Args:
        models: one colour each.
        measured: from the same input; None where there is none.
        gain_unit: output's over input's.
        input: which.
    """
    nyquist = 0.5 / models[0].sample_time
    low = measured.frequency[0] if measured is not None else nyquist / 1000
    grid = np.geomspace(low, nyquist, POINTS)
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 5.4), layout="constrained")
        top, middle, bottom = figure.subplots(3, 1, sharex=True, height_ratios=(2.4, 1.7, 1))
        if measured is not None:
            _measured(top, middle, bottom, measured)
        for model, colour in zip(models, COLOURS, strict=False):
            response = model_response(model, grid, input)
            top.loglog(grid, np.abs(response), color=colour, lw=1.2, label=f"order {model.orders.na}")
            middle.semilogx(grid, _degrees(response), color=colour, lw=1.2)
        top.set_ylabel(f"gain ({gain_unit})" if gain_unit else "gain")
        middle.set_ylabel("phase (°)")
        bottom.set_ylabel("coherence")
        bottom.set_ylim(0, 1.05)
        bottom.set_xlabel("frequency (Hz)")
        top.legend(loc="lower left", ncols=6, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        figure.align_ylabels()
        return interactive(figure)


def _measured(top: Any, middle: Any, bottom: Any, measured: FrequencyResponse) -> None:
    strong = measured.coherence >= TRUSTED
    size, phase = np.abs(measured.response), _degrees(measured.response)
    top.set_ylim(0.2 * size.min(), 5.0 * size.max())
    for axis, values in ((top, size), (middle, phase)):
        axis.plot(measured.frequency[~strong], values[~strong], ".", color=QUIET, ms=2.5, alpha=0.5)
        label = "measured, by the reference" if measured.by_reference else "measured"
        axis.plot(measured.frequency[strong], values[strong], ".", color=INK, ms=3.5, label=label)
    spread = 1.96 * measured.relative_error[strong]
    low = size[strong] * np.maximum(1.0 - spread, 1e-3)
    top.vlines(measured.frequency[strong], low, size[strong] * (1.0 + spread), color=INK, lw=0.5, alpha=0.5)
    bottom.plot(measured.frequency, measured.coherence, color=INK, lw=0.8)
    bottom.axhline(TRUSTED, color=QUIET, lw=0.8)


def _degrees(response: Any) -> Any:
    angle = np.degrees(np.unwrap(np.angle(response)))
    return angle - 360.0 * np.round(angle[0] / 360.0)


def pole_zero_map(candidates: Sequence[Candidate], physical: Sequence[PhysicalPole]) -> Markup:
    """Poles (crosses) with their intervals and zeros (rings) in z, one panel an order; squares are the rig's own."""
    circle = np.exp(1j * np.linspace(0, 2 * np.pi, 400))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 3.3), layout="constrained")
        panels = figure.subplots(1, len(candidates), squeeze=False)[0]
        for axis, candidate, colour in zip(panels, candidates, COLOURS * 10, strict=False):
            axis.plot(circle.real, circle.imag, color=QUIET, lw=0.8)
            own = [(p.discrete, p.discrete.conjugate()) for p in physical]
            flat = np.array([z for pair in own for z in pair if abs(z) < 3])
            if flat.size:
                axis.plot(flat.real, flat.imag, "s", mfc="none", color=INK, ms=9, label="rig's equations")
            poles = np.roots(np.array(candidate.model.a)).astype(complex)
            zeros = np.array([z for z in candidate.audit.zeros if abs(z) < 3])
            axis.plot(poles.real, poles.imag, "x", color=colour, ms=7, label="poles")
            if zeros.size:
                axis.plot(zeros.real, zeros.imag, "o", mfc="none", color=colour, ms=6, label="zeros")
            for pole, (low, high) in zip(poles, candidate.intervals.poles, strict=True):
                if np.isfinite(low + high) and high - low < 2.0 and abs(pole) > 0:
                    ends = pole / abs(pole) * np.array([low, high])
                    axis.plot(ends.real, ends.imag, color=colour, lw=2.5, alpha=0.3)
            axis.set_aspect("equal", "datalim")
            axis.set_title(f"order {candidate.order}", loc="left", fontsize=9, color="#4a525c")
        panels[0].legend(loc="lower left", ncols=3, bbox_to_anchor=(0.2, 1.0), borderaxespad=0.2, fontsize=7)
        return interactive(figure)


def steps(models: Sequence[Armax], unit: str, factor: float, input: int = 0) -> Markup:
    """Response to a step of the input, one line per model.

    Args:
        models: one colour each.
        unit: of output over input; `factor` converts the models to it.
        factor: see `unit`.
        input: which.
    """
    longest = max((_memory(model) for model in models), default=STEP_SAMPLES[0])
    samples = int(np.clip(longest, *STEP_SAMPLES))
    time = np.arange(samples) * models[0].sample_time
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(9.2, 2.5), layout="constrained")
        axis = figure.subplots()
        for model, colour in zip(models, COLOURS, strict=False):
            with np.errstate(all="ignore"):
                response = factor * step_response(model, samples, input)
            if np.all(np.abs(response) < 1e9):
                axis.plot(time, response, color=colour, lw=1.2, label=f"order {model.orders.na}")
        axis.set_xlabel("time (s)")
        axis.set_ylabel(f"step response ({unit})" if unit else "step response")
        axis.legend(loc="lower left", ncols=6, bbox_to_anchor=(0, 1.0), borderaxespad=0.2)
        return interactive(figure)


def _memory(model: Armax) -> int:
    """Samples until the slowest stable pole has decayed."""
    moduli = np.abs(np.roots(np.array(model.a)))
    inside = moduli[(moduli < 0.9999) & (moduli > 1e-6)]
    return int(6.0 / -np.log(inside.max())) if inside.size else STEP_SAMPLES[0]
