"""An unknown signal at a site: estimated with the states, it shows which equation is wrong, and by how much.

The signal is a random walk whose step is estimated by likelihood; the site at which it explains the recordings
best is where physics is missing (the diffusion terms of Kristensen, Madsen and Jorgensen 2004, one at a time). It alone
is uncertain: were the states free to err as well, they would take over what is missing in one equation, and the signal
would be left with what that takes badly, at another site.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from optid.core.model import Array, Model
from optid.core.sheet import Sheet
from optid.diagnosis.candidate import Candidate, Data
from optid.diagnosis.instrument import Instrument
from optid.diagnosis.judge import Judged, judge
from optid.errors import SolveError
from optid.estimation.likelihood import WHOLE, Noise, run_steered, start_of
from optid.estimation.place import Answer, Place
from optid.estimation.problem import pose
from optid.estimation.scoring import likeliest, maximise
from optid.rigs.rigfile import with_effects

# Where a disturbance stands for all that can go wrong at a kind of site; other plants' sites stand for themselves.
# What goes wrong with the air may do so in both chambers.
TYPICAL = (
    ("valve.command",), ("flow.chamber_a",), ("flow.chamber_b",), ("flow.chamber_a", "flow.chamber_b"),
    ("force.external",), ("sensor.position",),
)  # fmt: skip
LOUD = 100.0  # times what shows: a walk's usual step by the square root of a second, the middle of its levels
STEPS = (-9.0, -7.5, -6.0, -5.0, -4.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0)  # log levels at which it is tried
SEARCH = 15  # iterations from the likeliest of these


class Disturbance(Instrument):
    """nominal + w, with w a random walk at each site."""

    def __init__(self, sites: tuple[str, ...], unit: str, scale: float) -> None:
        self.name, self.sites, self.unit, self.scale = "unknown", sites, unit, scale

    def apply(self, site: str, nominal: Any, near: Mapping[str, Any], sheet: Sheet) -> Any:
        """The nominal signal with the unknown one on top."""
        name = f"signal_{self.sites.index(site)}"
        w = sheet.state(name, self.unit, self.scale, spread=1e-3 * self.scale)
        sheet.rate(w, 0.0 * w)
        return nominal + w


@dataclass(frozen=True, eq=False)
class Located:
    """A site, how much better an unknown signal there explains the recordings, and the signal itself.

    Attributes:
        sites: of the plant, as "flow.chamber_a"; each had a signal of its own.
        gain: fall of -2 log likelihood against the model with no noise but the measurement's.
        signals: estimated from the past at each sample, in the sites' own unit, (samples, sites).
        answer: the fit with the signal.
        judged: that fit on the hold-out.
    """

    sites: tuple[str, ...]
    gain: float
    signals: Array
    answer: Answer
    judged: Judged

    @property
    def site(self) -> str:
        """That with the largest signal."""
        return self.sites[int(np.argmax(np.nanstd(self.signals, axis=0)))]

    @property
    def signal(self) -> Array:
        """There, (samples,)."""
        return np.asarray(self.signals[:, self.sites.index(self.site)])

    def only(self, site: str) -> Self:
        """The same of one of its sites."""
        return replace(self, sites=(site,), signals=self.signals[:, [self.sites.index(site)]])


def locate(candidate: Candidate, data: Data) -> list[Located]:
    """Every site with an unknown signal of its own, the best first."""
    found = [
        one
        for sites in places(candidate.rig.model)
        if (one := locate_at(candidate, data, *sites)) is not None
    ]
    return sorted(found, key=lambda one: -one.gain)


def places(model: Model) -> tuple[tuple[str, ...], ...]:
    """The sites to try: the typical ones, and one of every other kind that the plant offers."""
    chosen = [sites for sites in TYPICAL if set(sites) <= set(model.sites)]
    kinds = {site.partition(".")[0] for sites in chosen for site in sites}
    for site in reversed(model.sites):
        kind = site.partition(".")[0]
        if kind not in kinds:
            kinds.add(kind)
            chosen.append((site,))
    return tuple(chosen)


def locate_at(candidate: Candidate, data: Data, *sites: str) -> Located | None:
    """An unknown signal at one site, or one at each of several alike; ``None`` where none would show."""
    scale = push(candidate, data, sites[0])
    if scale is None:
        return None
    rig = with_effects(candidate.rig, (Disturbance(sites, "1", LOUD * scale),), {})
    model, plain = rig.model, candidate.rig.model
    own = [state.name for state in model.states]
    walks = tuple(own.index(f"unknown.signal_{k}") for k in range(len(sites)))
    question = replace(data.question(rig, plain), groups=(walks,))
    p = model.vector_from(plain, candidate.answer.p, rig.parameters)
    try:
        start = likeliest(question, [(p, np.array([level])) for level in STEPS])
        answer = maximise(question, *start, iterations=SEARCH, polish=False, since=candidate.answer.score)
    except SolveError:
        return None  # an unknown signal there takes the model out of the numbers
    signals = answer.filtered.states[0][:, list(walks)]
    return Located(sites, _still(candidate) - answer.score, signals, answer, judge(answer, data.holdout))


def _still(candidate: Candidate) -> float:
    """-2 log likelihood of a model with no process noise; of the model as it is where that is no model."""
    q = replace(candidate.answer.question, groups=())
    score = Place(q, candidate.answer.p, Noise(q.measurement, (), np.zeros(0))).score
    return score if math.isfinite(score) else candidate.answer.score


def push(candidate: Candidate, data: Data, site: str) -> float | None:
    """A constant at the site that moves the innovations by about one sd; ``None`` where none does.

    Where a model with held gains loses track before that, the largest one tried under which it does not; where it has
    lost track without any, what makes the middle of a walk's levels the signal's own usual size.
    """
    rig = with_effects(candidate.rig, (Disturbance((site,), "1", 1.0),), {})
    model, plain, answer = rig.model, candidate.rig.model, candidate.answer
    p = model.vector_from(plain, answer.p, rig.parameters)
    names = [state.name for state in model.states]
    common = [names.index(state.name) for state in plain.states]
    unknown = np.array([[float(name == "unknown.signal_0") for name in names]])
    begun = start_of(model, p[None], 1).mean[0]
    problem = pose(model, data.train, WHOLE)
    sd = np.sqrt(answer.filtered.variances[0])
    size, seen = 1e-9, 0.0
    usual = plain.sizes[plain.sites.index(site)] / LOUD or None
    for _ in range(17):
        start = begun + size * unknown
        moved = run_steered(model, problem, p[None], answer.filtered, common, start=start)[0]
        still = run_steered(model, problem, p[None], answer.filtered, common)[0]
        with np.errstate(invalid="ignore"):  # both may have left the numbers
            change = (moved - still) / sd
        if not np.isfinite(change[np.isfinite(answer.filtered.innovations[0])]).all():
            return size / 10.0 if seen > 0.0 else usual
        rms = float(np.sqrt(np.nanmean(change**2)))
        if rms > 0.1:
            return size / rms
        size, seen = size * 10.0, rms
    return None
