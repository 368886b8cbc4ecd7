"""What no effect explains: where it lies, and what describes it, for simulation, without a name.

A curve runs over the state or input that leads farthest from where the mismatch was located; several sites share one
that scales what is there; a relaxation remembers such a signal for a time; a wave goes on by itself, over time or a
length. They compete as effects do, and what is held out decides whether one stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from optid.core.model import Array
from optid.core.sheet import Sheet
from optid.diagnose.candidate import QUICK, QUIETER, Candidate, Data
from optid.diagnose.disturbance import Located, locate_at, push
from optid.diagnose.finding import Finding
from optid.diagnose.instrument import Instrument
from optid.diagnose.judge import Comparison, compare
from optid.diagnose.law import law_at
from optid.diagnose.lead import Ground, leads
from optid.diagnose.line import loudest
from optid.diagnose.refit import LEVEL, Contest, Rival, own_values, refit
from optid.diagnose.screen import Signature, grown
from optid.diagnose.where import region, telling
from optid.diagnose.words import quantity
from optid.effects.curve import AND, Curve, Scaling
from optid.effects.effect import Effect
from optid.effects.relaxation import Relaxation
from optid.effects.wave import TIME, Wave
from optid.errors import RigError
from optid.fit.place import Answer
from optid.fit.scoring import quieted
from optid.rigs.rigfile import Rig, with_effects

DRAWN = 2  # curves that are refitted
# Their race, as in lead.RACE: curves have many parameters, so that a leg is dear, and few lead anywhere. They begin
# where the fitted model stands: from far away the first steps of so many parameters tell nothing.
CURVES = ((10, 10, 1), (8, 4, 1), (QUICK, DRAWN, 1))
SAME = 0.99  # correlation of two signals of which one is enough
SOURCES = {"flow": "flow.supply"}  # where waves come from that show at a kind of site
LEVELS = {"force": "force.coulomb"}  # what a kind of site turns and holds, and others scale
ASIDE = 2  # places beside the best at which a description is looked for
# The fastest waves that are looked for: Hz, and periods within the range of a length.
FASTEST, FINEST = 30.0, 100.0
LENGTHS = ("m", "rad")
SCALED = 0.2  # share that a height of 1 scales by
TURN = 0.05  # of the speed's root mean square: where a curve that turns with its sign has turned
SPEEDS = ("m/s", "rad/s")


@dataclass(frozen=True, eq=False)
class Described:
    """What describes a mismatch.

    Attributes:
        rival: the fitted description, which competed as effects do.
        located: the unknown signal where it acts.
    """

    rival: Rival
    located: Located


def describe(
    base: Candidate, sites: Sequence[Located], data: Data, tell: Callable[[str], None]
) -> Described | None:
    """What describes a mismatch best where it may lie, on what is held out; ``None`` if nothing is gained.

    Args:
        base: the model that it comes to.
        sites: where unknown signals were tried, the best first; those that do nearly as well count as well.
        data: recordings.
        tell: is told what is being done.
    """
    likely = [sites[0], *_rivalling(sites, data)[:ASIDE]]
    guide = quieted(base.answer, QUIETER)
    places = {site: one.only(site) for one in reversed(likely) for site in one.sites}
    lasting: dict[str, Effect] = {
        curve.name: curve for one in places.values() for curve in _curves(base, one)
    }
    for one in likely:
        lasting |= {effect.name: effect for effect in (*_shared(base, one), *_levels(base, one))}
    curves = [one for one in lasting.values() if _fits(base.rig, one)]
    sources = dict.fromkeys(SOURCES.get(kind_of(site), site) for site in places)
    waves = [
        wave for site in sources if site in base.rig.model.sites for wave in _waves(base, guide, site, data)
    ]
    # Only a filter finds the phase of every recording: waves are not led, but refitted from where they are loudest.
    first = sorted(waves, key=lambda one: -one.gain)[:1]
    contest = Contest(base, base, guide, len(curves) + len(waves), data, tell)
    led = leads(base, guide, curves, data, base.rig.model, near=True, race=CURVES)
    rivals = refit(contest, [*first, *led])
    best = next((rival for rival in rivals if not rival.why), None)
    if best is None:
        return None
    site = best.effect.sites[0]
    there = places.get(site) or locate_at(base, data, site)
    return None if there is None else Described(best, there)


def kind_of(site: str) -> str:
    """Of a plant's site, as "flow" of "flow.chamber_a"."""
    return site.partition(".")[0]


def _rivalling(sites: Sequence[Located], data: Data) -> list[Located]:
    """Those that held-out recordings do not tell from the first."""
    return [one for one in sites[1:] if compare(one.judged, sites[0].judged, data.generator).p_value > LEVEL]


def _levels(base: Candidate, located: Located) -> list[Effect]:
    """Shares of a level that others turn, such as that of dry friction: what sticks no added signal describes."""
    found: list[Effect] = []
    for site in dict.fromkeys(LEVELS.get(kind_of(site), "") for site in located.sites):
        if site in base.rig.model.sites:
            for name, values in _moving(base).items():
                low, high = _ends(values)
                if low < high:
                    found.append(Scaling(site, name, low=low, high=high, size=SCALED))
    return found


def _ends(values: Array) -> tuple[float, float]:
    """The least and the largest."""
    return float(np.nanmin(values)), float(np.nanmax(values))


def _waves(base: Candidate, guide: Answer, site: str, data: Data) -> list[Signature]:
    """Over time, and over every length and angle of the plant, the one that explains most."""
    size, model = push(base, data, site), base.rig.model
    if size is None:
        return []
    followed = {TIME: (guide.question.problem.time, FASTEST)}
    for k, state in enumerate(model.states):
        if state.unit in LENGTHS and "." not in state.name:
            values = guide.filtered.states[0][:, k]
            followed[state.name] = (values, FINEST / max(float(np.nanmax(values) - np.nanmin(values)), 1e-12))
    ground, found = Ground.of(base.rig, guide, data, model, guide.p), []
    for name, (along, fastest) in followed.items():
        wave = Wave(site, name, size=size)
        line = loudest(ground, wave, along, fastest, data) if _fits(base.rig, wave) else None
        if line is not None and line.height > 0.0:
            best = Wave(site, name, repeats=line.repeats, size=line.height * size)
            values = {**best.at_null(), "height": 1.0, "phase": line.phase}
            found.append(Signature(best, values, line.gain, np.zeros(0), best.size(values), math.inf))
    return found


class _Reading(Instrument):
    """Shows a signal that sites know as outputs."""

    def __init__(self, sites: tuple[str, ...], along: str) -> None:
        self.name, self.sites, self.along = "reading", sites, along

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The site's own signal as it came."""
        sheet.output(f"{self.name}_{self.sites.index(site)}", "1", near[self.along])
        return nominal


def _shared(base: Candidate, located: Located) -> list[Effect]:
    """Shares and relaxations where the mismatch lies, at all of its sites alike, over what each of them knows."""
    size, site = float(np.nanstd(located.signals)), AND.join(located.sites)
    if not size > 0.0:
        return []
    known = _known(base, located.sites) if len(located.sites) > 1 else _moving(base)
    found: list[Effect] = []
    for name, values in known.items():
        low, high = _ends(values)
        if low < high:
            if len(located.sites) > 1:  # at a single one a curve says as much
                found.append(Scaling(site, name, low=low, high=high, size=SCALED))
            scale, start = float(np.nanstd(values)), float(np.nanmean(values))
            found.append(Relaxation(site, name, size=size, scale=scale, start=start))
    return found


def _known(base: Candidate, sites: tuple[str, ...]) -> dict[str, Array]:
    """The signals that all of these sites know by the same name, along the recordings, (samples, sites)."""
    model, answer = base.rig.model, base.answer
    names = [set(near) for site, near in zip(model.sites, model.near, strict=True) if site in sites]
    found: dict[str, Array] = {}
    for name in sorted(set.intersection(*names)):
        full = with_effects(base.rig, (_Reading(sites, name),), {}).model
        rows = [k for k, port in enumerate(full.outputs) if port.role.startswith("reading_")]
        X, U = answer.filtered.states[0], answer.question.problem.inputs
        values = np.array(full.sensors.map(len(X))(X.T, U.T, answer.p))[rows].T
        if not np.ptp(values) > 0.0:
            continue
        if not any(abs(np.corrcoef(values.ravel(), other.ravel())[0, 1]) > SAME for other in found.values()):
            found[name] = values
    return found


def _moving(base: Candidate) -> dict[str, Array]:
    """Every physical state and recorded input along the recordings, (samples,)."""
    model, answer = base.rig.model, base.answer
    found: dict[str, Array] = {
        state.name: answer.filtered.states[0][:, k]
        for k, state in enumerate(model.states)
        if state.unit != "1" and "." not in state.name
    }
    for column, port in enumerate(model.inputs):
        if port in model.recorded:
            found[port.role] = answer.question.problem.inputs[:, column]
    return found


def _curves(base: Candidate, located: Located) -> Sequence[Curve]:
    """Over every physical state and recorded input, as it is and turning with every speed."""
    model, size = base.rig.model, float(np.nanstd(located.signal))
    if not size > 0.0:
        return []
    followed = _moving(base)
    speeds = [state.name for state in model.states if state.unit in SPEEDS and state.name in followed]
    turns = {name: TURN * float(np.sqrt(np.nanmean(followed[name] ** 2))) for name in speeds}
    ends = {name: _ends(values) for name, values in followed.items()}
    moving = {name: (low, high) for name, (low, high) in ends.items() if low < high}
    curve = partial(Curve, located.site, size=size)
    plain = [curve(name, low=low, high=high) for name, (low, high) in moving.items()]
    return plain + [
        curve(name, speed, low=low, high=high, width=width)
        for speed, width in turns.items()
        if width > 0.0
        for name, (low, high) in moving.items()
        if name != speed
    ]


def _fits(rig: Rig, effect: Effect) -> bool:
    """Whether the plant has declared by then what a description follows."""
    try:
        grown(rig, effect)
    except RigError:
        return False
    return True


def nameless(base: Candidate, sites: Sequence[Located], described: Described | None, data: Data) -> Finding:
    """What is not explained, as a finding: where it lies, and what describes it."""
    first = sites[0] if described is None else described.located
    signal = first.signal / max(float(np.nanstd(first.signal)), 1e-300)
    outputs = len(base.rig.model.outputs)
    spread = np.repeat((signal - np.nanmedian(signal))[:, None], outputs, axis=1)
    measured = np.isfinite(base.answer.filtered.innovations[0])
    where = region(base.answer, np.where(measured, spread, np.nan), data.train)
    kind, best = kind_of(first.site), first.site if first.site in sites[0].sites else sites[0].site
    # Once, and in their order: both chambers together stand under the name of one.
    near = dict.fromkeys(one.site for one in _rivalling(sites, data) if one.site not in (best, first.site))
    also = f"; {', '.join(near)} would do nearly as well" if near else ""
    words = f"an unknown signal at {best} explains the recordings best{also}"
    evidence, law = Comparison(0.0, 0.0, 1.0, 0.0, 0.0), None
    followed: tuple[str, ...] = ()
    if described is not None:
        effect, evidence = described.rival.effect, described.rival.against
        law, followed = law_at(base, described.rival.candidate, first.site), effect.depends_on
        there = "" if first.site == best else f" at {first.site}"
        values = own_values(effect, described.rival.candidate.rig, described.rival.candidate.answer)
        said = effect.says.format(**{name: quantity(value, "1") for name, value in values.items()})
        words += f"; {said}{there}, without a name"
    shown = tuple(telling(where.states, tuple(name for name in followed if name in where.states)))
    return Finding(
        None, kind, first.site, (), where, shown, evidence, first.gain, 0.0, (), words, first, law
    )  # fmt: skip
