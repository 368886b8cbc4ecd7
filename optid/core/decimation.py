"""Decimation of fast recordings to the lowest rate that still resolves the axis, without aliasing of noise."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from optid.core.model import CLOCK, INTERVAL, Model
from optid.core.recording import GAP, Array, Recording, held
from optid.core.simulation import simulate

Integers = NDArray[np.int64]

# Hz: pressures take milliseconds, and averaging over a millisecond changes a position by less than a micrometre.
FASTEST = 1000.0
WHOLE = 0.75  # of a filter's weight that must be measured for its result to count
SAMPLES = 10  # samples per period of the fastest pole
MOST = 5.0  # times FASTEST: a faster pole (a sticking contact) is left to the integrator
SHARE = 0.01  # of the response from which a pole counts
_LOBES = 8  # new samples that the low-pass reaches to either side
_ROLL_OFF = 0.4  # it falls off between 1 - this and 1 + this, in the new Nyquist frequency
_GRID = 1000  # frequencies over which its response is integrated
_ALONG = 1 << 17  # samples simulated to find the poles
_POINTS = 24  # of the motion at which the model is linearised


@dataclass(frozen=True)
class Rate:
    """The rate to which recordings are decimated, and why.

    Attributes:
        hz: samples a second.
        why: in words.
    """

    hz: float
    why: str


def brought_down(
    model: Model, parameters: Mapping[str, float], recording: Recording, rate: float | None = None
) -> Recording:
    """A recording decimated to the requested rate, or to that of `needed_rate`; its notes say what was done.

    Args:
        model: the plant.
        parameters: SI values by name.
        recording: as read.
        rate: Hz; chosen where absent. A slower recording comes back as it is.
    """
    commands = [port.role for port in model.recorded]
    if recording.rate < 2 * (rate or FASTEST) * (1 - 1e-6):
        return recording
    chosen = Rate(rate, "as asked for") if rate else needed_rate(model, parameters, recording)
    slow = decimated(recording, commands, chosen.hz)
    if slow is recording or slow.provenance is None:
        return slow
    note = (
        f"decimated from {recording.rate:.6g} to {slow.rate:.6g} samples a second behind a low-pass ({chosen.why}); "
        "--rate sets another rate"
    )
    return replace(slow, provenance=replace(slow.provenance, notes=(*slow.provenance.notes, note)))


def needed_rate(model: Model, parameters: Mapping[str, float], recording: Recording) -> Rate:
    """The rate that the fastest visible pole requires.

    The model is simulated along the recording and linearised at points of it; at each point the fastest pole that
    makes at least `SHARE` of some measured output's response counts.

    Args:
        model: the plant.
        parameters: SI values by name.
        recording: with the model's inputs.
    """
    poles = [pole for pole in _fastest_poles(model, parameters, recording) if math.isfinite(pole)]
    if not poles:
        return Rate(FASTEST, "which resolves all that the axis does")
    pole = float(np.median(poles)) / (2 * math.pi)
    hz = min(max(FASTEST, SAMPLES * pole), MOST * FASTEST)
    return Rate(float(f"{hz:.3g}"), f"the fastest visible pole lies at {pole:.3g} Hz")


def _fastest_poles(model: Model, parameters: Mapping[str, float], recording: Recording) -> list[float]:
    """rad/s, at points of the motion."""
    p = model.vector(dict(parameters))
    coarse = decimated(recording, [port.role for port in model.recorded])
    coarse = coarse.part(0, min(len(coarse), _ALONG))
    dt = np.diff(coarse.time, append=coarse.time[-1] + coarse.interval)
    columns = []
    for port in model.inputs:
        if port.role in (INTERVAL, CLOCK):
            columns.append(dt if port.role == INTERVAL else coarse.time - coarse.time[0])
        else:
            columns.append(held(coarse[port.role].values))
    inputs = np.column_stack(columns) if columns else np.zeros((len(coarse), 0))
    run = simulate(model, p, np.array(model.start(p)[0]).ravel(), dt, inputs, tolerance=1e-4).states[0]
    x, u, q = ca.SX.sym("x", len(model.states)), ca.SX.sym("u", len(model.inputs)), ca.DM(p)
    rates, outputs = model.rates(x, u, q), model.sensors(x, u, q)
    slopes = ca.Function(
        "slopes",
        [x, u],
        [ca.densify(s) for s in (ca.jacobian(rates, x), ca.jacobian(rates, u), ca.jacobian(outputs, x))],
    )
    rows = np.linspace(0, len(run) - 1, _POINTS).astype(int)
    points = [(run[k], inputs[k]) for k in rows if np.isfinite(run[k]).all()]
    found = []
    for state, command in points:
        A, B, C = (np.array(m) for m in slopes(state, command))
        found.append(_fastest(A, B, C, model.scales))
    return found


def _fastest(A: Array, B: Array, C: Array, scales: Array) -> float:
    """rad/s: the fastest pole with a share of some output's response to some input."""
    if not (np.isfinite(A).all() and np.isfinite(B).all() and np.isfinite(C).all()) or not B.size:
        return math.nan
    A, B, C = A / scales[:, None] * scales, B / scales[:, None], C * scales
    poles, right = np.linalg.eig(A)
    try:
        left = np.linalg.inv(right)
    except np.linalg.LinAlgError:
        return math.nan
    residues = np.abs(C @ right)[:, None, :] * np.abs(left @ B).T[None, :, :]
    largest = residues.max(axis=2, keepdims=True)
    shows = (residues > SHARE * np.where(largest > 0, largest, np.inf)).any(axis=(0, 1))
    return float(np.abs(poles[shows]).max()) if shows.any() else math.nan


def decimated(recording: Recording, commands: Iterable[str], fastest: float = FASTEST) -> Recording:
    """A recording of at most about `fastest` samples a second; slower ones come back as they are.

    Measured channels pass a zero-phase low-pass that ends about half the new rate; their noise falls by averaging and
    stays as white as it was. Held ones are averaged over the time until the next sample, which keeps their
    impulse. Each stretch between gaps is decimated separately.

    Args:
        recording: evenly sampled but for gaps.
        commands: their roles; they hold from each sample to the next.
        fastest: Hz.
    """
    count = int(recording.rate / fastest * (1 + 1e-6))
    if count < 2 or len(recording) < 4 * count:
        return recording
    inputs = {*commands, *(role for role, channel in recording.channels.items() if channel.held)}
    cuts = np.flatnonzero(np.diff(recording.time) > GAP * recording.interval) + 1
    edges = [0, *cuts.tolist(), len(recording)]
    parts = [(a, b) for a, b in itertools.pairwise(edges) if b - a >= count]
    if len(parts) * 4 * count > len(recording) or not parts:
        return recording  # gaps everywhere: the sampling is not even
    rows = np.concatenate([np.arange(a, b - count + 1, count) for a, b in parts])
    channels = {}
    for role, channel in recording.channels.items():
        apart = 1 if role in inputs else _rows_apart(channel.values)
        bring = _averaged if role in inputs else _placed if apart >= count else _filtered
        values = [bring(channel.values[a:b], count) for a, b in parts]
        averaged = bring is _filtered and channel.sd is not None
        weight = min(float(np.linalg.norm(_low_pass(count))) * math.sqrt(apart), 1.0) if averaged else 1.0
        sd = channel.sd if channel.sd is None else channel.sd * weight
        channels[role] = replace(channel, values=np.concatenate(values), sd=sd)
    return replace(recording, time=recording.time[rows], channels=channels)


def _rows_apart(values: Array) -> int:
    """Usual number of rows from one sample of a channel to the next: more than one if its own rate is slower."""
    known = np.flatnonzero(np.isfinite(values))
    return int(np.median(np.diff(known))) if len(known) > 1 else 1


def _placed(values: Array, count: int) -> Array:
    """The samples of a channel slower than the new rate, each at the nearest new row and moved there by its slope."""
    found = np.full(len(range(0, len(values) - count + 1, count)), np.nan)
    known = np.flatnonzero(np.isfinite(values))
    if not len(known):
        return found
    slope = np.gradient(values[known], known) if len(known) > 1 else np.zeros(1)
    near = np.clip(np.round(known / count).astype(int), 0, len(found) - 1)
    off = near * count - known
    close = np.abs(off) <= count / 2
    found[near[close]] = (values[known] + slope * off)[close]
    return found


def _low_pass(count: int) -> Array:
    """Weights of a root-raised-cosine low-pass, windowed (Kaiser, 50 dB); they sum to one.

    White noise stays white: the filter's autocorrelation vanishes at every multiple of `count`. Half of its power
    passes at half the new rate.
    """
    k = np.arange(-_LOBES * count, _LOBES * count + 1) / count
    rate = np.linspace(0.0, 0.5 + 0.5 * _ROLL_OFF, _GRID)
    falling = np.clip((rate - 0.5) / _ROLL_OFF + 0.5, 0.0, 1.0)
    weights = np.trapezoid(np.cos(0.5 * math.pi * falling) * np.cos(2.0 * math.pi * k[:, None] * rate), rate)
    weights = weights * np.kaiser(len(k), 4.5)
    return np.asarray(weights / weights.sum())


def _filtered(values: Array, count: int) -> Array:
    known = np.isfinite(values)
    rows = np.arange(0, len(values) - count + 1, count)
    if not known.any():
        return values[rows]
    weights = _low_pass(count)
    half = len(weights) // 2
    at = np.arange(float(len(values)))
    filled = values if known.all() else np.interp(at, at[known], values[known])
    apart = _rows_apart(values)
    if apart > 1:  # between samples of a slower rate nothing is missing
        last = np.searchsorted(at[known], at, side="right")
        before, after = at[known][np.clip(last - 1, 0, None)], at[known][np.clip(last, None, known.sum() - 1)]
        filled = _beyond_ends(filled, np.flatnonzero(known))
        known = (np.abs(after - before) <= 1.5 * apart) & (np.abs(at - before) <= apart)
    # Beyond its ends the signal is continued by odd reflection, which keeps a slope.
    reach = min(half, len(filled) - 1)
    before, after = 2 * filled[0] - filled[reach:0:-1], 2 * filled[-1] - filled[-2 : -reach - 2 : -1]
    padded = np.concatenate((before, filled, after))
    result = _at_rows(padded, weights, rows + reach, half)
    if known.all():
        return result
    share = _at_rows(
        np.concatenate((np.ones(reach), known.astype(float), np.ones(reach))), weights, rows + reach, half
    )
    return np.where(share > WHOLE, result, np.nan)


def _beyond_ends(filled: Array, known: Integers) -> Array:
    """Extrapolate linearly before the first and after the last known sample, over one spacing."""
    changed = filled.copy()
    for end, neighbour, rows in (
        (known[0], known[1], np.arange(known[0])),
        (known[-1], known[-2], np.arange(known[-1] + 1, len(filled))),
    ):
        slope = (filled[end] - filled[neighbour]) / (end - neighbour)
        reach = np.clip(rows - end, -abs(end - neighbour), abs(end - neighbour))
        changed[rows] = filled[end] + slope * reach
    return changed


def _at_rows(padded: Array, weights: Array, rows: Integers, half: int) -> Array:
    """The weighted sums around some rows only."""
    found = np.zeros(len(rows))
    for k, weight in enumerate(weights):
        found += weight * padded[np.clip(rows + k - half, 0, len(padded) - 1)]
    return found


def _averaged(values: Array, count: int) -> Array:
    blocks = len(values) // count
    filled = held(values)[: blocks * count].reshape(blocks, count)
    known = np.isfinite(values)[: blocks * count].reshape(blocks, count)
    return np.where(known.mean(axis=1) > WHOLE, filled.mean(axis=1), np.nan)


def at_samples_of(recording: Recording, role: str, commands: Iterable[str]) -> Recording:
    """A recording at the rows where one channel is measured, if that has a slower, regular rate of its own.

    Commands are averaged from each of these rows to the next, which keeps their impulse.

    Args:
        recording: with the channel.
        role: of the channel.
        commands: roles that hold from sample to sample.
    """
    rows = np.flatnonzero(np.isfinite(recording[role].values))
    if len(rows) < 8 or len(rows) > 0.7 * len(recording):
        return recording
    apart = np.diff(rows)
    usual = float(np.median(apart))
    if usual < 2 or float(np.mean(np.abs(apart - usual) <= max(1.0, 0.1 * usual))) < 0.8:
        return recording
    inputs, channels = set(commands), {}
    for name, channel in recording.channels.items():
        if name not in inputs:
            channels[name] = replace(channel, values=channel.values[rows])
            continue
        filled = held(channel.values)
        sums = np.add.reduceat(filled, rows)
        counts = np.diff(rows, append=len(recording))
        means = sums / counts
        means[-1] = filled[rows[-1]]
        channels[name] = replace(channel, values=means)
    return replace(recording, time=recording.time[rows], channels=channels)
