"""Whether a recording moves enough to identify anything, and whether cause comes before effect in it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from optid.core.recording import Recording
from optid.quality.noise import noise_sd
from optid.quality.remark import Remark, Severity

Array = NDArray[np.float64]

SMOOTHING = 0.02  # s over which a speed is taken: shorter than an axis's swing, long enough against noise
_FARTHEST = 0.05  # share of a recording over which a lag is searched
_PAST = 4  # samples from which the next is predicted
_FOLLOWS = 0.1  # share of the mean square that remains; 0.13 for the most strongly coloured noise
_AGAINST = 0.6  # significant correlation opposite to the model's sign
_PLAINER = 1.5  # times the correlation with the model's sign
_PLAIN = 0.85  # correlation in each half of a recording whose sign changes between them
_SAME_LAG = 0.3  # s by which their lags may differ
_FEWEST_HALF = 400  # samples of a half, at least
_NOISES = 5.0  # standard deviations: among a million samples noise alone passes less than once


def still(recording: Recording, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> Iterator[Remark]:
    """Channels that do not move, or no more than their noise does."""
    moving = False
    for role in outputs:
        values = recording[role].values
        span = float(np.nanmax(values) - np.nanmin(values))
        noise = noise_sd(values)
        # A signal of noise alone spans about 8 standard deviations in ten thousand samples, 10 in a million.
        if span == 0.0 or (span < 2 * _NOISES * noise and not _predictable(values)):
            what = (
                "never changes"
                if span == 0.0
                else f"moves by {span:.3g}, no more than its noise of {noise:.2g}"
            )
            yield Remark("still", "error", role, f"{role} {what}: nothing can be identified from it")
        else:
            moving = True
    for role in inputs:
        values = recording[role].values
        if float(np.nanmax(values)) == float(np.nanmin(values)):
            # Free oscillation shows the parameters of motion, but not those of the input.
            grave: Severity = "warning" if moving else "error"
            rest = (
                "only what free motion shows can be identified"
                if moving
                else "nothing can be identified from it"
            )
            yield Remark("still", grave, role, f"{role} never changes: {rest}")


def _predictable(values: Array) -> bool:
    """Each sample follows from the ones before it, as in an oscillation that is fast against the sampling."""
    y = _filled(values) - np.nanmean(values)
    if len(y) < 10 * _PAST:
        return False
    past = np.column_stack([y[_PAST - k - 1 : len(y) - k - 1] for k in range(_PAST)])
    weights, *_ = np.linalg.lstsq(past, y[_PAST:], rcond=None)
    left = y[_PAST:] - past @ weights
    return bool(np.mean(left**2) < _FOLLOWS * np.mean(y**2))


def one_sided(recording: Recording, inputs: tuple[str, ...]) -> Iterator[Remark]:
    """Inputs that never change sign, although they can."""
    for role in inputs:
        channel = recording[role]
        low, high = float(np.nanmin(channel.values)), float(np.nanmax(channel.values))
        if channel.full_scale is not None and low < high and (low >= 0 or high <= 0):
            sign = "positive" if low >= 0 else "negative"
            yield Remark(
                "excitation",
                "warning",
                role,
                f"{role} is always {sign}: one direction says nothing about the other",
            )


def travel(recording: Recording, role: str) -> Iterator[Remark]:
    """How a position moves: back and forth, at more than one speed."""
    values = recording[role].values
    speed, error = _speed(recording, role)
    moving = np.abs(speed) > _NOISES * error
    if not moving.any() or np.nanmax(values) - np.nanmin(values) < 2 * _NOISES * noise_sd(values):
        return  # it does not move, which is reported elsewhere
    direction = np.sign(speed[moving])
    reversals = int((np.diff(direction) != 0).sum())
    if reversals < 2:
        yield Remark(
            "excitation",
            "warning",
            role,
            f"{role} reverses {('never', 'once')[reversals]}: friction cannot be distinguished from a constant force",
        )
    slow, fast = np.percentile(np.abs(speed[moving]), (10, 90))
    # Dry and viscous friction are offset and slope of a line over speed; a single speed does not determine the slope.
    if fast < 2 * slow:
        yield Remark(
            "excitation",
            "warning",
            role,
            f"{role} moves at {slow:.3g} to {fast:.3g} {recording[role].unit}/s for most of the time: this range of "
            "speeds is too narrow to separate dry from viscous friction",
        )


@dataclass(frozen=True)
class Lag:
    """The lag of one signal behind another.

    Attributes:
        seconds: lag of the highest correlation; negative where the effect comes first.
        correlation: the highest, by size.
        causal: the highest at lags of zero and more, by size.
        chance: the highest, by size, at lags where the two must be unrelated.
        scatter: standard deviation of a correlation, by how many independent stretches the record holds.
        rising: the highest correlation of positive sign at lags of zero and more; 0 if none.
        falling: the highest of negative sign there, by size.
        sign: of the highest correlation.
    """

    seconds: float
    correlation: float
    causal: float
    chance: float
    scatter: float
    rising: float = 0.0
    falling: float = 0.0
    sign: int = 1


@dataclass(frozen=True, eq=False)
class _Transformed:
    """A signal of zero mean and unit variance with what its transform gives.

    Attributes:
        spectrum: of the signal padded with as many zeros.
        own: its autocorrelation at lags of 0 to half its length.
    """

    spectrum: NDArray[np.complex128]
    own: Array


def _transformed(signal: Array) -> _Transformed:
    n = len(signal)
    size = _padded(n)
    spectrum = np.fft.rfft((signal - signal.mean()) / (signal.std() or 1.0), size)
    return _Transformed(spectrum, np.fft.irfft(np.abs(spectrum) ** 2, size)[: n // 2] / n)


def _padded(n: int) -> int:
    return 1 << (2 * n - 1).bit_length()


def lag(cause: Array, effect: Array, interval: float) -> Lag:
    """Cross-correlation of two signals, both shape (samples,) and evenly spaced by `interval` s.

    The level of chance is estimated from the same recording, at lags of an eighth to a half of its length.
    """
    return _lag(_transformed(cause), _transformed(effect), len(cause), interval)


def _lag(cause: _Transformed, effect: _Transformed, n: int, interval: float) -> Lag:
    product = np.fft.irfft(np.conj(cause.spectrum) * effect.spectrum, _padded(n))
    lags = np.arange(-(n // 2), n // 2 + 1)
    # Divided by the samples that overlap: a periodic signal then repeats at full height among the far lags.
    signed = product[lags] / (n - np.abs(lags))
    sizes = np.abs(signed)
    reach = max(int(_FARTHEST * n), 1)
    near, far = np.abs(lags) <= reach, np.abs(lags) >= n // 8
    best = int(np.where(near, sizes, 0.0).argmax())
    causal = signed[near & (lags >= 0)]
    return Lag(
        float(lags[best]) * interval,
        float(sizes[best]),
        float(sizes[near & (lags >= 0)].max()),
        float(sizes[far].max()),
        min(float(np.sqrt(np.mean(sizes[far] ** 2))), _standard_error(cause.own, effect.own, n)),
        float(max(causal.max(), 0.0)),
        float(max(-causal.min(), 0.0)),
        1 if signed[best] >= 0 else -1,
    )


def _standard_error(a: Array, b: Array, n: int) -> float:
    """Standard error of the correlation of two unrelated signals from their autocorrelations (Bartlett)."""
    product = a * b
    first = int(np.argmax((a <= 0) | (b <= 0))) or len(product)
    return float(np.sqrt(max(2 * product[:first].sum() - product[0], 1.0) / n))


Responses = tuple[tuple[str, Lag], ...]


def responses(recording: Recording, cause: str, role: str) -> Responses:
    """Value, speed and acceleration of a channel with their lags behind an input, the most correlated one first.

    A plant may respond to a command in any of them. Empty where the input never changes.
    """
    values = _filled(recording[cause].values)
    if values.min() == values.max():
        return ()
    speed, _ = _speed(recording, role)
    answers = {
        role: _filled(recording[role].values),
        f"speed of {role}": speed,
        f"acceleration of {role}": _slope(speed, recording),
    }
    moved, n = _transformed(values), len(values)
    lags = {
        what: _lag(moved, _transformed(signal), n, recording.interval) for what, signal in answers.items()
    }
    return tuple(sorted(lags.items(), key=lambda one: -one[1].correlation))


Look = Callable[[str, str], Responses]  # input, output -> as `responses` returns them


def anticipation(
    recording: Recording, inputs: tuple[str, ...], outputs: tuple[str, ...], look: Look | None = None
) -> Iterator[Remark]:
    """Outputs that move before the command, which indicates channels that are not aligned in time.

    The highest correlation of a response must be at a negative lag and exceed both the level of chance
    and the highest after zero by two standard errors, (1 - r^2) times the scatter of unrelated signals.
    """
    look = look or functools.partial(responses, recording)
    for cause in inputs:
        for role in outputs:
            found = next((one for _, one in look(cause, role)), None)
            if found is None:
                continue
            margin = 2 * max(1 - found.correlation**2, 0.0) * found.scatter
            ahead = found.correlation > max(found.chance, found.causal) + margin
            if ahead and found.seconds < -_halfwidth(recording) * recording.interval:
                yield Remark(
                    "lag",
                    "warning",
                    role,
                    f"{role} moves {-found.seconds:.3g} s before {cause} does: the channels are not aligned in time "
                    f"(correlation {found.correlation:.2f}, at most {found.causal:.2f} in the causal direction)",
                )


def polarity(
    recording: Recording,
    signs: Mapping[tuple[str, str], int],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    look: Look | None = None,
) -> Iterator[Remark]:
    """Outputs that respond to an input with the opposite sign of the model's.

    Value, speed and acceleration may disagree in sign where a plant oscillates or a loop is closed around it: one that
    clearly follows the model rules the fault out.

    Args:
        recording: what was measured.
        signs: (input, output) -> the sign of the model's answer, where it has one.
        inputs: roles.
        outputs: roles.
        look: stored responses, if they were computed before.
    """
    look = look or functools.partial(responses, recording)
    for cause in inputs:
        for role in outputs:
            expected = signs.get((cause, role), 0)
            seen = look(cause, role) if expected else ()
            if not seen:
                continue
            what, found = seen[0]
            follows = any(_correlates(one, expected) for _, one in seen)
            clear = _correlates(found, -expected) and found.correlation > _AGAINST
            turned = _turns(recording, cause, role)
            if turned is not None:
                yield Remark(
                    "polarity",
                    "error",
                    role,
                    f"{what} follows {cause} in one half of the recording and opposes it in the other (correlations "
                    f"{turned[0]:.2f} and {turned[1]:.2f}): one of them changed its sign; cut the file there",
                )
            elif clear and not follows:
                yield Remark(
                    "polarity",
                    "error",
                    role,
                    f"{what} opposes {cause} (correlation {found.sign * found.correlation:.2f}), but follows it in the "
                    f"model: the sign of {cause}, of {role} or of the gain between them in the rig file is wrong",
                )


def _correlates(found: Lag, sign: int) -> bool:
    """A correlation of this sign, beyond chance and clearly above those of the other; the cause comes first."""
    other = found.falling if sign > 0 else found.rising
    return (
        found.sign == sign and found.seconds >= 0 and found.correlation > max(found.chance, _PLAINER * other)
    )


def _turns(recording: Recording, cause: str, role: str) -> tuple[float, float] | None:
    """Correlations in both halves of a recording, where both are clear and they have opposite signs."""
    n = len(recording)
    if n < 2 * _FEWEST_HALF:
        return None
    parts = [recording.taken(rows) for rows in np.array_split(np.arange(n), 2)]
    if any(part[name].missing > 0.5 * len(part) for part in parts for name in (cause, role)):
        return None
    halves = [responses(part, cause, role) for part in parts]
    if not all(halves) or halves[0][0][0] != halves[1][0][0]:
        return None
    first, second = halves[0][0][1], halves[1][0][1]
    if first.sign == second.sign:
        return None
    alike = abs(first.seconds - second.seconds) <= _SAME_LAG * max(abs(first.seconds), abs(second.seconds))
    plain = all(
        one.seconds >= 0 and one.correlation > max(_PLAIN, _PLAINER * min(one.rising, one.falling))
        for one in (first, second)
    )
    return (first.sign * first.correlation, second.sign * second.correlation) if alike and plain else None


def _halfwidth(recording: Recording) -> int:
    return max(round(SMOOTHING / recording.interval / 2), 1)


def _speed(recording: Recording, role: str) -> tuple[Array, float]:
    """A channel's slope and the standard deviation that its noise gives the slope, per s."""
    weight = _slope_weights(recording)
    noise = noise_sd(recording[role].values)
    return _slope(_filled(recording[role].values), recording), noise * float(np.sqrt((weight**2).sum()))


def _slope(values: Array, recording: Recording) -> Array:
    """Slope of a straight line through the samples within `SMOOTHING`, per s, shape (samples,)."""
    padded = np.pad(values, _halfwidth(recording), mode="edge")
    return np.convolve(padded, _slope_weights(recording)[::-1], mode="valid")


def _slope_weights(recording: Recording) -> Array:
    k = np.arange(-_halfwidth(recording), _halfwidth(recording) + 1.0)
    weights: Array = k / (float((k**2).sum()) * recording.interval)
    return weights


def _filled(values: Array) -> Array:
    """Missing samples bridged by straight lines."""
    absent = np.isnan(values)
    if not absent.any():
        return values
    k = np.arange(len(values))
    return np.interp(k, k[~absent], values[~absent])
