"""Whether the inputs were independent: not computed from the output alone, not a single sine, not copies."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from optid.core.recording import Recording
from optid.quality.noise import noise_sd
from optid.quality.remark import Remark

Array = NDArray[np.float64]

REFERENCE = "reference"
_EXPLAINED = 0.999  # of an input's mean square that past outputs explain
_PAST = 3  # samples of the output, the newest among them, from which a controller may compute
_CARRIED = 0.5  # of the output's noise through such a law: if the input contains it, it comes from there
_LINE = 0.98  # of an input's power within one line
_ALIKE = 0.9995  # correlation of two inputs that cannot be separated
_FEW = 50  # samples, below which nothing is judged
_LONGEST = 1 << 18  # samples looked at


def feedback(recording: Recording, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> Iterator[Remark]:
    """An input that is a function of measured outputs, with nothing else that moves it.

    Plant and inverse controller then explain the data alike (Ljung, System Identification, 13.4; Söderström and
    Stoica, chapter 10). A moving reference breaks the tie.
    """
    if REFERENCE in recording and float(np.nanstd(recording[REFERENCE].values)) > 0:
        return
    for cause in inputs:
        u = recording[cause].values[:_LONGEST]
        for role in outputs:
            y = recording[role].values[:_LONGEST]
            if _computed(u, y) or _computed(np.diff(u), y[1:]):
                yield Remark(
                    "feedback",
                    "warning",
                    cause,
                    f"{cause} can be computed from {role} ({100 * _EXPLAINED:.1f} % of it or more): it comes from a "
                    "controller that nothing else excites, so plant and inverse controller cannot be distinguished; "
                    "record again with a moving reference or a test signal added to the command",
                )
                break


def _computed(u: Array, y: Array) -> bool:
    """Whether the input follows from the newest outputs so closely that even their noise is in it."""
    if len(y) < _FEW + _PAST:
        return False
    rows = np.column_stack(
        [*(y[_PAST - 1 - k : len(y) - k] for k in range(_PAST)), np.ones(len(y) - _PAST + 1)]
    )
    target = u[_PAST - 1 :]
    for shift in (0, 1):  # from the sample itself, or from those before it
        left, right = (rows, target) if not shift else (rows[:-1], target[1:])
        whole = np.isfinite(left).all(axis=1) & np.isfinite(right)
        a, b = left[whole], right[whole]
        if len(b) < _FEW or float(np.var(b)) == 0.0:
            return False
        law, *_ = np.linalg.lstsq(a, b, rcond=None)
        rest = float(np.sqrt(np.mean((b - a @ law) ** 2)))
        noise = noise_sd(y) * float(np.linalg.norm(law[:_PAST]))
        if rest**2 < (1 - _EXPLAINED) * float(np.var(b)) and rest < _CARRIED * noise:
            return True
    return False


def single_line(recording: Recording, inputs: tuple[str, ...]) -> Iterator[Remark]:
    """An input that is a single sine: it determines only gain and phase at its frequency."""
    for role in inputs:
        u = recording[role].values[:_LONGEST]
        u = u[np.isfinite(u)]
        if len(u) < 64 or np.ptp(u) == 0.0:
            continue
        power = np.abs(np.fft.rfft((u - u.mean()) * np.hanning(len(u)))) ** 2
        top = int(power.argmax())
        line = float(power[max(top - 2, 0) : top + 3].sum() / power.sum())
        cycles = top
        if line > _LINE and cycles >= 3 and len(np.unique(u[:2000])) > 8:
            frequency = top / (len(u) * recording.interval)
            yield Remark(
                "excitation",
                "warning",
                role,
                f"{role} is a single sine of {frequency:.4g} Hz: it determines gain and phase at this frequency and "
                "nothing else; record with a multisine, steps or a random signal",
            )


def tied(recording: Recording, inputs: tuple[str, ...]) -> Iterator[Remark]:
    """Inputs that move together."""
    for a, b in itertools.combinations(inputs, 2):
        u, v = recording[a].values, recording[b].values
        whole = np.isfinite(u) & np.isfinite(v)
        u, v = u[whole], v[whole]
        if len(u) < 10 or np.ptp(u) == 0.0 or np.ptp(v) == 0.0:
            continue
        r = float(np.corrcoef(u, v)[0, 1])
        if abs(r) > _ALIKE:
            yield Remark(
                "tied",
                "warning",
                b,
                f"{a} and {b} move together (correlation {r:.4f}): their effects cannot be separated; move "
                "them at different times",
            )
