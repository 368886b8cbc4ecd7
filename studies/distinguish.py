"""Distinguishability on paper: the smallest size at which the best possible test tells an effect from another.

    python studies/distinguish.py [--quick] [--out studies/distinguishability.json]

For each excitation and set of sensors: the signatures of all effects along one recording, what base parameters and
window starts can imitate taken out (physics catalogue A.5), and for each pair the part of one signature that no
size or form of the other can imitate. Sizes are in units of the effect's medium size; a test that errs in one of a
hundred cases needs `NEEDED` standard deviations. The noise is white, the rest of the model exact: what is found here
no tool can beat. Pairs that stay together at their medium size go to studies/inseparable.json, which the blind trial
reads. It imports nothing of optid.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))  # finds the studies beside it from any folder

from studies.independent_rig.rig import Array
from studies.trial.case import SIZES, Hidden
from studies.trial.named import NAMED
from studies.trial.signatures import Projector, Sight, excited
from studies.trial.sizes import Draw

NEEDED = 4.65  # sd between two hypotheses that a test confuses in 1 % of the cases either way
FORMS = 6  # draws of an effect that span what it can do
EXCITATIONS = {
    "sine": ("sine",),
    "rich": ("steps", "multisine", "ramps"),
    "rich with full strokes": ("steps", "multisine", "ramps", "strokes"),
}
SENSORS = {"position only": None, "with pressures": 500.0}


def forms(name: str, seed: int = 0) -> list[Hidden]:
    """The effect at medium size first, then at all sizes in the forms that it takes."""
    rng = np.random.default_rng(seed)
    medium = NAMED[name](Draw("medium", rng))
    return [medium, *(NAMED[name](Draw(SIZES[k % 3], rng)) for k in range(FORMS))]


def left_over(signature: Array, rival: Array) -> float:
    """Norm of what no combination of the rival's forms imitates; `rival` is (rows, forms)."""
    lengths = np.linalg.norm(rival, axis=0)
    basis = rival[:, lengths > 0] / lengths[lengths > 0]
    if not basis.size:
        return float(np.linalg.norm(signature))
    u, s, _ = np.linalg.svd(basis, full_matrices=False)
    u = u[:, s > 0.05 * s[0]]  # directions that the forms share up to their nonlinearity are one
    return float(np.linalg.norm(signature - u @ (u.T @ signature)))


def table(sights: list[Sight], names: list[str]) -> dict[str, dict[str, float | None]]:
    """Row: the effect that is there; column: the rival; "alone": against nothing missing. Shares of medium size."""
    projector = Projector(sights)
    columns = {name: np.stack([projector.signature(h) for h in forms(name)], axis=1) for name in names}
    out: dict[str, dict[str, float | None]] = {}
    for name in names:
        own = columns[name][:, 0]
        row: dict[str, float | None] = {"alone": _size(float(np.linalg.norm(own)))}
        row |= {rival: _size(left_over(own, columns[rival])) for rival in names if rival != name}
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
