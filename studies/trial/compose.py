"""Which cases a draw holds: kinds in fixed shares, every effect at every size in turn, conditions at random."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from studies.independent_rig import Controller, Sensors
from studies.trial.case import KINDS, SIZES, Case, Hidden
from studies.trial.excitation import STYLES
from studies.trial.named import NAMED
from studies.trial.outside import OUTSIDE
from studies.trial.sizes import Draw

SHARES = {"nothing": 0.20, "single": 0.50, "pair": 0.18, "outside": 0.12}
NOISE = {"low": (0.01e-3, 200.0), "usual": (0.03e-3, 500.0), "high": (0.1e-3, 1500.0)}  # sd, m and Pa
TWELVE_BITS = 0.26 / 4096  # m: a potentiometer of the stroke's length behind a common converter
REACH, FAR = (
    (0.09, 0.105),
    0.12,
)  # m; cushioning shows only near the ends, which even an overshoot should not hit


def compose(seed: int, count: int, kinds: Sequence[str] = KINDS) -> list[Case]:
    """The cases of a draw, in an order that says nothing.

    Args:
        seed: makes everything.
        count: of cases.
        kinds: those to draw; the shares of the others go to them.
    """
    rng = np.random.default_rng(seed)
    total = sum(SHARES[kind] for kind in kinds)
    bounds = np.round(np.cumsum([SHARES[kind] / total for kind in kinds]) * count).astype(int)
    hidden: list[tuple[str, tuple[Hidden, ...]]] = []
    for kind, number in zip(kinds, np.diff([0, *bounds]), strict=True):
        hidden += [(kind, effects) for effects in DRAWS[kind](int(number), rng)]
    order = rng.permutation(len(hidden))
    width = max(3, len(str(count)))
    return [conditions(f"case-{n + 1:0{width}d}", *hidden[k], n % 2 == 1, rng) for n, k in enumerate(order)]


def nothing(number: int, rng: np.random.Generator) -> list[tuple[Hidden, ...]]:
    """Rigs with nothing missing."""
    return [()] * number


def single(number: int, rng: np.random.Generator) -> list[tuple[Hidden, ...]]:
    """Every effect at every size in turn, in random order."""
    return [(one,) for one in _in_turn(NAMED, number, rng)]


def outside(number: int, rng: np.random.Generator) -> list[tuple[Hidden, ...]]:
    """Every effect beyond the list at every size in turn, in random order."""
    return [(one,) for one in _in_turn(OUTSIDE, number, rng)]


def pair(number: int, rng: np.random.Generator) -> list[tuple[Hidden, ...]]:
    """Two effects of medium or large size, every second pair at one kind of site."""
    found: list[tuple[Hidden, ...]] = []
    while len(found) < number:
        names = rng.choice(list(NAMED), 2, replace=False)
        one, other = (NAMED[name](Draw(str(rng.choice(SIZES[1:])), rng)) for name in names)
        same = one.site == other.site
        clash = {"stribeck_friction", "presliding"} == set(names) or bool(set(one.fields) & set(other.fields))
        if not clash and same == (len(found) % 2 == 1):
            found.append((one, other))
    return found


DRAWS = {"nothing": nothing, "single": single, "pair": pair, "outside": outside}


def _in_turn(makers: dict, number: int, rng: np.random.Generator) -> list[Hidden]:
    turns: list[tuple[str, str]] = []
    while len(turns) < number:
        # Names first, sizes second: a short draw has as many names as it can.
        sizes = {name: list(rng.permutation(SIZES)) for name in makers}
        for turn in range(len(SIZES)):
            turns += [(name, sizes[name][turn]) for name in rng.permutation(list(makers))]
    return [makers[name](Draw(str(size), rng)) for name, size in turns[:number]]


def conditions(
    name: str, kind: str, hidden: tuple[Hidden, ...], with_pressures: bool, rng: np.random.Generator
) -> Case:
    """The case of these effects: base parameters, sensors, controller and reach at random."""
    noise = str(rng.choice(list(NOISE), p=[0.2, 0.6, 0.2]))
    x_noise, p_noise = NOISE[noise]
    base = {
        "viscous": 78.0 * rng.uniform(0.75, 1.25),
        "coulomb": 83.0 * rng.uniform(0.85, 1.15),
        "discharge": 0.8 * rng.uniform(0.85, 1.15),
        "residual_length": rng.uniform(7e-3, 15e-3),
    }
    sensors = Sensors(
        position_noise=x_noise,
        pressure_noise=p_noise,
        colour=float(rng.choice([0.0, 0.5], p=[0.9, 0.1])),
        quantum=float(rng.choice([0.0, TWELVE_BITS], p=[0.85, 0.15])),
        dropouts=float(rng.choice([0.0, 0.01], p=[0.9, 0.1])),
    )
    controller = Controller(
        kp=rng.uniform(30.0, 40.0), ki=float(rng.choice([0.0, 10.0, 20.0, 40.0])), kd=rng.uniform(0.15, 0.35)
    )
    reach = FAR if any(h.name == "end_cushioning" for h in hidden) else rng.uniform(*REACH)
    # A contact that yields a few micrometres is how some simulate dry friction; it is nothing to be named.
    bristles = not any("presliding" in h.fields for h in hidden) and rng.uniform() < 0.3
    variant = {"presliding": rng.uniform(2e-6, 6e-6)} if bristles else {}
    style = str(rng.choice(list(STYLES)))
    return Case(
        name,
        kind,
        int(rng.integers(2**62)),
        base,
        hidden,
        with_pressures,
        noise,
        sensors,
        controller,
        reach,
        style,
        variant,
    )
