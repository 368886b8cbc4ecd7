"""How often 95 % intervals of an identified model hold the truth: poles, static gain; offsets and trends included.

    python studies/armax_coverage.py [--draws 500] [--samples 1500] [--seed S]

Each draw is a stable system of order 1 to 3 with a noise polynomial of the same order, a binary input around an
operating point and an output with offset and, in every second draw, a trend; identified with the true orders by the
offline fit, constant and slope being estimated along where the recording shows one. Counted are the moduli of the
poles (paired with the nearest true one) and the static gain.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.armax import Armax, Orders
from optid.armax.audit import pole_errors, static_gain_error
from optid.armax.batch import fit_batch
from optid.armax.signals import Signals
from optid.armax.trend import find_trend


def main() -> None:
    """Draw, identify, count."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--draws", type=int, default=500)
    parser.add_argument("--samples", type=int, default=1500)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    held = [covered(rng, arguments.samples, bool(k % 2)) for k in range(arguments.draws)]
    poles = [hit for own, _ in held for hit in own]
    gains = [hit for _, hit in held]
    for name, hits in (("poles", poles), ("static gain", gains)):
        share = float(np.mean(hits))
        margin = 1.96 * np.sqrt(share * (1 - share) / len(hits))
        print(f"{name}: {100 * share:.1f} % of {len(hits)} intervals hold the truth (± {100 * margin:.1f})")


def drawn(rng: np.random.Generator) -> Armax:
    """A system with poles between 0.3 and 0.97, apart from each other, and a quiet noise polynomial."""
    n = int(rng.integers(1, 4))
    poles = np.array([0.97, 0.75, 0.45])[:n] - 0.1 * rng.random(n)
    a, c = np.poly(poles), np.poly(0.6 * rng.random(n) - 0.3)
    b = rng.uniform(0.5, 1.5, n) * np.sum(a)
    return Armax(tuple(a), (tuple(b),), tuple(c), (1,))


def covered(rng: np.random.Generator, samples: int, trended: bool) -> tuple[list[bool], bool]:
    """Whether the intervals of each pole's modulus and of the static gain hold the truth."""
    truth = drawn(rng)
    u = np.where(np.cumsum(rng.random(samples) < 0.05) % 2, 1.0, -1.0)
    y = lfilter(np.r_[0.0, truth.b[0]], truth.a, u) + lfilter(
        truth.c, truth.a, 0.05 * rng.standard_normal(samples)
    )
    y = y + 20.0 + (5.0 * np.arange(samples) / samples if trended else 0.0)
    record = Signals(y, (u + 3.0)[:, None])
    orders = Orders.of(truth.orders.na, truth.orders.na, truth.orders.na)
    model = fit_batch([record], orders, trend=find_trend([record], orders)).model
    poles, true_poles = np.roots(model.a).astype(complex), np.roots(truth.a).astype(complex)
    hits = []
    for pole, sd in zip(poles, pole_errors(model, poles), strict=True):
        nearest = true_poles[int(np.argmin(np.abs(true_poles - pole)))]
        hits.append(bool(abs(abs(pole) - abs(nearest)) <= 1.96 * sd))
    gain, true_gain = (sum(m.b[0]) / sum(m.a) for m in (model, truth))
    return hits, bool(abs(gain - true_gain) <= 1.96 * static_gain_error(model))


if __name__ == "__main__":
    main()
