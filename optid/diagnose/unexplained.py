"""What no effect explains: where it lies, and what describes it, for simulation, without a name.

A curve runs over the state or input that leads farthest from where the mismatch was located; several sites share one
that scales what is there; a relaxation remembers such a signal for a time; a wave goes on by itself, over time or a
length. They compete as effects do, and what is held out decides whether one stays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from optid.diagnose.candidate import QUICK, QUIETER, Candidate, Data
from optid.diagnose.disturbance import Located, locate_at
from optid.diagnose.finding import Finding
from optid.diagnose.forms import curves, fitting, kind_of, levels, shared, swelling, waves
from optid.diagnose.judge import Comparison, compare
from optid.diagnose.law import law_at
from optid.diagnose.lead import leads
from optid.diagnose.refit import LEVEL, Contest, Rival, own_values, refit
from optid.diagnose.screen import Signature
from optid.diagnose.where import region, telling
from optid.diagnose.words import quantity
from optid.effects.description import Description
from optid.fit.place import Answer
from optid.fit.scoring import quieted

DRAWN = 2  # curves that are refitted
# Their race, as in lead.RACE: curves have many parameters, so that a leg is dear, and few lead anywhere. They begin
# where the fitted model stands: from far away the first steps of so many parameters tell nothing.
CURVES = ((10, 10, 1), (8, 4, 1), (QUICK, DRAWN, 1))
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
    lasting: dict[str, Description] = {
        curve.name: curve for one in places.values() for curve in curves(base, one)
    }
    for one in likely:
        lasting |= {form.name: form for form in (*shared(base, one), *levels(base, one))}
    forms = fitting(base.rig, lasting.values())
    sources = dict.fromkeys(SOURCES.get(kind_of(site), site) for site in places)
    heard = [
        wave for site in sources if site in base.rig.model.sites for wave in waves(base, guide, site, data)
    ]
    # Only a filter finds the phase of every recording: waves are not led, but refitted from where they are loudest.
    first = sorted(heard, key=lambda one: -one.gain)[:1]
    led = _led(base, guide, forms, data)
    contest = Contest(base, base, guide, len(forms) + len(heard), data, tell)
    rivals = refit(contest, [*first, *led])
    best = next((rival for rival in rivals if not rival.why), None)
    if best is None:
        return None
    site = best.effect.sites[0]
    there = places.get(site) or locate_at(base, data, site)
    return None if there is None else Described(best, there)


def _led(base: Candidate, guide: Answer, forms: Sequence[Description], data: Data) -> list[Signature]:
    """Where the best forms lead, each as it is or in proportion to another signal, whichever leads farther."""
    race = partial(leads, base, guide, data=data, plain=base.rig.model, near=True, race=CURVES)
    own = {form.name: form for form in forms}
    found = []
    for led in race(effects=forms):
        swelled = race(effects=fitting(base.rig, swelling(base, own[led.effect.name])))
        found.append(max([led, *swelled[:1]], key=lambda one: one.gain))
    return sorted(found, key=lambda one: -one.gain)


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
        values = own_values(effect, described.rival.candidate.rig, described.rival.candidate.answer)
        said = effect.says.format(**{name: quantity(value, "1") for name, value in values.items()})
        words += f"; {said}{there}, without a name"
    shown = tuple(telling(where.states, tuple(name for name in followed if name in where.states)))
    return Finding(
        None, kind, first.site, (), where, shown, evidence, first.gain, 0.0, (), words, first, law
    )  # fmt: skip
