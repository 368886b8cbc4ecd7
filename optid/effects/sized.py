"""Effects of the catalogue, stated for a slide of 0.1 m and 100 N, applied to an axis of other units and sizes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any

from optid.core.axis import Axis
from optid.core.model import Array
from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.effects.effect import Effect

ALIKE = (
    *("name", "sites", "equation", "depends_on", "places", "needs", "look_alikes", "shares", "excludes"),
    *("ahead_of", "resolved", "entire", "source"),
)


class ScaledEffect(Effect):
    """An effect with its parameters in the units and sizes of an axis.

    Args:
        effect: as the catalogue states it.
        axis: that it acts on.
    """

    def __init__(self, effect: Effect, axis: Axis) -> None:
        self.plain, self.axis = effect, axis
        for name in ALIKE:
            setattr(self, name, getattr(effect, name))
        self.law, self.says, self.experiment = (
            axis.words(text) for text in (effect.law, effect.says, effect.experiment)
        )
        self.parameters = tuple(axis.sized(q) for q in effect.parameters)
        self._factors = {q.name: axis.factor(q.unit) for q in effect.parameters}
        self.strength = self._grown(effect.strength)
        self.usual = tuple(self._grown(point) for point in effect.usual)
        self.ways = tuple(self._grown(point) for point in effect.ways)

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal modified by the effect."""
        return self.plain.apply(site, nominal, near, _SizedSheet(sheet, self.axis))  # type: ignore[arg-type]

    def tries(self, heard: Sequence[Array], interval: float) -> Sequence[Mapping[str, float]]:
        """Start points for given recordings."""
        if type(self.plain).tries is Effect.tries:
            return self.usual
        return tuple(self._grown(point) for point in self.plain.tries(heard, interval))

    def centred(self, values: Mapping[str, float], shown: Mapping[str, Array]) -> Mapping[str, float]:
        """Parameters estimated from all recordings together."""
        return self.plain.centred(values, shown)

    def active_range(
        self, values: Mapping[str, float], plant: Mapping[str, float]
    ) -> Mapping[str, tuple[float, float]]:
        """Ranges of signals that the law singles out."""
        plain = {name: value / self._factors[name] for name, value in values.items()}
        by = {"position": self.axis.factor("m"), "velocity": self.axis.factor("m/s")}
        ranges = self.plain.active_range(plain, plant).items()
        return {name: (by.get(name, 1.0) * low, by.get(name, 1.0) * high) for name, (low, high) in ranges}

    def _grown(self, values: Mapping[str, float]) -> dict[str, float]:
        return {name: value * self._factors[name] for name, value in values.items()}


class _SizedSheet:
    """A sheet on which an effect writes as for a slide; its parameters and states are converted to the axis."""

    def __init__(self, sheet: Sheet, axis: Axis) -> None:
        self._sheet, self._axis = sheet, axis

    def __getattr__(self, name: str) -> Any:
        return getattr(self._sheet, name)

    def param(self, parameter: Parameter) -> Any:
        """Use a parameter."""
        return self._sheet.param(self._axis.sized(parameter))

    def state(self, name: str, unit: str, scale: float, *, start: Any = 0.0, spread: Any = None) -> Any:
        """Declare a state."""
        by = self._axis.factor(unit)
        spread = None if spread is None else by * spread
        return self._sheet.state(name, self._axis.unit(unit), by * scale, start=by * start, spread=spread)


@lru_cache(maxsize=1024)
def sized(effect: Effect, axis: Axis | None) -> Effect:
    """An effect converted to an axis; unchanged if it is not in the catalogue, or the plant states no axis."""
    own = type(effect).__module__.startswith("optid.effects.catalogue.")
    return ScaledEffect(effect, axis) if own and axis is not None else effect
