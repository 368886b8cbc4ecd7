"""What no effect explains: where it lies, and what describes it, for simulation, without a name.

Forms over signals, as in `forms`, compete as effects do, and what is held out decides whether one stays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from optid.diagnose.candidate import QUIETER, Candidate, Data
from optid.diagnose.disturbance import Located, locate_at
from optid.diagnose.finding import Finding
from optid.diagnose.forms import curves, fitting, kind_of, levels, shared, sticking, swelling, turned, waves
from optid.diagnose.judge import EXCESS, Comparison, compare, excess
from optid.diagnose.law import law_at
from optid.diagnose.lead import Ground, leads
from optid.diagnose.refit import LEVEL, WORTH, Contest, Rival, own_values, refit
from optid.diagnose.screen import Signature
from optid.diagnose.where import region, telling
from optid.diagnose.words import quantity
from optid.effects.description import Description
from optid.effects.effect import Effect
from optid.fit.scoring import quieted

DRAWN = 2  # curves that are refitted
# Their race, as in lead.RACE: curves have many parameters, so that a leg is dear, and few lead anywhere. They begin
# where the fitted model stands: from far away the first steps of so many parameters tell nothing.
CURVES = ((5, 10, 1), (5, 4, 1), (12, DRAWN, 1))
SWELLED = ((10, 4, 1), (8, 2, 1), (12, 1, 1))  # of one of them in proportion to several signals
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


def describe(
    base: Candidate, current: Candidate, sites: Sequence[Located], data: Data, tell: Callable[[str], None]
) -> Described | None:
    """What describes a mismatch best where it may lie, on what is held out; ``None`` if nothing is gained.

    Args:
        base: the model as it came.
        current: the same with the effects that a description comes to, if any.
        sites: where unknown signals were tried, the best first; those that do nearly as well count as well.
        data: recordings.
        tell: is told what is being done.
    """
    likely = [sites[0], *_rivalling(sites, data)[:ASIDE]]
    guide, plain = quieted(current.answer, QUIETER), base.rig.model
    places = {site: one.only(site) for one in reversed(likely) for site in one.sites}
    lasting: dict[str, Description] = {
        curve.name: curve for one in places.values() for curve in curves(current, one)
    }
    for one in likely:
        lasting |= {
            form.name: form
            for form in (*shared(current, one), *levels(current, one), *sticking(current, one))
        }
    forms = fitting(current.rig, lasting.values())
    sources = dict.fromkeys(SOURCES.get(kind_of(site), site) for site in places)
    ground = Ground.of(current.rig, guide, data, plain, guide.p)
    heard = [wave for site in sources if site in plain.sites for wave in waves(current, ground, site)]
    # Only a filter finds the phase of every recording: waves are not led, but refitted from where they are loudest.
    first = sorted(heard, key=lambda one: -one.gain)[:1]
    race = partial(leads, current, guide, data=data, plain=plain, near=True)
    led = [one for best in race(forms, race=CURVES) for one in _swelled(current, best, race)]
    contest = Contest(base, current, guide, len(forms) + len(heard), data, tell)
    rivals = refit(contest, [*first, *sorted(led, key=lambda one: -one.gain)])
    if rivals and not rivals[0].why and excess(rivals[0].candidate.judged, data.noise) > EXCESS:
        other = fitting(current.rig, turned(current, rivals[0].effect))
        rivals = refit(contest, race(other, race=SWELLED), rivals) if other else rivals
    best = next((rival for rival in rivals if not rival.why), None)
    if best is None:
        return None
    site = best.effect.sites[0]
    there = places.get(site) or locate_at(current, data, site)
    return None if there is None else Described(best, there)


def _swelled(current: Candidate, led: Signature, race: Callable[..., list[Signature]]) -> list[Signature]:
    """Where a form leads in proportion to another signal, if that is farther by enough to be worth a second one."""
    if not isinstance(led.effect, Description):
        return [led]
    more = race(fitting(current.rig, swelling(current, led.effect)), race=SWELLED)
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
