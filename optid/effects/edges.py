"""The four edges of a spool, ground for a common overlap, each with a small deviation."""

from __future__ import annotations

from typing import Any

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet

GROUND = "edges are ground one by one; differences beyond a third of the overlap are not plausible"


def _share(name: str, of: str) -> Parameter:
    return Parameter(
        name,
        "1",
        0.1,
        f"share by which the edges {of} are wider than the mean, and the others narrower",
        GROUND,
        0.0,
        (-0.3, 0.3),
    )


FORWARDS = _share("forwards_wider", "that open at x > 0, supply to A and B to exhaust,")
SUPPLY = _share("supply_wider", "of the supply")
CHAMBER_A = _share("chamber_a_wider", "of chamber A")
EDGES = (FORWARDS, SUPPLY, CHAMBER_A)
ALIKE = {q.name: 0.0 for q in EDGES}  # all four equally wide
SAID = (
    "its edges differ: those that open forwards are wider by a share of {forwards_wider}, those to supply by "
    "{supply_wider}, those of chamber A by {chamber_a_wider}"
)


def edge(sheet: Sheet, way: Any, supply: bool) -> Any:
    """Factor on the mean width of the edge that opens with the spool's `way` (+1 or -1) to supply or exhaust."""
    forwards, of_supply, of_a = (sheet.param(q) for q in EDGES)
    side = 1 if supply else -1
    return 1 + side * of_supply + way * (forwards + side * of_a)
