"""Smooth forms of laws that jump, for a user's plants and effects.

- `dry_friction`: dry friction of an axis that slides and sticks.
- `signed_root`: sign(q) sqrt(abs(q)) with a finite slope at 0, for flow through an orifice.
- `soft_power`, `soft_floor`, `dead_zone`: a power, a lower bound and a dead zone with bounded slopes.
"""

from __future__ import annotations

from optid.core.smooth import dead_zone, signed_root, soft_floor, soft_power
from optid.rigs.friction import dry_friction

__all__ = ["dead_zone", "dry_friction", "signed_root", "soft_floor", "soft_power"]
