"""What no effect explains: where it lies, and a curve that describes it, for simulation, without a name.

The curve runs over the state or input that leads farthest from where the mismatch was located. It competes as effects
do, and what is held out decides whether it stays.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from optid.core.model import Array
from optid.diagnose.candidate import QUIETER, Candidate, Data
from optid.diagnose.disturbance import Located
from optid.diagnose.finding import Finding
from optid.diagnose.judge import Comparison, compare
from optid.diagnose.law import law_at
from optid.diagnose.lead import leads
from optid.diagnose.refit import LEVEL, Contest, Rival, refit
from optid.diagnose.screen import grown
from optid.diagnose.where import region, telling
from optid.effects.curve import Curve
from optid.errors import RigError
from optid.fit.scoring import quieted
from optid.rigs.rigfile import Rig

DRAWN = 2  # curves that are refitted
TURN = 0.05  # of the speed's root mean square: where a curve that turns with its sign has turned
SPEEDS = ("m/s", "rad/s")


def describe(base: Candidate, located: Located, data: Data, tell: Callable[[str], None]) -> Rival | None:
    """The curve where the mismatch lies that predicts what is held out best; ``None`` if none beats no curve."""
    sizes = np.nanstd(located.signals, axis=0).tolist()
    guide = quieted(base.answer, QUIETER)
    curves = [
        curve
        for site, size in zip(located.sites, sizes, strict=True)
        if size > 0.0
        for curve in _curves(base, site, size)
        if _fits(base.rig, curve)
    ]
    contest = Contest(base, base, guide, len(curves), data, tell)
    rivals = refit(contest, leads(base, guide, curves, data, base.rig.model)[:DRAWN])
    return next((rival for rival in rivals if not rival.why), None)


def _curves(base: Candidate, site: str, size: float) -> Sequence[Curve]:
    """Over every physical state and recorded input, as it is and turning with every speed."""
    model, answer = base.rig.model, base.answer
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
    curve = partial(Curve, site, size=size)
    plain = [curve(name, low=low, high=high) for name, (low, high) in moving.items()]
    return plain + [
        curve(name, speed, low=low, high=high, width=width)
        for speed, width in turns.items()
        if width > 0.0
        for name, (low, high) in moving.items()
        if name != speed
    ]


def _fits(rig: Rig, curve: Curve) -> bool:
    """Whether the plant has declared by then what the curve follows."""
    try:
        grown(rig, curve)
    except RigError:
        return False
    return True


def nameless(base: Candidate, sites: Sequence[Located], described: Rival | None, data: Data) -> Finding:
    """What is not explained, as a finding: where it lies, and what describes it."""
    first = sites[0] if described is None else sites[0].only(described.effect.sites[0])
    signal = first.signal / max(float(np.nanstd(first.signal)), 1e-300)
    outputs = len(base.rig.model.outputs)
    spread = np.repeat((signal - np.nanmedian(signal))[:, None], outputs, axis=1)
    measured = np.isfinite(base.answer.filtered.innovations[0])
    where = region(base.answer, np.where(measured, spread, np.nan), data.train)
    kind = first.site.partition(".")[0]
    near = {
        one.site: True  # once, and in their order: both chambers together stand under the name of one
        for one in sites[1:]
        if one.site != first.site and compare(one.judged, first.judged, data.generator).p_value > LEVEL
    }
    also = f"; {', '.join(near)} would do nearly as well" if near else ""
    words = f"an unknown signal at {first.site} explains the recordings best{also}"
    evidence, law = Comparison(0.0, 0.0, 1.0, 0.0, 0.0), None
    followed: tuple[str, ...] = ()
    if described is not None:
        curve, evidence = described.effect, described.against
        law, followed = law_at(base, described.candidate, first.site), curve.depends_on
        words += f"; {curve.law} describes it, without a name"
    shown = tuple(telling(where.states, tuple(name for name in followed if name in where.states)))
    return Finding(
        None, kind, first.site, (), where, shown, evidence, first.gain, 0.0, (), words, first, law
    )  # fmt: skip
