"""The frequency response of a recording without a model, with its coherence; and that of a model.

Welch's averaged spectra (IEEE Trans. Audio Electroacoust. 15, 1967). In a closed loop Phi_yu / Phi_uu mixes the plant
with the controller's inverse; with a recorded reference r the response is Phi_yr / Phi_ur instead, which is not biased
by noise in the loop (Ljung, System Identification, 2nd ed. 1999, sec. 6.4 and 13.5).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optid.armax.model import Armax
from optid.armax.signals import Signals
from optid.core.model import Array

Complex = NDArray[np.complex128]

SEGMENTS = 16  # at least, half overlapping
SHORTEST, LONGEST = 64, 8192  # samples of a segment
LARGEST = 400_000  # samples used


@dataclass(frozen=True, eq=False)
class FrequencyResponse:
    """A measured response.

    Attributes:
        frequency: Hz, shape (n,).
        response: output per input, shape (n,).
        coherence: from 0 to 1, shape (n,): the share of the output's power explained by the input, or the reference.
        relative_error: standard deviation of |response| as a share of it, from coherence and averages, shape (n,).
        by_reference: whether the reference was used.
        averages: approximate number of independent segments.
    """

    frequency: Array
    response: Complex
    coherence: Array
    relative_error: Array
    by_reference: bool
    averages: float


def measured_response(
    record: Signals, sample_time: float, input: int = 0, reference: Array | None = None
) -> FrequencyResponse | None:
    """The response from one input to the output; None where too few samples are contiguous.

    Args:
        record: recording; its longest stretch without a missing sample is used.
        sample_time: seconds.
        input: which.
        reference: of a closed loop, shape (N,); None for an open one, or where it was not recorded.
    """
    from scipy.signal import csd, detrend

    u = record.u[:, input]
    columns = (
        [record.y, u]
        if reference is None or not np.ptp(reference[np.isfinite(reference)])
        else [record.y, u, reference]
    )
    first, last = _longest_run(np.asarray(np.isfinite(np.column_stack(columns)).all(axis=1)))
    last = min(last, first + LARGEST)
    length = 1 << int(np.log2(max((last - first) // SEGMENTS, 1)))
    length = min(length, LONGEST)
    if length < SHORTEST:
        return None
    parts = [column[first:last] for column in columns]

    def spectrum(x: Array, y: Array) -> Complex:
        """Phi_yx: conj(X) Y averaged."""
        return np.asarray(csd(x, y, 1.0 / sample_time, "hann", length, detrend=detrend)[1][1:])

    frequency: Array = np.arange(1.0, length // 2 + 1) / (length * sample_time)
    by_reference = len(parts) == 3
    source = parts[2] if by_reference else parts[1]
    over = spectrum(source, parts[1])
    across, power = spectrum(source, parts[0]), np.real(spectrum(source, source))
    with np.errstate(all="ignore"):
        coherence = np.abs(across) ** 2 / (power * np.real(spectrum(parts[0], parts[0])))
        if by_reference:  # a reference that hardly affects the input gives no estimate
            coherence = np.minimum(
                coherence, np.abs(over) ** 2 / (power * np.real(spectrum(parts[1], parts[1])))
            )
        coherence = np.clip(np.nan_to_num(coherence), 0.0, 1.0)
        averages = 0.53 * (2 * (last - first) / length - 1)  # of half-overlapping Hann windows
        error: Array = np.sqrt((1.0 - coherence) / np.maximum(2.0 * averages * coherence, 1e-300))
        response = across / over
    told = np.isfinite(response)
    return FrequencyResponse(
        frequency[told], response[told], coherence[told], error[told], by_reference, float(averages)
    )


def model_response(model: Armax, frequency: Array, input: int = 0) -> Complex:
    """B/A at frequencies in Hz, shape (n,)."""
    back = np.exp(-2j * np.pi * np.asarray(frequency) * model.sample_time)
    numerator = np.polyval(np.array(model.b[input])[::-1], back) * back ** model.nk[input]
    return np.asarray(numerator / np.polyval(np.array(model.a)[::-1], back))


def step_response(model: Armax, samples: int, input: int = 0) -> Array:
    """Of B/A from rest, shape (samples,)."""
    from scipy.signal import lfilter

    taps = np.concatenate([np.zeros(model.nk[input]), model.b[input]])
    return np.asarray(lfilter(taps, np.array(model.a), np.ones(samples)))


def _longest_run(known: NDArray[np.bool_]) -> tuple[int, int]:
    edges = np.flatnonzero(np.diff(np.r_[False, known, False].astype(int)))
    starts, ends = edges[::2], edges[1::2]
    if not starts.size:
        return 0, 0
    best = int(np.argmax(ends - starts))
    return int(starts[best]), int(ends[best])
