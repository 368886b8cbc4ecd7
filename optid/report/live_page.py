"""The report of a session: a self-contained HTML file."""

from __future__ import annotations

from typing import Any

from markupsafe import Markup

from optid.live.results import Stretch
from optid.live.review import Review
from optid.report import live_figures as figures
from optid.report.shell import render

OUTCOMES = {
    "done": "The session ran its time.",
    "ended": "The driver had no more samples.",
    "stopped": "The session was stopped.",
    "failed": "The session failed.",
}
GAINS = ("kp", "ki", "kd", "derivative_filter", "setpoint_weight", "derivative_weight")


def live_page(
    document: dict[str, Any],
    title: str,
    stretches: list[tuple[str, Stretch]],
    review: Review | None,
    following: str = "",
) -> str:
    """The page.

    Args:
        document: content of live.json.
        title: of the page.
        stretches: parts of the recording to show, with their headings.
        review: of the last tuning.
        following: the next command.
    """
    return render(
        "live.html.j2",
        title=title,
        document=document,
        lead=OUTCOMES[document["outcome"]],
        names=GAINS,
        review=review,
        stretches=[(heading, Markup(figures.stretch(part))) for heading, part in stretches],
        reviewed=Markup(figures.review(review, stretches[0][1].unit)) if review and stretches else None,
        next_command=following,
    )
