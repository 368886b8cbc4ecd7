"""The sheet a plant writes its equations on, and `build`, which freezes it into a `Model`.

A plant is a plain function ``plant(sheet, *, option=default)``. It declares states, inputs and parameters,
writes one rate for each state and one expression for each output, and offers *sites*: named signals where an
effect may insert missing physics. With nothing inserted a site returns its argument.
"""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

import casadi as ca

from optid.core.axis import JOINT
from optid.core.declarations import Expression
from optid.core.model import Constraint, Model
from optid.core.statements import Statements
from optid.core.threads import one_at_a_time
from optid.errors import PlantError, nearest

Plant = Callable[..., None]


class Effect(Protocol):
    """Physics that a plant may have left out: acts on the signals of one site or more.

    ``apply`` is called at each of its sites, in the order in which the plant offers them; at a common site those come
    first that name the others in `ahead_of`. It receives the nominal signal, the signals that the plant declares near
    the site, and the sheet (for its own parameters and states, which are prefixed with the effect's name); at its null
    parameter values it returns the nominal signal.
    """

    @property
    def name(self) -> str:
        """As in a rig file's `[effects.NAME]`."""

    @property
    def sites(self) -> Sequence[str]:
        """Sites it acts on; the plant must offer them all."""

    @property
    def ahead_of(self) -> Sequence[str]:
        """Names of effects that receive its signal where both act."""

    def apply(
        self, site: str, nominal: Expression, near: Mapping[str, Expression], sheet: Sheet
    ) -> Expression:
        """The signal modified by the effect."""


class _Site(NamedTuple):
    """A site as the plant first offers it: size and SI unit of its signal, names of the signals near it."""

    size: float
    unit: str
    near: tuple[str, ...]


class _Near(dict[str, Expression]):
    """Signals near a site; one that the plant does not declare there is the plant's or the effect's mistake."""

    def __init__(self, site: str, **near: Expression) -> None:
        super().__init__(near)
        self.effect, self._site = "", site

    def __missing__(self, name: str) -> Expression:
        raise PlantError(
            f'effect "{self.effect}" needs the signal "{name}", which the plant does not declare near '
            f'"{self._site}"',
            hint=nearest(name, self),
        )


class Sheet(Statements):
    """Collects a plant's equations in the order in which it writes them.

    Parameters
    ----------
    name : str
        of the plant.
    effects : Sequence[Effect]
        effects that act at its sites.
    groups : Mapping[str, Sequence[str]] | None
        name of a parameter that groups of recordings have of their own -> the groups.
    """

    def __init__(
        self, name: str, effects: Sequence[Effect] = (), groups: Mapping[str, Sequence[str]] | None = None
    ) -> None:
        super().__init__(name, groups)
        self._effects = tuple(effects)
        self._sites: dict[str, _Site] = {}
        self._notes: dict[str, Expression] = {}
        self._late: Expression | None = None  # s: delay of commands
        self._switch: tuple[ca.SX, Expression] | None = None
        self._near = _Near("")  # where it writes

    def delay_input(self, time: Expression) -> tuple[Expression | None, Expression]:
        """Delay commands by a further `time`, s; returns the delay before (None if there was none) and after.

        Parameters
        ----------
        time : Expression
            further delay, s.

        Returns
        -------
        tuple[Expression | None, Expression]
            delay before, ``None`` if there was none, and delay now, s.
        """
        before, self._late = self._late, time if self._late is None else self._late + time
        return before, self._late

    def switch_within_hold(self, share: Expression, before: Expression, after: Expression) -> Expression:
        """A signal that switches inside each hold, after this share of it; the last of two such shares is used.

        Parameters
        ----------
        share : Expression
            of the hold, from 0 to 1.
        before : Expression
            the signal until then.
        after : Expression
            the signal from then on.

        Returns
        -------
        Expression
            the signal.
        """
        half = self._switch[0] if self._switch else ca.SX.sym("half")
        self._switch = (half, share)
        return before + half * (after - before)

    def store(self, name: str, expression: Expression) -> None:
        """Keep an expression that an effect needs again at a later site.

        Parameters
        ----------
        name : str
            for `recall`.
        expression : Expression
            to keep.
        """
        self._notes[self._prefix + name] = expression

    def recall(self, name: str) -> Expression:
        """The expression that the same effect stored at an earlier site.

        Parameters
        ----------
        name : str
            as it was stored.

        Returns
        -------
        Expression
            the expression.
        """
        return self._notes[self._prefix + name]

    def site(
        self, name: str, nominal: Expression, *, size: float = 1.0, unit: str = "", **near: Expression
    ) -> Expression:
        """Offer a signal to effects; returns it unchanged when none acts here.

        Parameters
        ----------
        name : str
            of the site.
        nominal : Expression
            the signal.
        size : float
            its usual size in SI units, for generic effects; 0 where these make no sense.
        unit : str
            SI unit of the signal, used in reports; "1" for a pure number, "" if not stated.
        **near : Expression
            other signals that an effect here may need; it finds `size` among them too.

        Returns
        -------
        Expression
            the signal, modified by the effects that act here.
        """
        here = ca.SX(nominal)
        self._sites.setdefault(name, _Site(0.0 if here.is_constant() else size, unit, tuple(near)))
        acting = [effect for effect in self._effects if name in effect.sites]
        self._near = _Near(name, size=size, **near)
        for effect in sorted(acting, key=lambda one: sum(one.name in other.ahead_of for other in acting)):
            self._near.effect, self._prefix = effect.name, f"{effect.name}."
            nominal = effect.apply(name, nominal, self._near, self)
            self._prefix = ""
        return nominal

    def override_signal(self, name: str, signal: Expression) -> None:
        """Replace a signal near this site for the effects that follow, as the speed of a modified position.

        Parameters
        ----------
        name : str
            of the signal near the site.
        signal : Expression
            its replacement.
        """
        self._near[name] = signal

    def freeze(self) -> Model:
        """Check that the equations close and freeze them.

        Returns
        -------
        Model
            the frozen model.

        Raises
        ------
        PlantError
            a state has no rate, nothing is measured, or an effect names a site that does not exist.
        """
        missing = [name for name in self._states if name not in self._rates]
        if missing or not self._states:
            raise PlantError(
                f"no rate for {', '.join(missing) or 'any state: none is declared'}", where=self.name
            )
        if not self._outputs:
            raise PlantError("the plant declares no output", where=self.name)
        for effect in self._effects:
            for site in effect.sites:
                if site not in self._sites:
                    raise PlantError(
                        f'effect "{effect.name}" acts at site "{site}", which the plant does not offer',
                        where=self.name,
                        hint=nearest(site, self._sites),
                    )
        x = ca.vertcat(*self._state_symbols.values())
        u = ca.vertcat(*(symbol for _, symbol in self._inputs.values()))
        p = ca.vertcat(*(symbol for _, symbol in self._parameters.values()))
        names = (["x", "u", "p"], ["xdot"])
        first = next(port for port, _ in self._outputs.values())
        rates = ca.vertcat(*(self._rates[name] for name in self._states))
        outputs = ca.vertcat(*(expression for _, expression in self._outputs.values()))
        mean, spread = (ca.vertcat(*column) for column in zip(*self._starts.values(), strict=True))
        mean, spread = self._of_any(mean), self._of_any(spread)
        try:
            halves = None
            if self._switch:
                half, share = self._switch
                stretched = 2.0 * rates * (share + half * (1.0 - 2.0 * share))
                halves = ca.Function("halves", [x, u, p, half], [ca.cse(stretched)])
                rates, outputs = ca.substitute([rates, outputs], [half], [1.0 - share])
            return Model(
                name=self.name,
                states=tuple(self._states.values()),
                inputs=tuple(port for port, _ in self._inputs.values()),
                outputs=tuple(port for port, _ in self._outputs.values()),
                parameters=tuple(parameter for parameter, _ in self._parameters.values()),
                sites=tuple(self._sites),
                sizes=tuple(site.size for site in self._sites.values()),
                site_units=tuple(site.unit for site in self._sites.values()),
                near=tuple(site.near for site in self._sites.values()),
                effects=tuple(effect.name for effect in self._effects),
                rates=ca.Function("rates", [x, u, p], [ca.cse(rates)], *names),
                sensors=ca.Function("sensors", [x, u, p], [ca.cse(outputs)], names[0], ["y"]),
                start=ca.Function("start", [p], [mean, spread], ["p"], ["mean", "spread"]),
                halves=halves,
                form_error=self._form_error,
                suspects=tuple(group for group in self._suspects if set(group) <= set(self._sites)),
                scalable=tuple(site for site in self._scalable if site in self._sites),
                biases=dict(self._biases),
                axis=self._axis or (JOINT if first.unit == "rad" else None),
                constraints=tuple(self._constraint(words, margin, p) for words, margin in self._required),
                reach={
                    role: ca.Function("reach", [p], [self._of_any(ca.vertcat(*ends))])
                    for role, ends in self._reach.items()
                },
            )
        except RuntimeError as error:  # CasADi: an expression holds a symbol that was never declared
            raise PlantError(
                f"the equations use a symbol that is no state, input or parameter ({error})",
                where=self.name,
            ) from error

    def _of_any(self, expression: Expression) -> Expression:
        """The same for a recording without a group."""
        told = list(self._tells.values())
        return (
            ca.substitute(ca.SX(expression), ca.vertcat(*told), ca.SX.zeros(len(told)))
            if told
            else expression
        )

    def _constraint(self, words: str, margin: Expression, p: ca.SX) -> Constraint:
        margin = self._of_any(margin)
        about = {symbol.name() for symbol in ca.symvar(ca.SX(margin))}
        names = tuple(name for name in self._parameters if name in about)
        return Constraint(words, names, ca.Function("margin", [p], [margin]))


@one_at_a_time
def build(
    plant: Plant,
    effects: Sequence[Effect] = (),
    groups: Mapping[str, Sequence[str]] | None = None,
    **options: object,
) -> Model:
    """Read a plant's equations once and freeze them into a `Model`.

    Parameters
    ----------
    plant : Plant
        function that writes on a `Sheet`; keyword arguments with defaults are its options.
    effects : Sequence[Effect]
        missing physics to insert at the plant's sites, in this order.
    groups : Mapping[str, Sequence[str]] | None
        name of a parameter that groups of recordings have of their own -> the groups.
    **options : object
        options of the plant, such as ``rod_force=False``.

    Returns
    -------
    Model
        the model.

    Raises
    ------
    PlantError
        an unknown option or value, or equations that do not close.
    """
    name = getattr(plant, "__name__", "plant").replace("_", "-")
    _check_options(name, plant, options)
    sheet = Sheet(name, effects, groups)
    plant(sheet, **options)
    return sheet.freeze()


def _check_options(name: str, plant: Plant, options: Mapping[str, object]) -> None:
    known = {
        key: parameter
        for key, parameter in inspect.signature(plant).parameters.items()
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY
    }
    hints = typing.get_type_hints(plant)
    for key, value in options.items():
        if key not in known:
            raise PlantError(f'no option "{key}"', where=name, hint=nearest(key, known))
        allowed = typing.get_args(hints.get(key)) or ((True, False) if hints.get(key) is bool else ())
        if allowed and not any(value is a or (value == a and type(value) is type(a)) for a in allowed):
            raise PlantError(
                f"{value!r}",
                where=name,
                field=f"option {key}",
                expected=" or ".join(repr(a) for a in allowed),
            )
