"""What an effect is: where it acts, what it does there, how large it usually is, and how it speaks.

An effect is a class in a file of its own. Its parameters carry their null values as defaults, so that a model
with the effect at its defaults is the model without it, and the two can be compared by statistics.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from optid.core.model import Array
from optid.core.parameter import Parameter
from optid.core.sheet import Sheet

# What an effect can follow, by the names that plants give states and inputs; "signal" is the one at its own site.
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
    """Missing physics; a subclass states the attributes and writes `apply`.

    Attributes
    ----------
    name : str
        as in `[effects.NAME]` and in a diagnosis.
    sites : tuple[str, ...]
        where it acts or reads a signal; the plant must offer all. The first gives it its place.
    equation : str
        of the paper that it changes.
    parameters : tuple[Parameter, ...]
        SI; `default` is the null for a strength and a usual value for a shape.
    strength : Mapping[str, float]
        names of the parameters that make the effect vanish, each with the smallest size worth a name.
    usual : Sequence[Mapping[str, float]]
        points at which to try it (parameter name -> SI value), one for every branch that a descent
        would not reach from the others: both signs, slow and fast, early and late.
    ways : Sequence[Mapping[str, float]]
        changes from the null by which its law goes in proportion (parameter name -> SI value), of a usual size
        each and any of them together, where one that begins at the null has no better place to begin.
    law : str
        the equation in words.
    says : str
        what an engineer would say, with {parameter} to be filled in with value and unit.
    depends_on : tuple[str, ...]
        the signals it follows, the most telling first, each one of SIGNALS.
    needs : str
        what a recording must hold for it to show: "motion over most of the stroke".
    look_alikes : tuple[str, ...]
        names of the effects it is easily confused with.
    shares : Mapping[str, str]
        names of strengths whose part of the law is another effect's whole law while the plant moves, each with
        that effect's name: only rest, or another experiment, tells the two apart.
    excludes : tuple[str, ...]
        names of the effects that cannot be there with it: the same thing with the other sign.
    experiment : str
        what tells it from these.
    ahead_of : tuple[str, ...]
        names of the effects that take up its signal where both act: a sensor's filter that of its gear.
    resolved : Mapping[str, float]
        names of parameters that are times which the sampling's own may be part of, each with the least
        half-width of a 95 % interval in samples.
    entire : bool
        a rig file states all of its parameters, as one without the others means nothing.
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
        """The signal at `site` as the effect makes it; `nominal` at the null.

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
        """Points at which to try it on given recordings: `usual`, unless what the model missed tells better.

        Parameters
        ----------
        heard : Sequence[Array]
            what the plain model's predictions of one output miss, one array per recording, evenly sampled.
        interval : float
            time between samples, s.

        Returns
        -------
        Sequence[Mapping[str, float]]
            parameter name -> SI value, one for each try.
        """
        return self.usual

    def centred(self, values: Mapping[str, float], shown: Mapping[str, Array]) -> Mapping[str, float]:
        """What recordings together tell of parameters, where each has something of its own; nothing unless they do.

        Parameters
        ----------
        values : Mapping[str, float]
            SI, by own name.
        shown : Mapping[str, Array]
            where the effect's own states ended in each recording, by own name, (recordings,).

        Returns
        -------
        Mapping[str, float]
            parameter name -> SI value.
        """
        return {}

    @property
    def fitted(self) -> tuple[Parameter, ...]:
        """Those of its parameters that recordings tell."""
        return tuple(q for q in self.parameters if q.fitted)

    @property
    def site(self) -> str:
        """Its kind of site as diagnoses name it: what stands before the dot."""
        return self.sites[0].partition(".")[0]

    def qualified(self, values: Mapping[str, float]) -> dict[str, float]:
        """Parameter values under the names they have in a model: "effect.parameter".

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
        """By own name the shapes that its law can do without: their defaults are ends of what they may be."""
        return {
            q.name: q.default
            for q in self.fitted
            if q.default is not None and q.name not in self.strength and q.default in q.bounds
        }

    def size(self, values: Mapping[str, float]) -> float:
        """How many times the smallest size worth a name, from values by own name; the largest strength counts.

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
