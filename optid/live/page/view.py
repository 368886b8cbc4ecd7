"""The page's data as JSON: first what is constant, then updates."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from optid.core.model import Array
from optid.core.paths import from_here
from optid.live.log import LOG
from optid.live.plan import KEEP, SIGNALS, slow_columns
from optid.live.results import finite
from optid.live.review import Review
from optid.live.session import Session

EFFECTS = 5  # of the significant ones, the most significant
POINTS = 300  # of a reviewed response


def hello(session: Session) -> dict[str, Any]:
    """Names, units and limits, which do not change."""
    limits = session.settings.limits
    position, command = session.wiring.measured[0], session.wiring.command
    return {
        "kind": "hello",
        "rig": session.rig_name,
        "driver": session.plan.driver,
        "hides": session.hides,
        "controls": session.plan.choices.command is None,
        "rate": session.settings.rate,
        "signals": list(SIGNALS),
        "slow": slow_columns(session.plan.choices.orders),
        "keep": KEEP,
        "output": {"name": position.role, "unit": position.recorded_unit},
        "input": {"name": command.role, "unit": command.recorded_unit},
        "log": from_here(session.plan.out / LOG),
        "limits": {"low": limits.low, "high": limits.high, "stroke": [finite(x) for x in limits.stroke]},
    }


def news(session: Session, parameters: Array, events_seen: int) -> dict[str, Any]:
    """The data that may have changed.

    Args:
        session: as it is.
        parameters: new rows of the ring of parameters.
        events_seen: number of events that this reader has.
    """
    review = session.tuning.review
    return {
        "kind": "news",
        "gains": asdict(session.gains),
        "demanded": session.demanded,
        "disagree": session.disagree,
        "diagnosis": session.diagnosis,
        "tuning": session.busy,
        "review": None if review is None else _review(review),
        "followed": _followed(session.following.standing),
        "applicable": session.applicable,
        "slow": [[finite(x) for x in row] for row in parameters.tolist()],
        "events": [[round(event.time, 1), event.words] for event in session.events.since(events_seen)],
        "end": None if session.end is None else {"how": session.end["how"], "why": session.end["why"]},
    }


def _followed(standing: dict[str, Any] | None) -> dict[str, Any] | None:
    """Parameters, and the most significant effects: the page has no room for all."""
    if standing is None:
        return None
    own = [one for one in standing["rows"] if "." not in one["name"]]
    effects = [one for one in standing["rows"] if "." in one["name"] and one["changed"]][:EFFECTS]
    return {**standing, "rows": [*own, *effects]}


def _review(review: Review) -> dict[str, Any]:
    stride = max(1, round(len(review.responses["physical"][0].output) / POINTS))
    return {
        "old": asdict(review.old),
        "new": asdict(review.new),
        "step": review.step,
        "worse": list(review.worse),
        "words": review.words,
        "interval": stride * review.sample_time,
        "responses": {
            model: [
                {
                    "position": [finite(x) for x in one.output[::stride].tolist()],
                    "itae": finite(one.measures["itae"]),
                    "overshoot": finite(one.overshoot),
                }
                for one in pair
            ]
            for model, pair in review.responses.items()
        },
    }
