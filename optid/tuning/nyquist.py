"""Stability and margins of one loop, compiled: poles by Schur and Cohn, the rest along the Nyquist curve."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from optid.armax.stability import roots_inside
from optid.pid.pid_step import DERIVATIVE_FILTER, KD, KI, KP
from optid.tuning.machine import compiled

FIELDS = 5  # and behind them the gain's lower margin and the crossover
STABLE, MS, GAIN, PHASE, DELAY = range(FIELDS)


@compiled
def missed(
    gains: Any, T: Any, a: Any, b: Any, at: Any, plant: Any, back: Any, sums: Any, bounds: Any, out: Any
) -> None:
    """Relative violation of the bounds by each of the gains (n, GAINS); at least 10 for an unstable loop."""
    found = np.empty(FIELDS + 2)
    asked = bounds[MS] < np.inf or bounds[GAIN] > 0.0 or bounds[PHASE] > 0.0 or bounds[DELAY] > 0.0
    for g in range(len(gains)):
        inspect(gains[g], T, a, b, asked, at, plant, back, sums, found)
        if found[STABLE] < 1.0:
            out[g] = 10.0 + found[MS]
            continue
        if not asked:
            out[g] = 0.0
            continue
        worst = max(found[MS] / bounds[MS] - 1.0, 0.0)
        for field in (GAIN, PHASE, DELAY):
            if found[field] < bounds[field]:
                worst = max(worst, 1.0 - found[field] / bounds[field])
        out[g] = worst


@compiled
def inspect(
    gains: Any, T: Any, a: Any, b: Any, asked: Any, at: Any, plant: Any, back: Any, sums: Any, found: Any
) -> None:
    """Stability, Ms, gain, phase and delay margin, the gain's lower margin, and the crossover in rad/s.

    For an unstable loop `found[MS]` is the distance of the poles outside, which guides a search.
    """
    found[:] = 0.0
    stable = _inside(gains, T, a, b, 1.0)
    found[STABLE] = stable
    if stable < 1.0:
        radius = 1.0
        for _ in range(12):
            radius *= 1.1
            if _inside(gains, T, a, b, radius) > 0.0:
                break
        found[MS] = radius - 1.0
        return
    if asked:
        _walk(gains, T, a, b, at, plant, back, sums, found)


@compiled
def _walk(gains: Any, T: Any, a: Any, b: Any, at: Any, plant: Any, back: Any, sums: Any, found: Any) -> None:
    """Walk along the grid; crossings and the nearest approach are refined between its points."""
    smallest, nearest, up, down, phase, delay, cross = np.inf, 0, np.inf, 0.0, 180.0, np.inf, 0.0
    lag = gains[DERIVATIVE_FILTER]
    last, was = 0j, 0.0
    for i in range(at.size):
        slope = (1.0 - back[i]) / (lag + T - lag * back[i])
        L = plant[i] * (gains[KP] + gains[KI] * T * sums[i] + gains[KD] * slope)
        away = (1.0 + L.real) * (1.0 + L.real) + L.imag * L.imag
        size = L.real * L.real + L.imag * L.imag
        if away < smallest:
            smallest, nearest = away, i
        if i > 0 and (L.imag >= 0.0) != (last.imag >= 0.0) and (L.real < 0.0 or last.real < 0.0):
            real = _loop(gains, T, a, b, _crossing(gains, T, a, b, at[i - 1], at[i], False)).real
            if real < -1.0:
                down = max(down, -1.0 / real)
            elif real < 0.0:
                up = min(up, -1.0 / real)
        if i > 0 and (size >= 1.0) != (was >= 1.0):
            w = _crossing(gains, T, a, b, at[i - 1], at[i], True)
            now = _loop(gains, T, a, b, w)
            left = np.arctan2(now.imag, now.real) + np.pi  # towards -pi, as delays lower the phase
            phase = min(phase, min(left, 2.0 * np.pi - left) * 180.0 / np.pi)
            delay = min(delay, left / w * T)
            cross = w / T
        last, was = L, size
    if last.real < 0.0 and last.real > -1.0:  # the Nyquist frequency, where the response is real
        up = min(up, -1.0 / last.real)
    elif last.real <= -1.0:
        down = max(down, -1.0 / last.real)
    if 0 < nearest < at.size - 1:
        smallest = _lowest(gains, T, a, b, at[nearest - 1], at[nearest], at[nearest + 1])
    found[MS], found[GAIN], found[PHASE], found[DELAY] = 1.0 / math.sqrt(smallest), up, phase, delay
    found[FIELDS], found[FIELDS + 1] = down, cross


@compiled
def _loop(gains: Any, T: Any, a: Any, b: Any, w: Any) -> Any:
    """L at one frequency, rad per sample."""
    back, lag = np.exp(-1j * w), gains[DERIVATIVE_FILTER]
    top, bottom, power = 0j, 1.0 + 0j, 1.0 + 0j
    for i in range(a.size):
        power *= back
        top += b[i] * power
        bottom += a[i] * power
    control = gains[KP] + gains[KI] * T / (1.0 - back) + gains[KD] * (1.0 - back) / (lag + T - lag * back)
    return top / bottom * control


@compiled
def _crossing(gains: Any, T: Any, a: Any, b: Any, low: Any, high: Any, unit: Any) -> Any:
    """Where between two frequencies |L| is 1 (`unit`) or L is real: false position (Illinois)."""
    start, end = _loop(gains, T, a, b, low), _loop(gains, T, a, b, high)
    f, g = (abs(start) - 1.0, abs(end) - 1.0) if unit else (start.imag, end.imag)
    middle, side = low, 0
    for _ in range(8):
        if f == g:
            break
        middle = (low * g - high * f) / (g - f)
        here = _loop(gains, T, a, b, middle)
        h = abs(here) - 1.0 if unit else here.imag
        if (h >= 0.0) == (g >= 0.0):
            high, g = middle, h
            f = 0.5 * f if side < 0 else f
            side = -1
        else:
            low, f = middle, h
            g = 0.5 * g if side > 0 else g
            side = 1
    return middle


@compiled
def _lowest(gains: Any, T: Any, a: Any, b: Any, left: Any, middle: Any, right: Any) -> Any:
    """Smallest |1 + L|^2 between two frequencies around one where it is smaller: golden sections."""
    ratio = 0.3819660112501051
    best = abs(1.0 + _loop(gains, T, a, b, middle)) ** 2
    for _ in range(14):
        wider = right - middle > middle - left
        trial = middle + ratio * (right - middle) if wider else middle - ratio * (middle - left)
        value = abs(1.0 + _loop(gains, T, a, b, trial)) ** 2
        if value < best:
            best = value
            if wider:
                left = middle
            else:
                right = middle
            middle = trial
        elif wider:
            right = trial
        else:
            left = trial
    return best


@compiled
def _inside(gains: Any, T: Any, a: Any, b: Any, radius: Any) -> Any:
    """1 if every pole of the closed loop lies within the radius: A (1 - d) (Tf + T - Tf d) + B C, d = 1/z.

    A missing part (ki or kd of 0) has no pole of its own.
    """
    lag, n = gains[DERIVATIVE_FILTER], a.size
    integral, slope = gains[KI] != 0.0, gains[KD] != 0.0
    i1 = -1.0 if integral else 0.0  # 1 - d, or 1
    s0, s1 = (lag + T, -lag) if slope else (1.0, 0.0)
    # Denominator (1 + i1 d)(s0 + s1 d); numerator kp denominator + ki T (s0 + s1 d) + kd (1 - d)(1 + i1 d).
    d0, d1, d2 = s0, s1 + i1 * s0, i1 * s1
    c0, c1, c2 = gains[KP] * d0, gains[KP] * d1, gains[KP] * d2
    if integral:
        c0 += gains[KI] * T * s0
        c1 += gains[KI] * T * s1
    if slope:
        c0 += gains[KD]
        c1 += gains[KD] * (i1 - 1.0)
        c2 -= gains[KD] * i1
    p, work = np.zeros(n + 2), np.empty(2 * n + 4)
    for i in range(n + 2):
        # Coefficient of d^(i + 1).
        at_0 = (a[i] * d0 + b[i] * c0) if i < n else 0.0
        at_1 = (a[i - 1] * d1 + b[i - 1] * c1) if 1 <= i <= n else (d1 if i == 0 else 0.0)
        at_2 = (a[i - 2] * d2 + b[i - 2] * c2) if i >= 2 else (d2 if i == 1 else 0.0)
        p[i] = (at_0 + at_1 + at_2) / d0
    return roots_inside(p, n + 2, radius, work)
