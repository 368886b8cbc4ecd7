"""What a plant states about its own equations: where they may lack physics, how exact they are, what must hold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from optid.core.declarations import Declarations, Expression


class Statements(Declarations):
    """Collects a plant's statements for estimation and diagnosis; none of them changes its equations.

    Parameters
    ----------
    name : str
        of the plant.
    groups : Mapping[str, Sequence[str]] | None
        name of a parameter that groups of recordings have of their own -> the groups.
    """

    def __init__(self, name: str, groups: Mapping[str, Sequence[str]] | None = None) -> None:
        super().__init__(name, groups)
        self._form_error: float | None = None
        self._suspects: list[tuple[str, ...]] = []
        self._scalable: list[str] = []
        self._biases: dict[str, float] = {}
        self._required: list[tuple[str, Expression]] = []

    def form_error(self, share: float) -> None:
        """State which share of the squared error the right effects may leave on this plant.

        In at most one of 20 blind cases do the right effects leave more.

        Parameters
        ----------
        share : float
            of the squared error.
        """
        self._form_error = share

    def suspect(self, *sites: str) -> None:
        """Name sites at which unknown physics may act, together if several: a diagnosis looks for an input there.

        Parameters
        ----------
        *sites : str
            their names.
        """
        self._suspects.append(sites)

    def scalable(self, *sites: str) -> None:
        """Name sites of a magnitude whose sign the plant sets, as of dry friction: no added signal describes sticking.

        Parameters
        ----------
        *sites : str
            their names.
        """
        self._scalable.extend(sites)

    def biased(self, **shares: float) -> None:
        """State the shares by which the smooth approximation of a discontinuous law may bias fitted parameters.

        They were measured against the law itself; intervals count each as a standard uncertainty of type B (GUM, 4.3).

        Parameters
        ----------
        **shares : float
            of a parameter's value, by its name; a later statement replaces an earlier one.
        """
        self._biases.update(shares)

    def require(self, words: str, margin: Expression) -> None:
        """State a condition on parameters: a sentence, and an expression that is positive where it holds.

        Parameters
        ----------
        words : str
            what must hold, as a sentence.
        margin : Expression
            positive where it holds.
        """
        self._required.append((words, margin))
