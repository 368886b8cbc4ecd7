"""Figures 8 to 12 of the paper redrawn: measured and predicted response, and the error under it.

    python studies/armax_figures.py [--out DIR] [--all]

Figures 8, 9, 10: orders 3, 4, 5 at one step. Figures 11, 12: order 4 at five and ten steps. Drawn for the
impulse experiment; with --all also for the other recordings of `table2.py`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.armax.survey import Plan, survey
from optid.armax.table2 import Table2
from studies.table2 import Experiment, experiments

FIGURES = {8: (3, 1), 9: (4, 1), 10: (5, 1), 11: (4, 5), 12: (4, 10)}


def main() -> None:
    """Draw all figures into a folder."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/figures"))
    parser.add_argument("--all", action="store_true")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for experiment in experiments(quick=not arguments.all):
        table = survey(experiment.y, experiment.u, experiment.sample_time, Plan(unit=experiment.unit)).table2
        for number, (order, steps) in FIGURES.items():
            path = arguments.out / f"figure_{number}_{experiment.name}.png"
            draw(path, experiment, table, order, steps)
            print(path)


def draw(path: Path, experiment: Experiment, table: Table2, order: int, steps: int) -> None:
    """One figure: measured and predicted above, their difference below."""
    time, guess = table.time(), table.traces[order, steps]
    figure, (above, below) = plt.subplots(2, 1, sharex=True, figsize=(8, 5), height_ratios=(2, 1))
    above.plot(time, table.real, color="black", linewidth=1.2, label="measured")
    above.plot(time, guess, color="tab:red", linewidth=0.8, linestyle="--", label="predicted")
    above.set_ylabel(f"position ({table.unit})")
    above.legend(loc="best")
    plural = "s" if steps > 1 else ""
    above.set_title(f"{experiment.name}: order {order}, {steps} step{plural} ahead")
    below.plot(time, guess - table.real, color="tab:red", linewidth=0.6)
    below.set_ylabel(f"error ({table.unit})")
    below.set_xlabel("time (s)")
    figure.tight_layout()
    figure.savefig(path, dpi=120)
    plt.close(figure)


if __name__ == "__main__":
    main()
