"""The report of a plan: one HTML file that stands alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from optid.diagnosis.summary import quantity
from optid.effects.effect import Effect
from optid.experiments.files import Planned
from optid.experiments.separation import NEEDED
from optid.report import plan_figures as figures


def plan_page(planned: Planned) -> str:
    """The page."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    return environment.get_template("plan.html.j2").render(
        title=f"{planned.loop.rig.name}: the next experiment", planned=planned, lead=lead(planned),
        needed=NEEDED, separations=planned.design.separations, finite=np.isfinite,
        figure=Markup(figures.experiment(planned)),
        rivals=[(effect.name, _smallest(effect), effect.law) for effect in planned.design.rivals],
        gains={name: value for name, value in vars(planned.loop.gains).items() if value},
    )  # fmt: skip


def lead(planned: Planned) -> str:
    """What the experiment will do, in one or two sentences."""
    rows = planned.design.separations
    hard = [row for row in rows if not row.enough]
    what = "shows the effect" if len(planned.design.rivals) == 1 else "tells every pair apart"
    if not hard:
        return f"At the smallest size worth a name, {planned.seconds:g} s {what} with at most one error in a hundred."
    first, length = hard[0], max(row.seconds for row in hard)
    pair = f"{first.there} from {first.instead or 'nothing missing'}"
    if not np.isfinite(length):
        return f"Nothing that this rig measures tells {pair} at the smallest size worth a name."
    return (
        f"At the smallest size worth a name, {planned.seconds:g} s are not enough for at most one error in a hundred: "
        f"to tell {pair} takes {first.seconds:.3g} s of it."
    )


def _smallest(effect: Effect) -> str:
    units: dict[str, Any] = {q.name: q.unit for q in effect.parameters}
    return ", ".join(
        f"{name.replace('_', ' ')} {quantity(v, units[name])}" for name, v in effect.strength.items()
    )
