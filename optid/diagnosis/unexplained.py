"""What no effect explains: where it lies, and what describes it, for simulation, without a name.

Forms over signals, as in `forms`, compete as effects do, and what is held out decides whether one stays.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from optid.diagnosis.afar import from_afar
from optid.diagnosis.bypass import done_by
from optid.diagnosis.candidate import QUIETER, Candidate, Data
from optid.diagnosis.contest import LEVEL, WORTH, Contest, Rival, own_values
from optid.diagnosis.disturbance import Located, locate_at
from optid.diagnosis.finding import Finding
from optid.diagnosis.following import at_noise, led_on
from optid.diagnosis.forms import curves, fitting, kind_of, levels, shared, sticking, swelling, turned, waves
from optid.diagnosis.judge import Comparison, beyond_noise, compare
from optid.diagnosis.law import law_at
from optid.diagnosis.lead import Ground
from optid.diagnosis.refit import refit
from optid.diagnosis.screen import Signature
from optid.diagnosis.where import by_usual_size, region, running_rms, telling
from optid.diagnosis.words import quantity
from optid.effects.description import Description
from optid.effects.effect import Effect
from optid.estimation.scoring import quieted

DRAWN = 2  # curves that are followed
# Their race, as in afar.RACE: curves have many parameters, so that a leg is dear, and few lead anywhere. They begin
# where the fitted model stands, or an unknown signal at a sensor: from far away the first steps of so many parameters
# tell nothing.
CURVES = ((2, 6, 1), (3, 3, 1), (5, DRAWN, 1))
SWELLED = ((4, 4, 1), (3, 2, 1), (5, 1, 1))  # of one of them in proportion to several signals
SOURCES = {"flow": "flow.supply"}  # where waves come from that show at a kind of site
ASIDE = 2  # places beside the best at which a description is looked for


@dataclass(frozen=True, eq=False)
class Described:
    """What describes a mismatch.

    Attributes:
        rival: the fitted description, which competed as effects do.
        located: the unknown signal where it acts.
    """

    rival: Rival
    located: Located


@dataclass(frozen=True, eq=False)
class Look:
    """Forms where they led from a model, and on by the gains of their own filters.

    Attributes:
        sites: where unknown signals were tried, the best first.
        likely: the best of them, and those that do nearly as well.
        contest: in which forms come to a model.
        led: forms where they led, those to be refitted first.
        rivals: those that were followed, the best first.
    """

    sites: Sequence[Located]
    likely: Sequence[Located]
    contest: Contest
    led: Sequence[Signature]
    rivals: Sequence[Rival]

    @property
    def best(self) -> Rival | None:
        """The best that is confirmed."""
        return next((rival for rival in self.rivals if not rival.why), None)

    @property
    def arrived(self) -> bool:
        """Its windows held out are at the noise."""
        return self.best is not None and at_noise(self.best, self.contest.data)


def look(
    base: Candidate, current: Candidate, sites: Sequence[Located], data: Data, tell: Callable[[str], None]
) -> Look:
    """Where forms lead that may describe a mismatch where it may lie; waves are for `listen`.

    Args:
        base: the model as it came.
        current: the same with the effects that a description comes to, if any.
        sites: where unknown signals were tried, the best first; those that do nearly as well count as well.
        data: recordings.
        tell: is told what is being done.
    """
    likely = [sites[0], *_rivalling(sites, data)[:ASIDE]]
    lasting: dict[str, Description] = {
        curve.name: curve for one in _places(likely).values() for curve in curves(current, one)
    }
    for one in likely:
        lasting |= {form.name: form for form in (*shared(current, one), *sticking(current, one))}
    lasting |= {form.name: form for form in levels(current)}
    forms = fitting(current.rig, lasting.values())
    contest = Contest(base, current, quieted(current.answer, QUIETER), len(forms), data, tell)
    raced = _race(contest, forms, CURVES, _places(likely) if current is base else {})
    led = [one for best in raced for one in _swelled(contest, best)]
    led = _ordered(led, [kind_of(one.site) for one in likely])
    return _turned(Look(sites, likely, contest, led, led_on(contest, led)), led_on)


def listen(looked: Look, data: Data, tell: Callable[[str], None]) -> Look:
    """With the loudest wave where the mismatch may lie, if no form has arrived and there is time.

    Only a filter finds the phase of every recording: waves are not led, but begin where they are loudest.
    """
    if looked.arrived or data.over:
        return looked
    c = replace(looked.contest, data=data, tell=tell)
    plain, guide = c.base.rig.model, c.guide
    sources = dict.fromkeys(SOURCES.get(kind_of(site), site) for site in _places(looked.likely))
    ground = Ground.of(c.current.rig, guide, data, plain, guide.p)
    heard = [wave for site in sources if site in plain.sites for wave in waves(c.current, ground, site)]
    first = sorted(heard, key=lambda one: -one.gain)[:1]
    c = replace(c, screened=c.screened + len(heard))
    return replace(looked, contest=c, led=[*first, *looked.led], rivals=led_on(c, first, looked.rivals))


def describe(looked: Look, data: Data) -> Described | None:
    """What describes a mismatch best, on what is held out; ``None`` if nothing is gained.

    What has not arrived where it led is refitted, as effects are, while the time of the data allows.
    """
    there = replace(looked, contest=replace(looked.contest, data=data))
    if not there.arrived:
        few = [_further(one, there.rivals) for one in there.led]
        there = _turned(replace(there, rivals=refit(there.contest, few, there.rivals)), refit)
    if there.best is None:
        return None
    site = there.best.effect.sites[0]
    placed = _places(looked.sites).get(site) or locate_at(looked.contest.current, data, site)
    return None if placed is None else Described(there.best, placed)


def _turned(there: Look, compete: Callable[..., list[Rival]]) -> Look:
    """With the best form turned, if it can be, where windows err beyond the noise."""
    c = there.contest
    if there.best is None or not beyond_noise(there.best.candidate.judged, c.data.noise):
        return there
    other = fitting(c.current.rig, turned(c.current, there.best.effect))
    if not other or any(rival.effect.name == other[0].name for rival in there.rivals):
        return there
    return replace(there, rivals=compete(c, _race(c, other, SWELLED, {}), there.rivals))


def _ordered(led: Sequence[Signature], kinds: Sequence[str]) -> list[Signature]:
    """The best first; of those about as good the one where the mismatch lies rather than elsewhere.

    What a command is given too little a force may give as well, and who arrives first leaves the others nothing.
    """
    best = max((one.gain for one in led), default=0.0)

    def place(one: Signature) -> tuple[bool, int, float]:
        kind = kind_of(one.effect.sites[0])
        where = kinds.index(kind) if kind in kinds else len(kinds)
        return one.gain < (1.0 - WORTH) * best, where, -one.gain

    return sorted(led, key=place)


def _race(
    c: Contest,
    forms: Sequence[Description],
    race: Sequence[tuple[int, int, int]],
    near: Mapping[str, Located],
) -> list[Signature]:
    return from_afar(c.current, c.guide, forms, c.data, c.base.rig.model, near=near, race=race)


def _further(led: Signature, rivals: Sequence[Rival]) -> Signature:
    """A form where it was followed to, if that is likelier than the model without it."""
    for rival in rivals:
        if rival.effect is led.effect and rival.train_gain > 0.0:
            rig, p = rival.candidate.rig, rival.candidate.answer.p
            own = own_values(led.effect, rig, rival.candidate.answer)
            beside = {q.name: float(v) for q, v in zip(rig.model.parameters, p, strict=True)}
            beside = {name: v for name, v in beside.items() if not name.startswith(f"{led.effect.name}.")}
            return replace(led, values=own, beside=beside)
    return led


def _places(likely: Sequence[Located]) -> dict[str, Located]:
    """Every site alone, as the best of these has it."""
    return {site: one.only(site) for one in reversed(likely) for site in one.sites}


def _swelled(c: Contest, led: Signature) -> list[Signature]:
    """Where a form leads in proportion to another signal, if that is farther by enough to be worth a second one."""
    if not isinstance(led.effect, Description):
        return [led]
    more = _race(c, fitting(c.current.rig, swelling(c.current, led.effect)), SWELLED, {})
    return [one for one in more if one.gain > (1.0 + WORTH) * led.gain] or [led]


def _rivalling(sites: Sequence[Located], data: Data) -> list[Located]:
    """Those that held-out recordings do not tell from the first."""
    return [one for one in sites[1:] if compare(one.judged, sites[0].judged, data.generator).p_value > LEVEL]


def nameless(base: Candidate, sites: Sequence[Located], described: Described | None, data: Data) -> Finding:
    """What is not explained, as a finding: where it lies, and what describes it."""
    first = sites[0] if described is None else described.located
    signal = first.signal / max(float(np.nanstd(first.signal)), 1e-300)
    outputs = len(base.rig.model.outputs)
    spread = np.repeat((signal - np.nanmedian(signal))[:, None], outputs, axis=1)
    measured = np.isfinite(base.answer.filtered.innovations[0])
    if described is None:
        done = by_usual_size(running_rms(signal - np.nanmedian(signal), base.answer.question.problem))
    else:
        done = done_by(base, described.rival.candidate, described.rival.effect)
    where = region(base.answer, np.where(measured, spread, np.nan), done, data.train)
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
        said = _said(effect, described.rival.candidate)
        words += f"; {said}{there}, without a name"
    shown = tuple(telling(where.states, tuple(name for name in followed if name in where.states)))
    return Finding(
        None, kind, first.site, (), where, shown, evidence, first.gain, 0.0, (), words, first, law
    )  # fmt: skip


def _said(effect: Effect, candidate: Candidate) -> str:
    """What a description says, with the values that were fitted."""
    units = {q.name: q.unit for q in effect.parameters}
    values = own_values(effect, candidate.rig, candidate.answer)
    return effect.says.format(**{name: quantity(value, units[name]) for name, value in values.items()})
