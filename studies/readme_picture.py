"""The README's picture: position and error before and after, from a folder that `optid diagnose` wrote.

python studies/readme_picture.py out/worn studies/docs/worn.png
"""

from __future__ import annotations

import sys

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg

import optid
from optid.report.diagnosis_figures import before_after


def main(folder: str, picture: str) -> None:
    """Draw it."""
    result = optid.load(folder)
    scores, noise = result.document["baseline"]["holdout"], result.document["noise_floor"]
    role = next(iter(scores))
    figure = before_after(result.tables["holdout"], role, scores[role]["unit"], noise[role]["rmse"], True)
    FigureCanvasAgg(figure)
    with mpl.rc_context({"savefig.facecolor": "white"}):
        figure.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:3])
