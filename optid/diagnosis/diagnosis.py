"""The diagnosis: base fit, search, where, how sure, and the verdict in words."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from optid.core.recording import Array, Recording
from optid.core.thinning import thinned
from optid.diagnosis.beginning import begun
from optid.diagnosis.by_simulation import by_simulation
from optid.diagnosis.bypass import done_by
from optid.diagnosis.candidate import Candidate, Data, fit_base, settled, widened
from optid.diagnosis.contest import LEVEL, own_values
from optid.diagnosis.disturbance import Located, locate, locate_at
from optid.diagnosis.finding import Closest, Diagnosis, Finding, Verdict
from optid.diagnosis.judge import EXCESS, cleared, compare, excess, fit_gain, missed
from optid.diagnosis.law import law_at
from optid.diagnosis.residuals import residual_tests
from optid.diagnosis.rivals import compared, indistinguishable
from optid.diagnosis.screen import Signature, screen
from optid.diagnosis.search import EVEN, Search, explains_little, needed, search, stands
from optid.diagnosis.settling import foreseen, likelier, plainer, rigidly
from optid.diagnosis.uncertainty import FEWEST, disagreement, estimates, resolution
from optid.diagnosis.unexplained import Described, Look, describe, listen, look, nameless
from optid.diagnosis.where import contribution, region, telling
from optid.diagnosis.words import quantity, summary
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.errors import InputError
from optid.estimation.multistep import preferable
from optid.estimation.result import Estimate
from optid.quality.noise import colour, noise_sd
from optid.rigs.rigfile import Rig

NOTHING = 0.01  # of the smallest size worth a name: what is below it is told in words
# Of the time limit: until when effects are searched for, what describes it all included, and what the search has in any
# case. What was found to be needed, and how sure it is, takes a minute of ten.
SEARCHED, OWN = 0.85, 0.4
VISIBLE = 5.0  # sd at which an effect of the smallest size worth a name would be found for sure


Report = Callable[[float, str], None]


def diagnose(
    rig: Rig,
    recordings: Sequence[Recording],
    holdout: Sequence[Recording],
    *,
    own: Sequence[Effect] = (),
    generator: np.random.Generator,
    progress: Report | None = None,
    time_limit: float = math.inf,
) -> Diagnosis:
    """Say what a rig's model leaves out.

    Args:
        rig: the base model; its [fit] table says what may be fitted.
        recordings: to fit; what is sampled faster than a kilohertz is averaged down to it first.
        holdout: to judge on; the fits never see them.
        own: effects of the user's, beside the catalogue.
        generator: of the resampling.
        progress: called with the share done and a few words.
        time_limit: s, about which the whole may take: of that, SEARCHED are for the base fit and the search for
            effects, which ends with what it has, but OWN are its own.

    Raises:
        InputError: nothing to fit or nothing held out.
        SolveError: the model cannot be simulated at the rig file's values.
    """
    report, start = progress or (lambda share, words: None), time.monotonic()
    if not rig.freed:
        raise InputError("nothing to fit", where=rig.path, field="[fit]", expected="at least one parameter")
    if not holdout:
        raise InputError("no recording held out", where="--holdout", expected="at least one recording")
    commands = [port.role for port in rig.model.recorded]
    recordings, given = [thinned(one, commands) for one in recordings], recordings
    holdout = [thinned(one, commands) for one in holdout]
    if any(one is not before for one, before in zip(recordings, given, strict=True)):
        # The stated noise is that of a single sample; that of the averages is estimated.
        rig = replace(rig, channels={role: replace(c, sd=None) for role, c in rig.channels.items()})
    noise = _noise(rig, [*recordings, *holdout])
    data = Data(tuple(recordings), tuple(holdout), noise, generator)
    base = fit_base(rig, data, report)
    if (later := begun(base, data)) is not data:
        data = later
        base = fit_base(rig, data, report)
    report(0.07, "the same from a plain start")
    base, rigid = rigidly(base, replace(data, until=start + SEARCHED * time_limit))
    data = replace(data, rigid=rigid.rigid)
    wide = _enough(base, data)
    if wide is None and (simulated := by_simulation(base, data)) is not None:
        base, data = simulated
    own_time = time.monotonic() + OWN * time_limit
    searched = replace(data, until=max(start + SEARCHED * time_limit, own_time))
    looked: list[Look] = []

    def aside() -> None:
        """What would describe it all without a name, for which the end may leave no time."""
        report(0.3, "locating the mismatch with an unknown signal")
        if sites := locate(base, data):
            looked.append(look(base, base, sites, searched, partial(report, 0.3)))

    found = Search(base, base, ()) if wide else search(base, own, searched, report, aside)
    last = next((one.screened for one in found.rounds if one.model is found.best), None)
    if last is None:
        last = tuple(screen(found.best.answer, data.train, admitted(found.best.rig.model, own)))
    data = replace(data, rigid=found.rigid)  # as the best model is, so are those compared with it
    hurried = replace(data, until=start + time_limit)
    found = _settled(found, data, hurried, report)
    whole = stands(base, found.best, data) or excess(found.best.judged, noise) <= EXCESS
    if found.best.effects and whole and not found.stopped:
        named = found.best.effects
        found = compared(found, own, data, partial(report, 0.94))
        if found.best.effects != named:
            last = tuple(screen(found.best.answer, data.train, admitted(found.best.rig.model, own)))
    likely = found  # its rivals started where it did
    if found.best.effects and whole:
        report(0.94, "the same from a plain start")
        found = replace(found, best=plainer(found.best, hurried))
    report(0.95, "intervals and residual tests")
    least = resolution(found.best)
    if found.best.effects and whole:
        # A law of another form than nature's may bring windows to the noise, and its values still be a recording's own;
        # two recordings say too little of that to widen what is at the noise.
        if len(data.train) >= FEWEST or excess(found.best.judged, noise) > EXCESS:
            report(0.95, "how far the recordings disagree")
            least = np.maximum(least, disagreement(found.best.answer))
        best, apart = foreseen(found.best, data)
        found, least = replace(found, best=best), least + apart  # as far as those of the likeliest reach
    best_parameters = estimates(found.best.answer, last, least, missed(found.best.judged, noise))
    base_parameters = (
        best_parameters
        if found.best is base
        else estimates(base.answer, (), ratio=missed(base.judged, noise))
    )
    verdict, best, sites, closest = (
        (Verdict.PARAMETERS, wide, (), None) if wide else _verdict(found, data, report, looked)
    )
    findings: tuple[Finding, ...] = ()
    if verdict is Verdict.MISSING_PHYSICS:
        findings = _findings(found, likely, best_parameters, data, report)
    elif sites:
        described = _described(base, found.best, sites, looked, hurried, partial(report, 0.97))
        best = found.best if described is None else described.rival.candidate
        findings = (nameless(base, sites, described, data),)
    if best is not found.best:
        best_parameters = estimates(best.answer, (), ratio=missed(best.judged, noise))
    residuals = residual_tests(best.judged, best.answer, data.holdout)
    diagnosis = Diagnosis(
        verdict, "", base, best, base_parameters, best_parameters, findings, _rejected(found, best, closest),
        _not_testable(found, last, own), noise, residuals, found, data, closest,
    )  # fmt: skip
    return replace(diagnosis, summary=summary(diagnosis))


def _settled(found: Search, data: Data, hurried: Data, report: Report) -> Search:
    """The best model at a likelier top, where its effects leave something: the search left the last units open."""
    rough = found.best
    if not rough.effects or excess(rough.judged, data.noise) <= EXCESS:
        return found
    if cleared(found.base.judged, rough.judged, data.noise) < 1.0 - EVEN:
        return found  # more is missing than a likelier top would show
    report(0.94, "where its windows lead")
    best = likelier(rough, hurried)
    if best is rough and stands(found.base, best, data):
        report(0.94, "settling what was found")
        best = settled(rough.effects, rough.rig, rough.answer.p, rough.answer, data, found.base.rig.model)
        if preferable(best.answer, rough.answer, rough.judged.horizon) is rough.answer:
            best = rough
    return replace(found, best=best)


def _described(
    base: Candidate,
    named: Candidate,
    sites: Sequence[Located],
    looked: Sequence[Look],
    data: Data,
    tell: Callable[[str], None],
) -> Described | None:
    """What describes a mismatch, unless names that fell short clear more of it.

    Those that explain much may describe most of it, and something without a name the rest.
    """
    if not looked and not data.over:
        looked = [look(base, base, sites, data, tell)]
    looked = [listen(one, data, tell) for one in looked]
    arrived = any(one.arrived for one in looked)
    if not arrived and not data.over and not explains_little(base, named, data):
        looked = [*looked, listen(look(base, named, sites, data, tell), data, tell)]
    found = [one for there in looked if (one := describe(there, data)) is not None]
    best = max(
        found, key=lambda one: cleared(base.judged, one.rival.candidate.judged, data.noise), default=None
    )
    if best is None:
        return None
    less = cleared(base.judged, best.rival.candidate.judged, data.noise)
    return None if less < cleared(base.judged, named.judged, data.noise) else best


def _noise(rig: Rig, recordings: Sequence[Recording]) -> dict[str, float]:
    """Of the measurement itself, per channel: as stated in the rig file, else from neighbouring samples.

    Coloured noise hides behind motion; recordings that rest now and then tell its colour, and speak for the others.
    """
    found = {}
    for port in rig.model.outputs:
        stated = rig.channels[port.role].sd if port.role in rig.channels else None
        values = [r[port.role].values for r in recordings if port.role in r]
        if not values:
            continue
        seen = [(noise_sd(v), colour(v) > 0.0) for v in (v[np.isfinite(v)] for v in values)]
        coloured = [sd for sd, told in seen if told] or [sd for sd, _ in seen]
        found[port.role] = float(stated or np.sqrt(np.mean(np.square(coloured))))
    return found


def _enough(base: Candidate, data: Data) -> Candidate | None:
    """The base model with wider bounds, where that alone explains the recordings: no physics is missing then."""
    if excess(base.judged, data.noise) <= EXCESS:
        return None
    wide = widened(base, data)
    if wide is None or excess(wide.judged, data.noise) > EXCESS:
        return None
    return wide if compare(base.judged, wide.judged, data.generator).p_value < LEVEL else None


def _findings(
    found: Search, likely: Search, parameters: tuple[Estimate, ...], data: Data, report: Report
) -> tuple[Finding, ...]:
    """Of every effect, as `best` has it; what named it, and what it may be confused with, `likely` tells.

    That is the same model where the search left it: likelihood is no judge of parameters that only predict better.
    """
    best = found.best
    findings = []
    for effect in best.effects:
        without = found.without[effect.name]
        report(0.96, f"what {effect.name} could be confused with")
        evidence = replace(
            compare(without.judged, likely.best.judged, data.generator),
            fit_gain=fit_gain(without.judged, best.judged),
        )
        gain = without.answer.score - likely.best.answer.score
        p = best.answer.p.copy()
        for name, null in effect.qualified(effect.at_null()).items():
            if name.removeprefix(f"{effect.name}.") in effect.strength:
                p[best.rig.model.index(name)] = null
        done = done_by(found.base, best, effect)
        where = region(best.answer, contribution(best.answer, p), done, data.train)
        shown = tuple(telling(where.states, tuple(s for s in effect.depends_on if s in where.states)))
        mine = tuple(
            replace(e, name=e.name.removeprefix(f"{effect.name}."))
            for e in parameters
            if e.name.startswith(f"{effect.name}.")
        )
        count = len(effect.fitted) * float(np.log(best.judged.deviance.size))
        findings.append(
            Finding(
                effect, effect.site, effect.sites[0], mine, where, shown, evidence, gain, gain - count,
                indistinguishable(likely, effect, data), _says(effect, best), *_signal(found, effect, data, report),
            )
        )  # fmt: skip
    return tuple(sorted(findings, key=lambda f: -f.train_gain))


def _signal(found: Search, effect: Effect, data: Data, report: Report) -> tuple[Located | None, Array | None]:
    """The unknown signal at the effect's site and the law there, at the first of its sites that the law changes."""
    for site in effect.sites:
        law = law_at(found.base, found.best, site)
        if law is not None and np.isfinite(law).all() and np.ptp(law) > 0.0:
            report(0.97, f"the unknown signal at {site}")
            return locate_at(found.base, data, site), law
    return None, None


def _says(effect: Effect, best: Candidate) -> str:
    values, units = own_values(effect, best.rig, best.answer), {q.name: q.unit for q in effect.parameters}
    faint = {name for name, least in effect.strength.items() if abs(values[name]) < NOTHING * least}
    return effect.says.format(
        **{
            name: "next to nothing" if name in faint else quantity(v, units[name])
            for name, v in values.items()
        }
    )


def _verdict(
    found: Search, data: Data, report: Report, looked: Sequence[Look] = ()
) -> tuple[Verdict, Candidate, Sequence[Located], Closest | None]:
    """What the search amounts to, the model that stands for it, where a rest lies, and names that fell short."""
    base, best = found.base, found.best
    if best.effects and excess(best.judged, data.noise) <= EXCESS:
        return Verdict.MISSING_PHYSICS, best, (), None
    if excess(base.judged, data.noise) <= EXCESS:
        return (Verdict.MISSING_PHYSICS if best.effects else Verdict.CONSISTENT), best, (), None
    if stands(base, best, data):
        return Verdict.MISSING_PHYSICS, best, (), None
    report(0.94, "locating the mismatch with an unknown signal")
    names = tuple(effect.name for effect in best.effects)
    closest = Closest(names, cleared(base.judged, best.judged, data.noise), needed(base)) if names else None
    return Verdict.UNEXPLAINED, base, looked[0].sites if looked else locate(base, data), closest


def _rejected(found: Search, best: Candidate, closest: Closest | None) -> tuple[tuple[str, str], ...]:
    """Every effect that was refitted and not kept, with the last reason."""
    kept = {effect.name for effect in best.effects}
    reasons: dict[str, str] = {name: str(closest) for name in (closest.effects if closest else ())}
    for number, one in enumerate(found.rounds):
        for rival in one.rivals:
            if rival.effect.name in kept or rival is one.winner:
                continue
            won = one.winner
            beaten = (
                f"{won.effect.name} explains more ({won.train_gain:.0f} against {rival.train_gain:.0f})"
                if won
                else ""
            )
            reasons[rival.effect.name] = rival.why or beaten or "not confirmed"
        if number == len(found.rounds) - 1:
            for signature in one.screened:
                name = signature.effect.name
                if name not in kept and name not in reasons and signature.visible >= VISIBLE:
                    reasons[name] = (
                        f"the screen finds no more than {max(signature.gain, 0.0):.0f} for it in -2 log likelihood"
                    )
    for last in found.dropped:
        reasons[last.effect.name] = f"beside the others: {last.why}"
    for name, others in found.instead.items():
        for other in others:
            less = other.candidate.answer.score - best.answer.score
            if name in kept and less > 0.0 and not other.level:
                reasons[other.effect.name] = f"in its place {name} explains more (by {less:.0f})"
    return tuple(reasons.items())


def _not_testable(
    found: Search, last: Sequence[Signature], own: Sequence[Effect]
) -> tuple[tuple[str, str, str], ...]:
    """Effects that these recordings would not show at the smallest size worth a name."""
    seen = {s.effect.name: s for s in last}
    rows = []
    for effect in admitted(found.best.rig.model, own):
        signature = seen.get(effect.name)
        if signature is None:
            rows.append(
                (effect.name, f"nothing in these recordings would change; it needs {effect.needs}", "")
            )
        elif signature.visible < VISIBLE:
            smallest = VISIBLE / max(signature.visible, 1e-9)
            name, least = next(iter(effect.strength.items()))
            unit = next(q.unit for q in effect.parameters if q.name == name)
            why = (
                f"at {quantity(least, unit)} it would stand out by {signature.visible:.1f} sd after a refit; "
                f"it needs {effect.needs}"
            )
            rows.append((effect.name, why, f"{name} {quantity(least * smallest, unit)}"))
    return tuple(rows)
