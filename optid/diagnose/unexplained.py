"""What no effect explains: where it lies, and what describes it, for simulation, without a name.

A curve runs over the state or input that leads farthest from where the mismatch was located; a wave goes on by itself,
over time or a length. They compete as effects do, and what is held out decides whether one stays.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from optid.core.model import Array
from optid.diagnose.candidate import QUIETER, Candidate, Data
from optid.diagnose.disturbance import Located, locate_at, push
from optid.diagnose.finding import Finding
from optid.diagnose.judge import Comparison, compare
from optid.diagnose.law import law_at
from optid.diagnose.lead import Ground, leads
from optid.diagnose.line import loudest
from optid.diagnose.refit import LEVEL, Contest, Rival, own_values, refit
from optid.diagnose.screen import Signature, grown
from optid.diagnose.where import region, telling
from optid.diagnose.words import quantity
from optid.effects.curve import Curve
from optid.effects.effect import Effect
from optid.effects.wave import TIME, Wave
from optid.errors import RigError
from optid.fit.place import Answer
from optid.fit.scoring import quieted
from optid.rigs.rigfile import Rig

DRAWN = 2  # curves that are refitted
SOURCES = {"flow": "flow.supply"}  # where waves come from that show at a kind of site
# The fastest waves that are looked for: Hz, and periods within the range of a length.
FASTEST, FINEST = 30.0, 100.0
LENGTHS = ("m", "rad")
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


def describe(base: Candidate, located: Located, data: Data, tell: Callable[[str], None]) -> Described | None:
    """The curve or wave where the mismatch lies that predicts what is held out best; ``None`` if nothing is gained."""
    guide = quieted(base.answer, QUIETER)
    places = {site: located.only(site) for site in located.sites}
    curves = [curve for one in places.values() for curve in _curves(base, one) if _fits(base.rig, curve)]
    sources = dict.fromkeys(SOURCES.get(site.partition(".")[0], site) for site in located.sites)
    waves = [
        wave for site in sources if site in base.rig.model.sites for wave in _waves(base, guide, site, data)
    ]
    # Only a filter finds the phase of every recording: waves are not led, but refitted from where they are loudest.
    first = sorted(waves, key=lambda one: -one.gain)[:1]
    contest = Contest(base, base, guide, len(curves) + len(waves), data, tell)
    rivals = refit(contest, [*first, *leads(base, guide, curves, data, base.rig.model)[:DRAWN]])
    best = next((rival for rival in rivals if not rival.why), None)
    if best is None:
        return None
    (site,) = best.effect.sites
    there = places.get(site) or locate_at(base, data, site)
    return None if there is None else Described(best, there)


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


def _curves(base: Candidate, located: Located) -> Sequence[Curve]:
    """Over every physical state and recorded input, as it is and turning with every speed."""
    model, answer, size = base.rig.model, base.answer, float(np.nanstd(located.signal))
    if not size > 0.0:
        return []
    states = {state.name: k for k, state in enumerate(model.states)}
    followed: dict[str, Array] = {
        state.name: answer.filtered.states[0][:, states[state.name]]
        for state in model.states
        if state.unit != "1" and "." not in state.name
    }
    speeds = [state.name for state in model.states if state.unit in SPEEDS and state.name in followed]
    turns = {name: TURN * float(np.sqrt(np.nanmean(followed[name] ** 2))) for name in speeds}
    for column, port in enumerate(model.inputs):
        if port in model.recorded:
            followed[port.role] = answer.question.problem.inputs[:, column]
    ends = {name: (float(np.nanmin(values)), float(np.nanmax(values))) for name, values in followed.items()}
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
    kind, best = first.site.partition(".")[0], first.site if first.site in sites[0].sites else sites[0].site
    near = {
        one.site: True  # once, and in their order: both chambers together stand under the name of one
        for one in sites[1:]
        if one.site not in (best, first.site)
        and compare(one.judged, sites[0].judged, data.generator).p_value > LEVEL
    }
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
