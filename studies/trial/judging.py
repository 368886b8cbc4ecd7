"""One case judged: what the answer says against what a diagnosis says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from studies.trial.overlap import interval_overlap, time_overlap

Pairs = frozenset[frozenset[str]]
# The rig has leaks by their geometric area, a diagnosis by the effective one: times the discharge coefficient.
LEAKS = ("cross_leakage", "ambient_leakage")
NOISE = 1.2  # times the oracle's error: what a diagnosis takes for the noise
BASE = {
    "viscous": "viscous_friction",
    "coulomb": "coulomb_friction",
    "discharge": "discharge_coefficient",
    "residual_length": "residual_length",
}


@dataclass(frozen=True)
class Estimate:
    """A parameter: what it is called, the truth, the value found, and whether its 95 % interval holds the truth."""

    name: str
    truth: float
    found: float
    held: bool | None

    @property
    def error(self) -> float:
        """Relative."""
        return abs(self.found - self.truth) / abs(self.truth)


@dataclass(frozen=True)
class Judged:
    """One case.

    Attributes:
        name: of the case.
        kind: nothing, single, pair, outside.
        true: names that are concealed and leave a trace; an effect too faint to see is asked of nobody.
        sizes: of these.
        conditions: sensors, noise, hidden_by.
        outcome: the verdict, or "failed" or "late" if there is no diagnosis.
        named: effects that the diagnosis names, strongest first.
        first_right: the first name is one that is there.
        in_set: ... or is proven inseparable from one that is there, and reported with it.
        exact: all names are there, and no other is given.
        whole: the same, where a name proven inseparable from the true one, and reported with it, counts for it.
        site_right: every concealed effect's site is given; without names, that of the unexplained part.
        times, chance: overlap of the flagged times with the true ones, and that of flagging everything.
        region: overlap of the flagged range of states, where the effect has one; None if it has none.
        estimates: of the named effects' parameters that mean the same in any form.
        base: of the base parameters.
        before, after, oracle: RMSE on the held-out recording, m.
        seconds: that the diagnosis took.
        refused: share of the squared error that the right names leave where they were refused for it.
    """

    name: str
    kind: str
    true: tuple[str, ...]
    sizes: tuple[str, ...]
    conditions: Mapping[str, Any]
    outcome: str
    named: tuple[str, ...] = ()
    first_right: bool = False
    in_set: bool = False
    exact: bool = False
    whole: bool = False
    site_right: bool = False
    times: float | None = None
    chance: float | None = None
    region: float | None = None
    estimates: tuple[Estimate, ...] = ()
    base: tuple[Estimate, ...] = ()
    before: float | None = None
    after: float | None = None
    oracle: float | None = None
    seconds: float | None = None
    refused: float | None = None

    @property
    def left(self) -> float | None:
        """Share of the squared error on the hold-out, beyond the oracle's, that the names leave; 0 at the noise."""
        if self.refused is not None:
            return self.refused
        if self.before is None or self.after is None or self.oracle is None:
            return None
        if self.after <= NOISE * self.oracle:
            return 0.0
        return (self.after**2 - self.oracle**2) / (max(self.before, self.after) ** 2 - self.oracle**2)

    @property
    def called(self) -> str:
        """What a confusion matrix has in its column."""
        if self.outcome in ("failed", "late"):
            return self.outcome
        return (
            self.named[0] if self.named else ("unexplained" if self.outcome == "unexplained" else "nothing")
        )


def judged_from(stated: Mapping[str, Any]) -> Judged:
    """The case that a board states."""
    fields = {k: v for k, v in stated.items() if k != "called"}
    for several in ("true", "sizes", "named"):
        fields[several] = tuple(fields[several])
    for several in ("estimates", "base"):
        fields[several] = tuple(Estimate(**one) for one in fields[several])
    return Judged(**fields)


@dataclass(frozen=True)
class CaseOutcome:
    """What a method left of a case: the diagnosis (None if there is none), how it ended, and the oracle's RMSE."""

    diagnosis: Mapping[str, Any] | None
    status: int | None
    seconds: float | None
    oracle: float | None = None
    inseparable: Pairs = field(default_factory=frozenset)


def judge(answer: Mapping[str, Any], ran: CaseOutcome) -> Judged:
    """Judge one case.

    Args:
        answer: as drawing.answer wrote it.
        ran: what the method left.
    """
    case = answer["case"]
    seen = [
        (h, part)
        for h, part in zip(case["hidden"], answer["parts"], strict=True)
        if part["hidden_by"] != ["unseen"]
    ]
    true = tuple(h["name"] for h, _ in seen)
    outside = answer["kind"] == "outside"
    ways = sorted({way for _, part in seen for way in part["hidden_by"]})
    conditions = {
        "sensors": "with pressures" if case["with_pressures"] else "position only",
        "noise": case["noise"],
        "style": case["style"],
        "hidden_by": ways,
    }
    sizes = tuple(h["size"] for h, _ in seen)
    common = (case["name"], answer["kind"], true, sizes, conditions)
    if ran.diagnosis is None:
        return Judged(
            *common, "late" if ran.status is None else "failed", oracle=ran.oracle, seconds=ran.seconds
        )
    d = ran.diagnosis
    named = tuple(f["effect"] for f in d["findings"] if f["effect"] is not None)
    found_sites = {f["site"] for f in d["findings"]}
    at_site = [bool(found_sites & {h["site"], *h["also"]}) for h, _ in seen]
    wanted = () if outside else true
    first = bool(named) and named[0] in wanted
    times, chance = _times(d["findings"], seen)
    return Judged(
        *common,
        str(d["verdict"]),
        named=named,
        first_right=first,
        in_set=any(name in wanted for name in _counted(d["findings"], wanted, ran.inseparable)[:1]),
        exact=set(named) == set(wanted) and len(named) == len(wanted),
        whole=sorted(_counted(d["findings"], wanted, ran.inseparable)) == sorted(wanted),
        site_right=all(at_site) if at_site else not found_sites,
        times=times,
        chance=chance,
        region=_region(d["findings"], seen),
        estimates=_estimates(d["findings"], seen, case["base"]),
        base=_base(d, case["base"]),
        before=_rmse(d.get("baseline")),
        after=_rmse(d.get("improved")) or _rmse(d.get("baseline")),
        oracle=ran.oracle,
        seconds=ran.seconds,
        refused=_refused(d.get("closest"), wanted),
    )


def _refused(closest: Mapping[str, Any] | None, wanted: tuple[str, ...]) -> float | None:
    if closest is None or set(closest["effects"]) != set(wanted):
        return None
    return 1.0 - float(closest["cleared"])


def _counted(findings: list[dict[str, Any]], true: tuple[str, ...], inseparable: Pairs) -> list[str]:
    """The names given; one that nothing can tell from a true one, which is reported with it, counts as that."""
    counted = []
    for finding in findings:
        name = finding["effect"]
        if name is None:
            continue
        others = set(finding.get("indistinguishable_from", ())) & set(true)
        same = [other for other in sorted(others) if frozenset((name, other)) in inseparable]
        counted.append(same[0] if same and name not in true else name)
    return counted


def _matching(findings: list[dict[str, Any]], name: str) -> dict[str, Any] | None:
    return next((f for f in findings if f["effect"] == name), None)


def _times(
    findings: list[dict[str, Any]], seen: list[tuple[dict[str, Any], dict[str, Any]]]
) -> tuple[float | None, float | None]:
    """Mean overlap over the effects named rightly, or over unexplained findings for physics outside the list."""
    got, chances = [], []
    for hidden, part in seen:
        finding = _matching(findings, hidden["name"]) or _matching(findings, None)  # type: ignore[arg-type]
        if finding is None:
            continue
        overlap = time_overlap(finding.get("where", {}).get("intervals", ()), part["intervals"])
        if overlap is not None:
            got.append(overlap[0])
            chances.append(overlap[1])
    return (sum(got) / len(got), sum(chances) / len(chances)) if got else (None, None)


def _region(
    findings: list[dict[str, Any]], seen: list[tuple[dict[str, Any], dict[str, Any]]]
) -> float | None:
    overlaps = []
    for hidden, _ in seen:
        finding, region = _matching(findings, hidden["name"]), hidden["region"]
        if finding is None or region is None:
            continue
        states = finding.get("where", {}).get("states", {})
        given = states.get(region["variable"])
        overlaps.append(
            0.0
            if given is None
            else interval_overlap((given["low"], given["high"]), (region["low"], region["high"]))
        )
    return sum(overlaps) / len(overlaps) if overlaps else None


def _estimates(
    findings: list[dict[str, Any]],
    seen: list[tuple[dict[str, Any], dict[str, Any]]],
    base: Mapping[str, float],
) -> tuple[Estimate, ...]:
    out = []
    for hidden, _ in seen:
        finding = _matching(findings, hidden["name"])
        for name, truth in hidden["quantities"].items():
            if finding is not None and name in finding["parameters"]:
                if hidden["name"] in LEAKS:
                    truth *= base["discharge"]
                out.append(_estimate(f"{hidden['name']}.{name}", truth, finding["parameters"][name]))
    return tuple(out)


def _base(diagnosis: Mapping[str, Any], truth: Mapping[str, float]) -> tuple[Estimate, ...]:
    improved = diagnosis.get("improved") or {}
    found = improved.get("parameters") or diagnosis["baseline"]["parameters"]
    return tuple(_estimate(name, truth[own], found[name]) for own, name in BASE.items() if name in found)


def _estimate(name: str, truth: float, found: Mapping[str, Any]) -> Estimate:
    interval = found.get("ci95")
    held = None if interval is None or None in interval else interval[0] <= truth <= interval[1]
    return Estimate(name, truth, float(found["value"]), held)


def _rmse(part: Mapping[str, Any] | None) -> float | None:
    position = ((part or {}).get("holdout") or {}).get("position")
    return None if position is None else float(position["rmse"])
