"""An unknown signal at a site: estimated with the states, it shows which equation is wrong, and by how much.

The signal is a random walk whose step is estimated by likelihood; the site at which it explains the recordings
best is where physics is missing (the diffusion terms of Kristensen, Madsen and Jorgensen 2004, one at a time). Only
the signal has process noise: if the states had it as well, they would absorb the mismatch of one equation, and the
signal would fit the remainder at another site.

A walk alone would favour wrong sites: bursts at a valve add up to a walk of the force behind it. Each site's signal may
therefore be a Gauss-Markov process of shorter correlation time as well, and the best one counts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from optid.core.model import Array
from optid.core.parameter import Parameter
from optid.core.sheet import Sheet
from optid.core.threads import parallel_map
from optid.diagnosis.fitted import FittedModel
from optid.diagnosis.localisation.instrument import Instrument
from optid.diagnosis.problem import DiagnosisProblem
from optid.errors import SolveError
from optid.estimation.fisher_scoring import noise_levels, successive_halving
from optid.estimation.fixed_gain import fixed_gain_fit
from optid.estimation.likelihood import Filtered, Noise, deviance, run_filter, run_fixed_gain_filter, start_of
from optid.estimation.likelihood_point import LikelihoodProblem
from optid.estimation.problem import Problem
from optid.rigs.rigfile import with_effects

LOUD = 100.0  # times the smallest visible signal: usual step of the random walk in a second, the middle level
TURNS, GAUSS_NEWTON = 2, 3  # iterations with new gains, and steps of each
# Samples: of signals that are no walk, from one that lasts a while to one that hardly lasts.
CORRELATION_TIMES = (15.0, 2.5)
FORGETTING = Parameter(
    "forgetting", "1/s", 1.0, "rate at which the signal is forgotten", "0: a walk", 0.0, fitted=False
)


class Disturbance(Instrument):
    """nominal + w, with w a random walk at each site, or one that is forgotten at a rate."""

    parameters = (FORGETTING,)

    def __init__(self, sites: tuple[str, ...], unit: str, scale: float) -> None:
        self.name, self.sites, self.unit, self.scale = "unknown", sites, unit, scale

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The nominal signal plus the unknown one."""
        name = f"signal_{self.sites.index(site)}"
        w = sheet.state(name, self.unit, self.scale, spread=1e-3 * self.scale)
        sheet.rate(w, -sheet.param(FORGETTING) * w)
        return nominal + w


@dataclass(frozen=True, eq=False)
class UnknownInput:
    """An estimated signal at a site, or at several similar ones, and its gain in likelihood.

    Attributes:
        sites: of the plant, as "flow.chamber_a"; each with its own signal.
        gain: decrease of -2 log likelihood compared with the model with measurement noise only.
        signals: filtered estimates of the walk at each sample, in the sites' units, (samples, sites).
        sd: standard deviations of the filter, (samples, sites).
        deviance: -2 log likelihood of each sample at the best correlation time, as the gain, (samples,).
        p: parameters of the model without it, fitted with it, (parameters,).
        correlation_time: that explains most, samples; infinite for a walk.
    """

    sites: tuple[str, ...]
    gain: float
    signals: Array
    sd: Array
    deviance: Array
    p: Array
    correlation_time: float = math.inf

    def with_gain_of(self, other: Self) -> Self:
        """The same signals, which explain as much as those of another correlation time or with other parameters."""
        return replace(
            self, gain=other.gain, deviance=other.deviance, p=other.p, correlation_time=other.correlation_time
        )

    @property
    def site(self) -> str:
        """The site with the largest signal."""
        return self.sites[int(np.argmax(np.nanstd(self.signals, axis=0)))]

    @property
    def signal(self) -> Array:
        """The signal at that site, (samples,)."""
        return np.asarray(self.signals[:, self.sites.index(self.site)])

    @property
    def signal_sd(self) -> Array:
        """Its standard deviation, (samples,)."""
        return np.asarray(self.sd[:, self.sites.index(self.site)])

    def only(self, site: str) -> Self:
        """The same for one of its sites."""
        k = [self.sites.index(site)]
        return replace(self, sites=(site,), signals=self.signals[:, k], sd=self.sd[:, k])

    def at_samples_of(self, problem: Problem, own: Problem) -> Self:
        """The same signals at the samples of another problem with the same recordings; they were estimated in `own`."""
        if len(problem.time) == len(own.time):
            return self
        there, here = (np.repeat(one.recording, one.counts + 1) for one in (problem, own))
        signals, sd = (np.empty((len(problem.time), len(self.sites))) for _ in range(2))
        for number in np.unique(there):
            to, of = there == number, here == number
            for k in range(len(self.sites)):
                for into, found in ((signals, self.signals), (sd, self.sd)):
                    into[to, k] = np.interp(problem.time[to], own.time[of], found[of, k])
        return replace(self, signals=signals, sd=sd)


def locate(model: FittedModel, problem: DiagnosisProblem) -> list[UnknownInput]:
    """Unknown inputs at all places where the plant says that something may be missing, the best first.

    Sites that the recordings do not tell apart have the same likelihood only with the same parameters: every other one
    is also tried with the parameters of the best.
    """
    tried = parallel_map(lambda sites: _with_best_correlation_time(model, problem, sites), places(model))
    found = sorted((one for one in tried if one is not None), key=lambda one: -one.gain)
    again = parallel_map(lambda one: _at_parameters_of(found[0], one, model, problem), found[1:])
    return sorted([*found[:1], *again], key=lambda one: -one.gain)


def places(model: FittedModel) -> tuple[tuple[str, ...], ...]:
    """The sites to try: those that the plant suggests, and one of every other kind that it offers."""
    plant = model.rig.model
    chosen = list(plant.suspects)
    kinds = {site.partition(".")[0] for sites in chosen for site in sites}
    for site in reversed(plant.sites):
        kind = site.partition(".")[0]
        if kind not in kinds:
            kinds.add(kind)
            chosen.append((site,))
    return tuple(chosen)


def _with_best_correlation_time(
    model: FittedModel, problem: DiagnosisProblem, sites: tuple[str, ...]
) -> UnknownInput | None:
    """A walk at these sites, with the gain of the best correlation time; shorter ones while each explains more."""
    walk = locate_at(model, problem, *sites)
    if walk is None:
        return None
    best = walk
    for correlation_time in CORRELATION_TIMES:
        one = locate_at(model, problem, *sites, begin=best.p, turns=1, correlation_time=correlation_time)
        if one is None or one.gain <= best.gain:
            break
        best = one
    return walk if walk is best else walk.with_gain_of(best)


def _at_parameters_of(
    best: UnknownInput, one: UnknownInput, model: FittedModel, problem: DiagnosisProblem
) -> UnknownInput:
    """The input at another site with the best one's parameters, if these explain more and could come near."""
    if one.gain < best.gain / 2.0:
        return one
    other = locate_at(
        model, problem, *one.sites, begin=best.p, turns=0, correlation_time=one.correlation_time
    )
    return one if other is None or other.gain < one.gain else one.with_gain_of(other)


def locate_at(
    model: FittedModel,
    problem: DiagnosisProblem,
    *sites: str,
    begin: Array | None = None,
    turns: int = TURNS,
    correlation_time: float = math.inf,
) -> UnknownInput | None:
    """An unknown input at one site, or at each of several similar ones; ``None`` where none would be visible.

    The model's parameters are fitted with it in so many `turns`, from its own or those to `begin` with, (parameters,).
    It is a walk, or has a finite `correlation_time`, samples.
    """
    scale = push(model, problem, sites[0])
    if scale is None:
        return None
    forgetting = 1.0 / (correlation_time * float(np.median(model.likelihood_problem.problem.dt)))
    size = LOUD * scale * max(1.0, math.sqrt(forgetting))  # as large as a walk within a second
    rig = with_effects(model.rig, (Disturbance(sites, "1", size),), {"unknown.forgetting": forgetting})
    own = [state.name for state in rig.model.states]
    walks = tuple(own.index(f"unknown.signal_{k}") for k in range(len(sites)))
    q = replace(problem.likelihood_problem(rig), groups=(walks,))
    plain = model.likelihood_problem.model
    p = q.model.vector_from(plain, model.p if begin is None else begin, rig.parameters)
    try:
        for left in reversed(range(turns + 1)):
            p, levels = successive_halving(q, [(p, levels) for levels in noise_levels(q)])
            if left:
                p = fixed_gain_fit(q, p, q.model, _filtered(q, p, levels), GAUSS_NEWTON).p
        f = _filtered(q, p, _refined_levels(q, p, levels), covariances=True)
    except SolveError:
        return None  # with an unknown input there the simulation diverges
    each = deviance(f.innovations[0], f.variances[0])
    if not math.isfinite(float(each.sum())):
        return None
    gain, drift = _noiseless(model) - float(each.sum()), list(walks)
    sd = np.sqrt(f.covariances[0][:, drift, drift])
    own_p = p[[q.model.index(one.name) for one in plain.parameters]]
    return UnknownInput(sites, gain, f.states[0][:, drift], sd, each, own_p, correlation_time)


def _refined_levels(q: LikelihoodProblem, p: Array, levels: Array) -> Array:
    """The most likely levels between those of the grid.

    One signal has other units at another site, and the same step lies elsewhere on the grid there.
    """
    best = _score(q, p, levels)
    for step in (0.5, 0.25, 0.125):
        near = [(_score(q, p, levels + by), levels + by) for by in (-step, step)]
        best, levels = min((best, levels), *near, key=lambda one: one[0])
    return levels


def _score(q: LikelihoodProblem, p: Array, levels: Array) -> float:
    """-2 log likelihood; infinite where the simulation diverges."""
    f = _filtered(q, p, levels)
    return float(np.nan_to_num(deviance(f.innovations[0], f.variances[0]).sum(), nan=math.inf))


def _filtered(q: LikelihoodProblem, p: Array, levels: Array, covariances: bool = False) -> Filtered:
    noise = Noise(q.measurement, q.groups, levels)
    Q = noise.spectrum(len(q.model.states))[None]
    return run_filter(
        q.model, q.problem, p[None], Q, noise.measurement[None], keep=True, covariances=covariances
    )


def _noiseless(model: FittedModel) -> float:
    """-2 log likelihood of a model without process noise; of the quiet filter's innovations where that diverges."""
    q = model.likelihood_problem
    Q = Noise(q.measurement, (), np.zeros(0)).spectrum(len(q.model.states))[None]
    f = run_filter(q.model, q.problem, model.p[None], Q, q.measurement[None])
    score = float(deviance(f.innovations[0], f.variances[0]).sum())
    if math.isfinite(score):
        return score
    held = model.fit.filtered
    return float(deviance(held.innovations[0], held.variances[0]).sum())


def push(fitted: FittedModel, problem: DiagnosisProblem, site: str) -> float | None:
    """A constant at the site that changes the innovations by about one sd; ``None`` where none does.

    If a model with fixed gains diverges before that, the largest constant at which it does not; if it diverges without
    any, the one that makes the middle level of the walk the signal's usual size.
    """
    rig = with_effects(fitted.rig, (Disturbance((site,), "1", 1.0),), {})
    model, plain, held = rig.model, fitted.rig.model, fitted.fit.filtered
    p = model.vector_from(plain, fitted.p, rig.parameters)
    names = [state.name for state in model.states]
    common = [names.index(state.name) for state in plain.states]
    unknown = np.array([[float(name == "unknown.signal_0") for name in names]])
    begun = start_of(model, p[None], 1).mean[0]
    data = fitted.likelihood_problem.problem
    sd = np.sqrt(fitted.likelihood_problem.measurement)
    size, seen = 1e-9, 0.0
    usual = plain.sizes[plain.sites.index(site)] / LOUD or None
    for _ in range(17):
        start = begun + size * unknown
        moved = run_fixed_gain_filter(model, data, p[None], held, common, start=start)[0]
        still = run_fixed_gain_filter(model, data, p[None], held, common)[0]
        with np.errstate(invalid="ignore"):  # both may have diverged
            change = (moved - still) / sd
        if not np.isfinite(change[np.isfinite(held.innovations[0])]).all():
            return size / 10.0 if seen > 0.0 else usual
        rms = float(np.sqrt(np.nanmean(change**2)))
        if rms > 0.1:
            return size / rms
        size, seen = size * 10.0, rms
    return None
