"""What a diagnosis puts into a model at a site to measure it: no physics, and so nothing of what an effect says."""

from __future__ import annotations

from collections.abc import Mapping

from optid.effects.effect import Effect


class Instrument(Effect):
    """An effect without parameters; a subclass names itself and its site, and writes `apply`."""

    equation = ""
    parameters = ()
    strength: Mapping[str, float] = {}
    usual = ()
    law = ""
    says = ""
    depends_on = ()
    needs = ""
    source = ""
