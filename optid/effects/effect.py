"""The effect: where it acts, what it does there, its usual size, and its texts.

An effect is a class in a file of its own. Its parameters have their null values as defaults, so that a model
with the effect at its defaults is the model without it, and the two can be compared by statistics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from optid.core.model import Array
from optid.core.parameter import Parameter
from optid.core.sheet import Sheet

# Signals that an effect can depend on, by the plants' names of states and inputs; "signal" is its own site's.
SIGNALS = (
    "position",
    "velocity",
    "acceleration",
    "command",
    "command_rate",
    "pressure_a",
    "pressure_b",
    "flow",
    "level",
    "time",
    "signal",
)


class Effect:
    """Missing physics; a subclass defines the attributes and `apply`.

    Attributes
    ----------
    name : str
        as in `[effects.NAME]` and in a diagnosis.
    sites : tuple[str, ...]
        sites where it acts or reads a signal; the plant must offer all. The first one is its place in reports.
    equation : str
        of the paper that it changes.
    parameters : tuple[Parameter, ...]
        SI; `default` is the null for a strength and a usual value for a shape.
    strength : Mapping[str, float]
        names of the parameters that make the effect vanish, each with the smallest size worth a name.
    usual : Sequence[Mapping[str, float]]
        start points of searches (parameter name -> SI value), one for every branch that a descent would not reach from
        the others: both signs, slow and fast, early and late.
    ways : Sequence[Mapping[str, float]]
        directions from the null along which its law is proportional (parameter name -> SI value), each of a usual
        size; they may be combined as a start point.
    law : str
        the equation in words.
    says : str
        the finding as a sentence, with {parameter} replaced by value and unit.
    depends_on : tuple[str, ...]
        the signals on which it depends, the most informative first, each one of SIGNALS.
    places : tuple[str, ...]
        states whose absolute value it depends on. Where no output shows one, each recording could begin anywhere in the
        law, and have another friction, say: such an effect is not tried.
    needs : str
        what a recording must contain to show it: "motion over most of the stroke".
    look_alikes : tuple[str, ...]
        names of the effects it is easily confused with.
    shares : Mapping[str, str]
        names of strengths whose part of the law equals another effect's law while the plant moves, each with that
        effect's name: only rest, or another experiment, distinguishes the two.
    excludes : tuple[str, ...]
        names of effects that exclude it: the same law with the other sign.
    experiment : str
        an experiment that distinguishes it from these.
    ahead_of : tuple[str, ...]
        names of the effects that receive its signal where both act: a sensor's filter that of its gear.
    resolved : Mapping[str, float]
        names of times that may include a part of the sampling interval, each with the smallest half-width of its 95 %
        interval in samples.
    entire : bool
        a rig file must state all of its parameters.
    source : str
        where law and sizes come from.
    """

    name: str
    sites: tuple[str, ...]
    equation: str
    parameters: tuple[Parameter, ...]
    strength: Mapping[str, float]
    usual: Sequence[Mapping[str, float]]
    ways: Sequence[Mapping[str, float]] = ()
    law: str
    says: str
    depends_on: tuple[str, ...]
    places: tuple[str, ...] = ()
    needs: str
    look_alikes: tuple[str, ...] = ()
    shares: Mapping[str, str] = MappingProxyType({})
    excludes: tuple[str, ...] = ()
    experiment: str = ""
    ahead_of: tuple[str, ...] = ()
    resolved: Mapping[str, float] = MappingProxyType({})
    entire: bool = False
    source: str

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The signal at `site` modified by the effect; `nominal` at the null.

        Parameters
        ----------
        site : str
            one of `sites`.
        nominal : Any
            the signal without the effect.
        near : Mapping[str, Any]
            signals that the plant declares near the site.
        sheet : Sheet
            for parameters and states of its own.

        Returns
        -------
        Any
            the signal with it, in the unit of the nominal one.
        """
        raise NotImplementedError

    def tries(self, heard: Sequence[Array], interval: float) -> Sequence[Mapping[str, float]]:
        """Start points for given recordings: `usual`, unless the prediction errors suggest better ones.

        Parameters
        ----------
        heard : Sequence[Array]
            prediction errors of the plain model for one output, one array per recording, evenly sampled.
        interval : float
            time between samples, s.

        Returns
        -------
        Sequence[Mapping[str, float]]
            parameter name -> SI value, one for each try.
        """
        return self.usual

    def centred(self, values: Mapping[str, float], shown: Mapping[str, Array]) -> Mapping[str, float]:
        """Parameters estimated from all recordings together, where each has its own part; empty otherwise.

        Parameters
        ----------
        values : Mapping[str, float]
            SI, by own name.
        shown : Mapping[str, Array]
            final values of the effect's own states in each recording, by own name, (recordings,).

        Returns
        -------
        Mapping[str, float]
            parameter name -> SI value.
        """
        return {}

    def active_range(
        self, values: Mapping[str, float], plant: Mapping[str, float]
    ) -> Mapping[str, tuple[float, float]]:
        """Ranges of signals that the law singles out: slow motion, a place, the middle of the spool's travel.

        Parameters
        ----------
        values : Mapping[str, float]
            the effect's, SI, by own name.
        plant : Mapping[str, float]
            the whole model's, SI, by full name.

        Returns
        -------
        Mapping[str, tuple[float, float]]
            signal of `SIGNALS` -> lowest and highest value, in the model's unit; empty where the law has none.
        """
        return {}

    @property
    def fitted(self) -> tuple[Parameter, ...]:
        """Its parameters that are fitted."""
        return tuple(q for q in self.parameters if q.fitted)

    @property
    def site(self) -> str:
        """The kind of its site, as in a diagnosis: the part before the dot."""
        return self.sites[0].partition(".")[0]

    def qualified(self, values: Mapping[str, float]) -> dict[str, float]:
        """Parameter values under their names in a model: "effect.parameter".

        Parameters
        ----------
        values : Mapping[str, float]
            SI, by own name.

        Returns
        -------
        dict[str, float]
            the same, by full name.
        """
        return {f"{self.name}.{name}": value for name, value in values.items()}

    def at_null(self) -> dict[str, float]:
        """The defaults by own name: no effect.

        Returns
        -------
        dict[str, float]
            parameter name -> SI value.
        """
        return {q.name: float(q.default) for q in self.parameters if q.default is not None}

    @property
    def simplest(self) -> dict[str, float]:
        """The shape parameters that its law can do without, by own name: their defaults are at a bound."""
        return {
            q.name: q.default
            for q in self.fitted
            if q.default is not None and q.name not in self.strength and q.default in q.bounds
        }

    def size(self, values: Mapping[str, float]) -> float:
        """Multiple of the smallest size worth a name, from values by own name; the largest strength counts.

        Parameters
        ----------
        values : Mapping[str, float]
            SI, by own name.

        Returns
        -------
        float
            1 for the smallest size worth a name.
        """
        null = self.at_null()
        return max(abs(values[name] - null[name]) / least for name, least in self.strength.items())

    def __repr__(self) -> str:
        """Its name."""
        return f"<effect {self.name}>"
