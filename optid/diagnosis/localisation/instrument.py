"""An instrument that a diagnosis inserts at a site to measure it: it has no physics, and none of an effect's texts."""

from __future__ import annotations

from collections.abc import Mapping

from optid.core.parameter import Parameter
from optid.effects.effect import Effect


class Instrument(Effect):
    """An effect without parameters; a subclass names itself and its site, and writes `apply`."""

    equation = ""
    parameters: tuple[Parameter, ...] = ()
    strength: Mapping[str, float] = {}
    usual = ()
    law = ""
    says = ""
    depends_on = ()
    needs = ""
    source = ""
