"""Forms that may describe what no effect explains: which are tried at a site, over which signals.

A curve over a state or input, possibly with the sign of a speed; a shared curve that scales several similar sites; a
relaxation with the memory of a signal; dry friction that ages at rest; a signal that sticks and jumps; a wave over
time or a length. Additive forms may be multiplied by the magnitude of another signal.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from optid.core.model import Array
from optid.core.sheet import Sheet
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.localisation.instrument import Instrument
from optid.diagnosis.localisation.unknown_input import UnknownInput, push
from optid.diagnosis.problem import with_effect
from optid.diagnosis.surrogate.sinusoid import Linearisation, strongest_sinusoid
from optid.effects.ageing import Ageing
from optid.effects.curve import BENDS, HEIGHTS, Curve, Scaling
from optid.effects.description import AND, Description
from optid.effects.effect import Effect
from optid.effects.relaxation import Relaxation
from optid.effects.sticking import Sticking
from optid.effects.wave import TIME, Wave
from optid.errors import RigError
from optid.rigs.rigfile import Rig, with_effects

Form = TypeVar("Form", bound=Description)

SAME = 0.99  # correlation of two signals from which one is redundant
# The fastest waves that are looked for: Hz, and periods within the range of a length. Patterns of sensors are finer
# than those of forces.
FASTEST, FINEST, TRACK = 30.0, 100.0, 300.0
LENGTHS = ("m", "rad")
SCALED = 0.2  # share added by a height of 1
TURN = 0.05  # of the speed's root mean square: where a curve has changed its sign
AT_REST = 0.01  # the same: below which ageing takes place
SPEEDS = ("m/s", "rad/s")


def kind_of(site: str) -> str:
    """The kind of a plant's site, as "flow" of "flow.chamber_a"."""
    return site.partition(".")[0]


def curves(base: FittedModel, located: UnknownInput) -> Sequence[Curve]:
    """Curves over the physical states and inputs, those with which an unknown input is most correlated first."""
    size = float(np.nanstd(located.signal))
    if not size > 0.0:
        return []
    moving = _moving(base)
    followed = {name: values for name, values in moving.items() if _filled(values)}
    turns = {"": 0.0, **_slow(base, TURN)}
    pairs = [(name, speed) for speed in turns for name in followed if name != speed]

    def left(pair: tuple[str, str]) -> float:
        """The rest of the unknown input after regression on a curve (direct discrepancy models)."""
        name, speed = pair
        low, high = _ends(followed[name])
        columns = np.polynomial.legendre.legvander(
            2.0 * (followed[name] - low) / (high - low) - 1.0, BENDS - 1
        )
        if speed:
            columns = columns * np.tanh(moving[speed] / turns[speed])[:, None]
        columns = np.column_stack([columns, np.ones(len(columns))])
        signal = np.nan_to_num(located.signal)
        return float(np.sum((signal - columns @ np.linalg.lstsq(columns, signal, rcond=1e-9)[0]) ** 2))

    return [
        Curve(
            located.site,
            name,
            *([speed] if speed else []),
            size=size,
            low=low,
            high=high,
            width=turns[speed] or 1.0,
        )
        for name, speed in sorted(pairs, key=left)
        for low, high in [_ends(followed[name])]
    ]


def shared(base: FittedModel, located: UnknownInput) -> list[Description]:
    """Shares and relaxations at all similar sites of the mismatch, over the signals that each of them declares."""
    size, site = float(np.nanstd(located.signals)), AND.join(located.sites)
    if not size > 0.0:
        return []
    known = _known(base, located.sites) if len(located.sites) > 1 else _moving(base)
    found: list[Description] = []
    for name, values in known.items():
        low, high = _ends(values)
        if low < high:
            if len(located.sites) > 1 and _filled(values):  # at a single one a curve is equivalent
                found.append(Scaling(site, name, low=low, high=high, size=SCALED))
            scale, start = float(np.nanstd(values)), float(np.nanmean(values))
            found.append(Relaxation(site, name, size=size, scale=scale, start=start))
    return found


def levels(base: FittedModel) -> list[Description]:
    """Shares of a magnitude whose sign the plant sets, as of dry friction: an added signal cannot describe sticking.

    An added signal does not show where it acts either: no smooth force holds an axis, and other sites absorb it.
    """
    found: list[Description] = []
    for site in base.rig.model.scalable:
        for name, values in _signals(base, (site,)).items():
            if _filled(values):
                low, high = _ends(values)
                found.append(Scaling(site, name, low=low, high=high, size=SCALED))
        found += [Ageing(site, name, size=SCALED, slow=slow) for name, slow in _slow(base, AT_REST).items()]
    return found


def sticking(base: FittedModel, sites: Iterable[str]) -> list[Sticking]:
    """Sticking of a signal at each site where that is a recorded input, which is used in the name."""
    recorded = {port.role for port in base.rig.model.recorded}
    found: list[Sticking] = []
    for site in sites:
        role = site.partition(".")[2]
        if role in recorded and (size := float(np.sqrt(np.nanmean(_moving(base)[role] ** 2)))) > 0.0:
            found.append(Sticking(site, role, size=size))
    return found


def waves(at: Linearisation, site: str) -> list[tuple[Wave, dict[str, float], float]]:
    """Waves over time, and over every length and angle of the plant: the best one of each, with values and gain."""
    base = at.model
    size = push(base, at.problem, site)
    if size is None:
        return []
    # At least four samples per period.
    fastest = min(FASTEST, 0.25 / float(np.median(base.likelihood_problem.problem.dt)))
    followed = {TIME: (base.likelihood_problem.problem.time, fastest)}
    for k, state in enumerate(base.rig.model.states):
        if state.unit in LENGTHS and "." not in state.name:
            values = base.fit.filtered.states[0][:, k]
            low, high = _ends(values)
            most = TRACK if kind_of(site) == "sensor" else FINEST
            followed[state.name] = (values, most / max(high - low, 1e-12))
    found = []
    for name, (along, fastest) in followed.items():
        # While a wave is fitted, at least one of its periods lies within the recorded range.
        fewest = 1.0 / max(float(np.ptp(along)), 1e-12)
        for plain in fitting(base.rig, [Wave(site, name, repeats=fewest, size=size, fewest=fewest)]):
            line = strongest_sinusoid(at, plain, along, fastest)
            if line is None or not line.height > 0.0:
                continue
            best = plain.sized(line.repeats, line.height * size)
            found.append((best, {**best.at_null(), **best.of_height(1.0), "phase": line.phase}, line.gain))
    return found


def _slow(base: FittedModel, share: float) -> dict[str, float]:
    """A share of every speed's root mean square."""
    speeds = {state.name for state in base.rig.model.states if state.unit in SPEEDS}
    followed = {name: values for name, values in _moving(base).items() if name in speeds}
    sizes = {name: share * float(np.sqrt(np.nanmean(values**2))) for name, values in followed.items()}
    return {name: size for name, size in sizes.items() if size > 0.0}


def _moving(base: FittedModel) -> dict[str, Array]:
    """Every physical state and recorded input along the recordings, (samples,)."""
    model, states = base.rig.model, base.fit.filtered.states[0]
    found: dict[str, Array] = {
        state.name: states[:, k]
        for k, state in enumerate(model.states)
        if state.unit != "1" and "." not in state.name and state.name not in model.unobservable
    }
    for column, port in enumerate(model.inputs):
        if port in model.recorded:
            found[port.role] = base.likelihood_problem.problem.inputs[:, column]
    return found


def _known(base: FittedModel, sites: tuple[str, ...]) -> dict[str, Array]:
    """The signals that all of these sites declare under the same name, along the recordings, (samples, sites)."""
    model, states = base.rig.model, base.fit.filtered.states[0]
    names = [set(near) for site, near in zip(model.sites, model.near, strict=True) if site in sites]
    found: dict[str, Array] = {}
    for name in sorted(set.intersection(*names)):
        full = with_effects(base.rig, (_Reading(sites, name),), {}).model
        rows = [k for k, port in enumerate(full.outputs) if port.role.startswith("reading_")]
        X, U = states, base.likelihood_problem.problem.inputs
        values = np.array(full.sensors.map(len(X))(X.T, U.T, base.p))[rows].T
        if np.ptp(values) > 0.0 and not _resembles(values, found.values()):
            found[name] = values
    return found


class _Reading(Instrument):
    """Adds a signal declared at sites as outputs."""

    def __init__(self, sites: tuple[str, ...], along: str) -> None:
        self.name, self.sites, self.along = "reading", sites, along

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The unchanged signal of the site."""
        sheet.output(f"{self.name}_{self.sites.index(site)}", "1", near[self.along])
        return nominal


def _filled(values: Array) -> bool:
    """Whether a signal visited every interval between the knots of a curve; elsewhere the curve is arbitrary."""
    known = values[np.isfinite(values)]
    if not len(known) or not np.ptp(known) > 0.0:
        return False
    return bool((np.histogram(known, HEIGHTS - 3)[0] > 0).all())


def _ends(values: Array) -> tuple[float, float]:
    """The least and the largest."""
    return float(np.nanmin(values)), float(np.nanmax(values))


def fitting(rig: Rig, forms: Iterable[Form]) -> list[Form]:
    """Those whose signal the plant has declared at that point."""
    return [form for form in forms if _fits(rig, form)]


def _fits(rig: Rig, form: Description) -> bool:
    try:
        with_effect(rig, form)
    except RigError:
        return False
    return True


def swelling(base: FittedModel, form: Form) -> list[Form]:
    """The same form multiplied by the magnitude of every signal that its sites declare."""
    found: list[Form] = []
    if not form.adds:
        return found
    for name, values in _signals(base, form.sites).items():
        magnitude = np.abs(values)
        low, high = _ends(magnitude)
        if low < high:
            found.append(form.swelling(name, float(np.sqrt(np.nanmean(magnitude**2)))))
    return found


def turned(base: FittedModel, form: Effect) -> list[Curve]:
    """A curve with both of its signals exchanged: over the multiplying one, multiplied by the other.

    A kink, as of a magnitude at zero, can be followed only by a curve over the signal that seldom passes there.
    """
    if not isinstance(form, Curve) or not form.by:
        return []
    signals = _signals(base, form.sites)
    if not {form.along, form.by} <= signals.keys():
        return []
    (low, high), over = _ends(signals[form.by]), signals[form.along]
    return [form.turned(low, high, float(np.sqrt(np.nanmean(over**2))))]


def _signals(base: FittedModel, sites: tuple[str, ...]) -> dict[str, Array]:
    """The signals that all of these sites declare; for a single one also states and inputs."""
    if len(sites) > 1:
        return _known(base, sites)
    found = _moving(base)
    for name, values in _known(base, sites).items():
        if not _resembles(values, found.values()):
            found[name] = values[:, 0]
    return found


def _resembles(values: Array, others: Iterable[Array]) -> bool:
    """Whether one of them is equivalent."""
    moving = [other for other in others if np.ptp(other) > 0.0]
    return any(abs(np.corrcoef(values.ravel(), other.ravel())[0, 1]) > SAME for other in moving)
