"""How often 95 % intervals of an identified model hold the truth: poles, static gain; offsets and trends included.

    python studies/armax_coverage.py [--draws 500] [--samples 1500] [--seed S] [--out FILE.csv]

Each draw is a stable system of order 1 to 3, real poles or a complex pair, with a delay of 1 or 2 samples, a noise
polynomial of its own or, in every third draw, a sensor's noise (C = A); a random binary input around an operating
point; an output with an offset. Every second draw has a trend too, from one that nobody sees to one that dwarfs the
response. It is identified with the true orders by the offline fit; whether a slope is estimated along is left to the
recording, as on the command line. Counted are the moduli of the poles (paired with the nearest true one) and the
static gain, by profile likelihood, as `armax.json` has them, and by the delta method.

With `--out` every draw is kept as a row, and a call goes on where the last one ended.
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
from optid.armax.batch import fit_batch
from optid.armax.profile import Intervals, profile_intervals, wald_intervals
from optid.armax.signals import Signals
from optid.armax.trend import find_trend

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
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    kept = arguments.out is not None and arguments.out.is_file()
    rows = pd.read_csv(arguments.out).to_dict("records") if kept else []
    for k in range(len(rows), arguments.draws):
        rows.append(covered(np.random.default_rng([arguments.seed, k]), arguments.samples, bool(k % 2)))
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


def covered(rng: np.random.Generator, samples: int, trended: bool) -> dict[str, object]:
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
    for kind, intervals in (
        ("profile", profile_intervals([record], model, trend)),
        ("delta", wald_intervals(model)),
    ):
        row[f"poles_{kind}"], row[f"gain_{kind}"] = hits(model, truth, intervals)
    return row


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
