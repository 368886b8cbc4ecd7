"""How often 95 % intervals of an identified model hold the truth: poles, static gain; offsets and trends included.

    python studies/armax_coverage.py [--draws 500] [--samples 1500] [--seed S] [--at-truth] [--out FILE.csv]

Each draw is a stable system of order 1 to 3, real poles or a complex pair, with a delay of 1 or 2 samples, a noise
polynomial of its own or, in every third draw, a sensor's noise (C = A); a random binary input around an operating
point; an output with an offset. Every second draw has a trend too, from one that nobody sees to one that dwarfs the
response. It is identified with the true orders by the offline fit; whether a slope is estimated along is left to the
recording, as on the command line. Counted are the moduli of the poles (paired with the nearest true one) and the
static gain, by profile likelihood, as `armax.json` has them, and by the delta method.

With `--at-truth` no interval's ends are looked for: the truth is inside if holding it costs no more likelihood than the
interval's limit, which takes a fifth of the time. With `--out` every draw is kept as a row, and a call goes on where
the last one ended.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.armax import Armax, Orders
from optid.armax.batch import fit_batch, placed
from optid.armax.constraints import Constraint, fixed_gain, fixed_pair, fixed_pole
from optid.armax.profile import Intervals, Place, Profile, profile_intervals, wald_intervals
from optid.armax.signals import Signals
from optid.armax.trend import Trend, find_trend

TWO_SIDED = 1.96
NOISE = 0.05  # innovation, where the response to the input has an amplitude of about 1
TRENDS = (-2.0, 1.0)  # decades of what a trend adds from the first sample to the last


def main() -> None:
    """Draw, identify, count."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=500)
    parser.add_argument("--samples", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--at-truth", action="store_true", help="look at the truth alone, not for ends")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    kept = arguments.out is not None and arguments.out.is_file()
    rows = pd.read_csv(arguments.out).to_dict("records") if kept else []
    for k in range(len(rows), arguments.draws):
        rng = np.random.default_rng([arguments.seed, k])
        rows.append(covered(rng, arguments.samples, bool(k % 2), at_truth=arguments.at_truth))
        if arguments.out is not None and (k % 10 == 9 or k == arguments.draws - 1):
            pd.DataFrame(rows).to_csv(arguments.out, index=False)
    table = pd.DataFrame(rows[: arguments.draws])
    tell("all draws", table)
    for name, part in table.groupby(table["trend"] != 0.0):
        tell("with a trend" if name else "without a trend", part)
    for name, part in table.groupby("noise"):
        tell(f"{name} noise", part)


def tell(name: str, table: pd.DataFrame) -> None:
    """The share of intervals that hold the truth, with the margin of its own that the count leaves."""
    for kind in ("profile", "delta"):
        shares = []
        for held, of in (
            (table[f"poles_{kind}"].sum(), table["poles"].sum()),
            (table[f"gain_{kind}"].sum(), len(table)),
        ):
            share = held / of
            margin = TWO_SIDED * np.sqrt(share * (1 - share) / of)
            shares.append(f"{100 * share:.1f} % of {of} (± {100 * margin:.1f})")
        print(f"{name}, {kind}: poles {shares[0]}, static gain {shares[1]}")


def drawn(rng: np.random.Generator) -> tuple[Armax, str]:
    """A system with poles between 0.3 and 0.97, apart from each other, and what its noise is."""
    n = int(rng.integers(1, 4))
    poles = (np.array([0.97, 0.75, 0.45])[:n] - 0.1 * rng.random(n)).astype(complex)
    if n > 1 and rng.random() < 0.5:  # two of them become a pair
        pole = rng.uniform(0.75, 0.95) * np.exp(1j * rng.uniform(0.15, 1.0))
        poles[-2:] = pole, np.conj(pole)
    a = np.real(np.poly(poles))
    of_sensor = rng.random() < 1 / 3
    c = a if of_sensor else np.poly(0.6 * rng.random(n) - 0.3)
    b = rng.uniform(0.5, 1.5, n) * np.sum(a) / n
    delay = int(rng.integers(1, 3))
    return Armax(tuple(a), (tuple(b),), tuple(c), (delay,)), "sensor" if of_sensor else "process"


def covered(
    rng: np.random.Generator, samples: int, trended: bool, *, at_truth: bool = False
) -> dict[str, object]:
    """How many of the poles' intervals, and whether the static gain's, hold the truth."""
    truth, noise = drawn(rng)
    u = np.where(np.cumsum(rng.random(samples) < 0.05) % 2, 1.0, -1.0)
    y = lfilter(np.r_[np.zeros(truth.nk[0]), truth.b[0]], truth.a, u) + lfilter(
        truth.c, truth.a, NOISE * rng.standard_normal(samples)
    )
    rise = 10.0 ** rng.uniform(*TRENDS) * rng.choice([-1.0, 1.0]) if trended else 0.0
    y = y + 20.0 + rise * np.arange(samples) / samples
    record = Signals(y, (u + 3.0)[:, None])
    orders = Orders.of(truth.orders.na, truth.orders.na, truth.orders.na, truth.nk[0])
    trend = find_trend([record], orders)
    model = fit_batch([record], orders, trend=trend).model
    row: dict[str, object] = {
        "order": truth.orders.na,
        "noise": noise,
        "trend": rise,
        "slope": trend.name,
        "poles": truth.orders.na,
    }
    of = wald_intervals(model)
    row["poles_delta"], row["gain_delta"] = hits(model, truth, of)
    if at_truth:
        found = held_at_truth(record, model, truth, trend)
    else:
        found = hits(model, truth, profile_intervals([record], model, trend))
    row["poles_profile"], row["gain_profile"] = found
    return row


def held_at_truth(record: Signals, model: Armax, truth: Armax, trend: Trend) -> tuple[int, bool]:
    """How many of the poles, and whether the static gain, may be what they are in truth."""
    frame, problem, theta = placed([record], model, trend)
    profile, orders, unit = Profile.around(problem, theta), frame.full_orders, frame.output / frame.inputs[0]
    near = frame.entered(truth.theta)
    extra = np.arange(trend.value) + orders.c_block.start - trend.value
    near[extra] = theta[extra]

    def held(here: tuple[Constraint, float], there: tuple[Constraint, float]) -> bool:
        limit = profile.limit(*here)
        tried = (profile.nearest(there[0], Place(start, there[1], 0.0)) for start in (theta, near))
        return min(place.growth for place in tried) <= limit**2

    def fixed(pole: complex) -> tuple[Constraint, float]:
        if not pole.imag:
            return fixed_pole(orders, pole.real), 0.0
        return fixed_pair(orders, abs(pole)), float(abs(np.angle(pole)))

    true_poles = np.roots(truth.a).astype(complex)
    count = 0
    for pole in np.roots(model.a).astype(complex):
        count += held(fixed(pole), fixed(true_poles[int(np.argmin(np.abs(true_poles - pole)))]))
    found, real = (sum(m.b[0]) / sum(m.a) / unit for m in (model, truth))
    return count, held((fixed_gain(orders, 0, found), 0.0), (fixed_gain(orders, 0, real), 0.0))


def hits(model: Armax, truth: Armax, intervals: Intervals) -> tuple[int, bool]:
    """How many of the poles' intervals, and whether the static gain's, hold the truth."""
    poles, true_poles = np.roots(model.a).astype(complex), np.roots(truth.a).astype(complex)
    held = 0
    for pole, (low, high) in zip(poles, intervals.poles, strict=True):
        held += bool(low <= abs(true_poles[int(np.argmin(np.abs(true_poles - pole)))]) <= high)
    low, high = intervals.static_gains[0]
    return held, bool(low <= sum(truth.b[0]) / sum(truth.a) <= high)


if __name__ == "__main__":
    main()
