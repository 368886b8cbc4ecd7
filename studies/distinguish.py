"""Distinguishability on paper: the smallest size at which the best possible test tells an effect from another.

    python studies/distinguish.py [--quick] [--out studies/distinguishability.json]

For each excitation and set of sensors: the signatures of all effects along one recording, what base parameters and
window starts can imitate taken out, and for each pair the part of one signature that the
other does not imitate. Look-alikes are searched in two ways, and the better imitation counts. The linear look takes
any combination of seven drawn forms of the rival. Signatures bend with size, so it passes by a rival that is the very
same at one size only: a rival that leaves less than `MOSTLY` is itself compared, too, at the one size that imitates
best, in the drawn form (and with the sign) that comes closest in direction; its other parameters stay as drawn. A
rival that would have to be of another form, or that no combination of its drawn forms comes near, is not found.

Sizes are in units of the effect's medium size; a test that errs in one of a hundred cases needs `NEEDED` standard
deviations. The noise is white, the rest of the model exact: against the rivals looked at, no tool can beat what is
found here. Pairs that stay together at their medium size go to studies/inseparable.json, which the blind trial reads.
It imports nothing of optid.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

sys.path.insert(0, str(Path(__file__).parents[1]))  # finds the studies beside it from any folder

from studies.independent_rig.rig import Array
from studies.trial.case import SIZES, Hidden
from studies.trial.named import NAMED
from studies.trial.signatures import Projector, Sight, excited
from studies.trial.sizes import Draw

NEEDED = 4.65  # sd between two hypotheses that a test confuses in 1 % of the cases either way
DRAWN = ("medium", *SIZES, *SIZES)  # draws of an effect that span what it can do
MOSTLY = 0.5  # of a signature's norm: a rival that leaves less is searched for its best size
PITCH = 0.2  # between the sizes that a search looks at first, as shares of the logarithmic range
SHARES = np.linspace(-0.5, 1.1, 9)  # these; higher up, a choking ratio or a valve's travel would be negative
SAME = 1e-3  # sd: what is nearer is the same, and how near depends on the search's last digits
EXCITATIONS = {
    "sine": ("sine",),
    "rich": ("steps", "multisine", "ramps"),
    "rich with full strokes": ("steps", "multisine", "ramps", "strokes"),
}
SENSORS = {"position only": None, "with pressures": 500.0}


def forms(name: str) -> list[Hidden]:
    """The effect at medium size first, then at all sizes in the forms that it takes."""
    rng = np.random.default_rng(0)
    return [NAMED[name](Draw(size, rng)) for size in DRAWN]


def resized(name: str, form: int, share: float | None, flipped: bool = False) -> Hidden:
    """One of `forms` at another size, and with the other sign, if it has one."""
    rng = np.random.default_rng(0)
    for size in DRAWN[:form]:
        NAMED[name](Draw(size, rng))
    return NAMED[name](Draw(DRAWN[form], rng, share, flipped))


class Looks:
    """Signatures along the same recordings, each computed once."""

    def __init__(self, sights: list[Sight]) -> None:
        self.projector = Projector(sights)
        self.known: dict[tuple[tuple[str, float], ...], Array] = {}

    def signature(self, hidden: Hidden) -> Array:
        """In sd, (rows,)."""
        fields = tuple(sorted(hidden.fields.items()))
        if fields not in self.known:
            self.known[fields] = self.projector.signature(hidden)
        return self.known[fields]

    def forms(self, name: str) -> Array:
        """Of all drawn forms, (rows, forms)."""
        return np.stack([self.signature(hidden) for hidden in forms(name)], axis=1)


def left_over(signature: Array, rival: Array) -> float:
    """Norm of what no combination of the rival's forms imitates; `rival` is (rows, forms)."""
    lengths = np.linalg.norm(rival, axis=0)
    basis = rival[:, lengths > 0] / lengths[lengths > 0]
    if not basis.size:
        return float(np.linalg.norm(signature))
    u, s, _ = np.linalg.svd(basis, full_matrices=False)
    u = u[:, s > 0.05 * s[0]]  # directions that the forms share up to their nonlinearity are one
    return float(np.linalg.norm(signature - u @ (u.T @ signature)))


def closest(signature: Array, rival: Array, name: str) -> tuple[int, bool]:
    """The form of the rival that points most nearly where `signature` does, and whether with its sign flipped."""
    lengths = np.linalg.norm(rival, axis=0)
    along = signature @ rival / np.where(lengths > 0, lengths, 1.0)
    if resized(name, 0, None) != resized(name, 0, None, flipped=True):  # it has a sign
        form = int(np.argmax(np.abs(along)))
        return form, bool(along[form] < 0.0)
    return int(np.argmax(along)), False


def searched(signature: Array, looks: Looks, name: str) -> float:
    """Norm of what the rival `name` leaves of a signature at the one size that leaves least; coarse if it is much."""
    form, flipped = closest(signature, looks.forms(name), name)

    def left(share: float) -> float:  # squared: smooth at its minimum
        rest = signature - looks.signature(resized(name, form, float(share), flipped))
        return float(rest @ rest)

    start = min(SHARES, key=left)
    if left(start) > MOSTLY**2 * float(signature @ signature):
        return float(np.sqrt(left(start)))  # were a size nearby exact, this one would leave less
    bounds = max(start - PITCH, SHARES[0]), min(start + PITCH, SHARES[-1])
    found = minimize_scalar(left, bounds=bounds, method="bounded", options={"xatol": 1e-5, "maxiter": 25})
    return float(np.sqrt(min(found.fun, left(start))))


def separation(signature: Array, looks: Looks, name: str) -> float:
    """Norm of what the rival `name` cannot imitate, by either look; what does not show alone is not searched for."""
    whole, linear = float(np.linalg.norm(signature)), left_over(signature, looks.forms(name))
    if whole < NEEDED or linear > MOSTLY * whole:
        return linear
    return min(linear, searched(signature, looks, name))


def table(sights: list[Sight], names: list[str]) -> dict[str, dict[str, float | None]]:
    """Row: the effect that is there; column: the rival; "alone": against nothing missing. Shares of medium size."""
    looks = Looks(sights)
    out: dict[str, dict[str, float | None]] = {}
    for name in names:
        own = looks.signature(forms(name)[0])
        row: dict[str, float | None] = {"alone": _size(float(np.linalg.norm(own)))}
        row |= {rival: _size(max(separation(own, looks, rival), SAME)) for rival in names if rival != name}
        out[name] = row
    return out


def _size(distance: float) -> float | None:
    """Share of the medium size at which the test succeeds; None if the recording shows nothing of it."""
    return round(NEEDED / distance, 4) if distance > 1e-6 else None


def inseparable(tables: dict[str, Any]) -> list[list[str]]:
    """Pairs that, either way and by the best sensors, need more than their medium size."""
    found = set()
    for by_sensors in tables.values():
        rows = by_sensors["with pressures"]
        for name, row in rows.items():
            for rival, share in row.items():
                seen = row["alone"] is not None and row["alone"] < 1.0
                if rival != "alone" and seen and (share is None or share > 1.0):
                    found.add(tuple(sorted((name, rival))))
    return [list(pair) for pair in sorted(found)]


def study(seconds: float, names: list[str]) -> dict[str, Any]:
    """All tables: excitation -> sensors -> table."""
    out: dict[str, Any] = {}
    for excitation, kinds in EXCITATIONS.items():
        runs = [excited(kind, seconds, np.random.default_rng([7, n])) for n, kind in enumerate(kinds)]
        out[excitation] = {
            sensors: table([Sight(run, pressure_noise=noise) for run in runs], names)
            for sensors, noise in SENSORS.items()
        }
    return out


def text(tables: dict[str, Any]) -> str:
    """For each effect: the smallest size that shows, and the rival that is hardest to tell from it."""
    lines = []
    for excitation, by_sensors in tables.items():
        for sensors, rows in by_sensors.items():
            lines += [f"{excitation}, {sensors}: smallest size (of medium) that shows; hardest rivals", ""]
            for name, row in rows.items():
                rivals = sorted(
                    ((np.inf if v is None else v, k) for k, v in row.items() if k != "alone"), reverse=True
                )
                shown = ", ".join(f"{k} {v:.3g}" for v, k in rivals[:3])
                alone = "not visible" if row["alone"] is None else f"{row['alone']:.3g}"
                lines.append(f"  {name:30}{alone:>12}   {shown if row['alone'] is not None else ''}")
            lines.append("")
    return "\n".join(lines)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="1 s recordings instead of 4 s")
    parser.add_argument("--out", type=Path, default=Path(__file__).with_name("distinguishability.json"))
    asked = parser.parse_args()
    tables = study(1.0 if asked.quick else 4.0, list(NAMED))
    pairs = inseparable({k: v for k, v in tables.items() if k.startswith("rich")})
    asked.out.write_text(json.dumps(tables, indent=1) + "\n")
    asked.out.with_name("inseparable.json").write_text(json.dumps({"pairs": pairs}, indent=1) + "\n")
    print(text(tables))
    print(
        "inseparable at medium size with every sensor:",
        ", ".join(" | ".join(pair) for pair in pairs) or "none",
    )


if __name__ == "__main__":
    main()
