"""The report of a session: one HTML file that stands alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from optid.live.results import Stretch
from optid.live.review import Review
from optid.report import live_figures as figures

OUTCOMES = {
    "done": "The session ran its time.", "ended": "The driver had no more samples.",
    "stopped": "The session was stopped.", "failed": "The session failed.",
}  # fmt: skip
GAINS = ("kp", "ki", "kd", "derivative_filter", "setpoint_weight", "derivative_weight")


def live_page(
    document: dict[str, Any], title: str, stretches: list[tuple[str, Stretch]], review: Review | None
) -> str:
    """The page.

    Args:
        document: content of live.json.
        title: of the page.
        stretches: what of the recording to show, with its headings.
        review: of the last tuning.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, trim_blocks=True,
        lstrip_blocks=True, undefined=jinja2.StrictUndefined,
    )  # fmt: skip
    return environment.get_template("live.html.j2").render(
        title=title, document=document, lead=OUTCOMES[document["outcome"]], names=GAINS, review=review,
        stretches=[(heading, Markup(figures.stretch(part))) for heading, part in stretches],
        reviewed=Markup(figures.review(review, stretches[0][1].unit)) if review and stretches else None,
    )  # fmt: skip
