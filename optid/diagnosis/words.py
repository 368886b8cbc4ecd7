"""A diagnosis in plain sentences with numbers."""

from __future__ import annotations

from optid.diagnosis.contest import LEVEL
from optid.diagnosis.finding import Diagnosis, Finding, Verdict
from optid.diagnosis.judge import EXCESS, excess
from optid.effects.description import Description

_FRIENDLY = {
    "m": (1e3, "mm"), "m/s": (1e3, "mm/s"), "Pa": (1e-5, "bar"), "m**2": (1e6, "mm2"),
    "1": (1.0, ""),
}  # fmt: skip


def quantity(value: float, unit: str) -> str:
    """A number with the unit that people use for it."""
    factor, shown = _FRIENDLY.get(unit, (1.0, unit))
    if unit == "m" and abs(value) < 1e-4:
        factor, shown = 1e6, "um"
    if unit in ("m", "m/s") and abs(value) >= 0.9995:  # what three digits of mm would show as 1e+03
        factor, shown = 1.0, unit
    if unit == "s" and abs(value) < 1.0:
        factor, shown = 1e3, "ms"
    return f"{value * factor:.3g} {shown}".rstrip()


def summary(d: Diagnosis) -> str:
    """Where, what, how sure, how much better, what is not known, and what of the recordings does not count."""
    words = [_answer(d)]
    if d.search.stopped:
        words.append(
            "The search was ended before everything was tried: it may take longer with --time-limit."
        )
    if d.data.late:
        words.append(
            f"Of {', '.join(d.data.late)} the beginning does not count: at rest, in a state that nothing shows, it "
            "misleads the base model's filter."
        )
    return " ".join(words)


def _answer(d: Diagnosis) -> str:
    before, after = (_errors(d, one.judged.scores) for one in (d.base, d.best))
    span = f"{d.base.judged.horizon:g} s"
    floor = ", ".join(f"{role} {quantity(sd, _unit(d, role))}" for role, sd in d.noise.items())
    if d.verdict is Verdict.CONSISTENT:
        return (
            f"The fitted model is good to the noise: held out, its {span} windows err by {before}; the noise is "
            f"{floor}. No effect of the catalogue improves it. {_blind(d)}"
        ).strip()
    if d.verdict is Verdict.PARAMETERS:
        wide = [e for e in d.best_parameters if "." not in e.name]
        values = ", ".join(f"{e.name.replace('_', ' ')} {quantity(e.value, e.unit)}" for e in wide)
        return (
            f"No physics is missing, but the model is good to the noise only with parameters outside the rig "
            f"file's bounds: {values}. Held out, windows err by {after} instead of {before}."
        )
    if d.verdict is Verdict.UNEXPLAINED:
        told = " ".join(_sentence(d, f) for f in d.findings) or "No site could be told."
        return (
            f"The recordings hold something that neither parameters nor the catalogue explain: held out, windows "
            f"err by {before} where the noise is {floor}. {told}{_closest(d)}{_described(d, after)}"
        )
    found = " ".join(_sentence(d, f) for f in d.findings)
    return (
        f"{found} Held out, the error of {span} windows falls from {before} to {after}; the noise is {floor}."
        f"{_remains(d)}"
    )


def _described(d: Diagnosis, after: str) -> str:
    """How far goes what describes it, or else the names that fell short."""
    if d.best is d.base:
        return ""
    nameless = any(isinstance(effect, Description) for effect in d.best.effects)
    what = "what describes it, which names nothing" if nameless else "that, which falls short"
    return f" With {what}, windows err by {after}."


def _closest(d: Diagnosis) -> str:
    """Which names came closest to explaining it, and how far."""
    if d.closest is None:
        return ""
    names = " with ".join(name.replace("_", " ") for name in d.closest.effects)
    return f" Closest comes {names}: it {d.closest}."


def _errors(d: Diagnosis, scores: object) -> str:
    assert isinstance(scores, dict)
    return ", ".join(f"{role} {quantity(s.rmse, s.unit)}" for role, s in scores.items())


def _unit(d: Diagnosis, role: str) -> str:
    return next(port.unit for port in d.best.rig.model.outputs if port.role == role)


def _sentence(d: Diagnosis, f: Finding) -> str:
    name = "Not explained" if f.effect is None else f.effect.name.replace("_", " ").capitalize()
    sure = "" if f.effect is None else f" (p = {f.evidence.p_value:.2g} on the hold-out)"
    if f.effect is not None and f.evidence.p_value > LEVEL and excess(d.best.judged, d.noise) <= EXCESS:
        sure = f" (it shows in few windows of the hold-out, p = {f.evidence.p_value:.2g}, and brings them to the noise)"
    where = ""
    for signal in f.shown[:1]:
        r = f.region.states[signal]
        where = (
            f" {100 * r.share:.0f} % of the mismatch lies at {signal.replace('_', ' ')} from "
            f"{quantity(r.low, r.unit)} to {quantity(r.high, r.unit)}."
        )
    also = ""
    if f.indistinguishable:
        also = f" These recordings cannot tell it from {', '.join(f.indistinguishable)}."
        also += f" What would: {f.effect.experiment}." if f.effect is not None and f.effect.experiment else ""
    place = "" if "@" in name else f" at the {f.site}"
    return f"{name.replace('@', ' at ')}{place}: {f.sentence}{sure}.{where}{also}"


def _remains(d: Diagnosis) -> str:
    ratio = excess(d.best.judged, d.noise)
    if ratio <= EXCESS:
        return ""
    much = f"{ratio:.1f} times the noise" if ratio < 100 else "far above the noise"
    return f" What remains is {much}: the law's form may differ from the catalogue's."


def _blind(d: Diagnosis) -> str:
    if not d.not_testable:
        return ""
    names = [name.replace("_", " ") for name, _, _ in d.not_testable]
    return f"These recordings could not show: {', '.join(names)}."
