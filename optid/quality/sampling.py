"""Time and completeness: gaps, jitter, a rate that is too low, missing samples."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from optid.core.recording import GAP, LONG_GAP, Recording
from optid.quality.noise import noise_sd
from optid.quality.remark import Remark

WINDOW = 0.5  # s, length of the predicted windows: one without data cannot be judged
FEWEST = 50  # samples with a command and a measured output: fewer are not a recording


def gaps(recording: Recording) -> Iterator[Remark]:
    """Remarks on gaps in time."""
    found = recording.gaps()
    if found:
        longest = max(found, key=lambda gap: gap[1] - gap[0])
        size = longest[1] - longest[0]
        held = size <= LONG_GAP * recording.interval
        yield Remark(
            "gap",
            "note" if held else "warning",
            "time",
            f"{len(found)} gaps between samples, the longest {size:.3g} s "
            f"({size / recording.interval:.0f} sampling intervals): "
            + ("the command is held during them" if held else "the recording is cut there"),
            longest,
        )


def pace(recording: Recording, outputs: tuple[str, ...]) -> Iterator[Remark]:
    """Remarks on jitter and rate.

    Args:
        recording: what was measured.
        outputs: roles whose motion decides whether they matter.
    """
    for role in outputs:
        if recording[role].missing < len(recording):
            yield from _pace(recording, role)


def _pace(recording: Recording, role: str) -> Iterator[Remark]:
    """Jitter and rate, weighed by their influence on one channel."""
    values, intervals = recording[role].values, np.diff(recording.time)
    steps = np.diff(values)
    whole = np.isfinite(steps) & (intervals < GAP * recording.interval)
    if whole.sum() < 20:
        return
    noise, spread = noise_sd(values), float(np.nanstd(values))
    # A sample taken early or late has an error of speed times the time error; below the noise, or below 0.01 % of the
    # signal, this is not visible.
    jitter = float(np.std(intervals[whole]))
    speed = float(np.percentile(np.abs(steps[whole]) / intervals[whole], 95))
    if jitter * speed > max(noise, 1e-4 * spread):
        yield Remark(
            "jitter",
            "warning",
            role,
            f"sampling intervals scatter by {jitter:.2g} s around {recording.interval:.4g} s, which at the "
            f"speed of {role} matters more than its noise: methods that assume equal intervals will be biased",
        )
    # A sine whose steps are half its standard deviation has about 12 samples in a period.
    moved = math.sqrt(max(float(np.mean(steps[whole] ** 2)) - 2 * noise**2, 0.0))
    if moved > 0.5 * spread:
        yield Remark(
            "slow",
            "warning",
            role,
            f"{role} has fewer than 12 samples per oscillation: sample faster than {recording.rate:.4g} Hz",
        )


def missing(recording: Recording, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> Iterator[Remark]:
    """Remarks on missing samples of each channel, and whether enough is left."""
    for role in (*inputs, *outputs):
        absent = np.isnan(recording[role].values)
        if not absent.any() or (role in outputs and own_stride(absent) > 1):
            continue
        start, stop = max(runs(absent), key=lambda run: run[1] - run[0])
        last = min(stop, len(absent) - 1)
        interval = (float(recording.time[start]), float(recording.time[last]))
        length = interval[1] - interval[0]
        held = stop - start <= LONG_GAP
        tail = (
            (": the last value is held" if held else ": nothing is simulated there") if role in inputs else ""
        )
        yield Remark(
            "missing",
            "warning" if role in inputs or length >= WINDOW else "note",
            role,
            f"{int(absent.sum())} samples of {role} are missing ({100 * absent.mean():.2f} %), "
            f"at most {stop - start} in a row{tail}",
            interval,
        )


def enough(recording: Recording, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> Iterator[Remark]:
    """Whether there is a stretch with a command and a measured output that is worth a fit."""
    commanded = recording.commanded()
    for role in inputs:
        commanded &= np.isfinite(recording[role].values) | (not recording[role].held)
    measured = np.zeros(len(recording), dtype=bool)
    for role in outputs:
        measured |= np.isfinite(recording[role].values)
    whole = int((commanded & measured).sum())
    seconds = float(commanded.sum()) * recording.interval
    read = recording.provenance.rows_read if recording.provenance else len(recording)
    if whole >= min(FEWEST, read) and (seconds >= 2 * WINDOW or whole > 0.5 * read):
        return
    yield Remark(
        "missing",
        "error",
        outputs[0] if outputs else "time",
        f"only {whole} of {read} samples have both a command and a measured output ({seconds:.3g} s): too few to "
        "fit or to test",
    )


def own_stride(absent: np.ndarray) -> int:
    """Rows from one sample of a channel to the next where they come regularly, else 1."""
    known = np.flatnonzero(~absent)
    if len(known) < 8 or len(known) > 0.7 * len(absent):
        return 1
    apart = np.diff(known)
    usual = round(float(np.median(apart)))
    return usual if usual > 1 and float(np.mean(np.abs(apart - usual) <= max(1, 0.1 * usual))) > 0.8 else 1


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of true flags as (first, one past the last), in order."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flags, [False])).astype(np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
