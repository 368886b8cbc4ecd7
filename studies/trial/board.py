"""The board: the figures of the issue with their Clopper-Pearson intervals, by condition, and the confusions."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.stats import beta

from studies.trial.judging import Judged

Test = Callable[[Judged], bool]
RIGHT_LEAVE = "right names leave of the squared error"
SENSORS = ("position only", "with pressures")
AFTER = "hold-out RMSE after, over the oracle's"
MOST = {"median": 1.1, "p90": 1.5}  # that this should come to


@dataclass(frozen=True)
class Rate:
    """Hits among trials, the 95 % interval of Clopper and Pearson, and what the rate should reach."""

    figure: str
    hits: int
    trials: int
    target: float | None = None

    @property
    def share(self) -> float:
        """Hits over trials."""
        return self.hits / self.trials if self.trials else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """95 %."""
        k, n = self.hits, self.trials
        low = float(beta.ppf(0.025, k, n - k + 1)) if k > 0 else 0.0
        high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
        return low, high


def rate(figure: str, cases: Iterable[Judged], test: Test, target: float | None = None) -> Rate:
    """How many pass the test."""
    results = [test(case) for case in cases]
    return Rate(figure, sum(results), len(results), target)


def rates(cases: Sequence[Judged]) -> list[Rate]:
    """The figures that are rates, with the targets of the trial."""
    return [*_naming(cases), *_restraint(cases), *_coverage(cases)]


def _naming(cases: Sequence[Judged]) -> list[Rate]:
    single = [c for c in cases if c.kind == "single" and c.true]
    pair = [c for c in cases if c.kind == "pair" and len(c.true) == 2]
    out = []
    for sensors, target in zip(SENSORS, (0.90, 0.95), strict=True):
        some = [c for c in single if c.conditions["sensors"] == sensors]
        out.append(rate(f"single effect, first name right, {sensors}", some, lambda c: c.in_set, target))
    out.append(rate("... inseparable look-alikes not counted", single, lambda c: c.first_right))
    out.append(rate("... named and nothing else", single, lambda c: c.exact))
    for sensors, target in zip(SENSORS, (0.75, 0.85), strict=True):
        some = [c for c in pair if c.conditions["sensors"] == sensors]
        out.append(rate(f"pair, both named and nothing else, {sensors}", some, lambda c: c.whole, target))
    out.append(rate("... of pairs, inseparable look-alikes not counted", pair, lambda c: c.exact))
    out.append(rate("... one of them first", pair, lambda c: c.in_set))
    out.append(rate("right site", single + pair, lambda c: c.site_right, 0.95))
    return out


def _restraint(cases: Sequence[Judged]) -> list[Rate]:
    nothing = [c for c in cases if c.kind == "nothing"]
    outside = [c for c in cases if c.kind == "outside" and c.true]
    return [
        rate("nothing missing, nothing named", nothing, lambda c: not c.named and _answered(c), 0.98),
        rate("... and nothing unexplained", nothing, lambda c: c.called == "nothing"),
        rate(
            "outside the list: unexplained, right site",
            outside,
            lambda c: abstained(c) and c.site_right,
            0.85,
        ),
        rate("... given a name", outside, lambda c: bool(c.named)),
        rate("answered in time", cases, _answered),
    ]


def _coverage(cases: Sequence[Judged]) -> list[Rate]:
    own = [e for c in cases for e in c.estimates if e.held is not None]
    # Beside physics that no effect stands for, parameters take it in.
    known = [c for c in cases if c.exact and c.kind != "outside"]
    base = [e for c in known for e in c.base if e.held is not None]
    return [
        Rate(
            "the effects' parameters within their intervals", sum(e.held is True for e in own), len(own), 0.90
        ),
        Rate("... the base parameters, effects named exactly", sum(e.held is True for e in base), len(base)),
    ]


def _answered(case: Judged) -> bool:
    return case.outcome not in ("failed", "late")


def abstained(case: Judged) -> bool:
    """It says that something is unexplained, and names nothing."""
    return case.outcome == "unexplained" and not case.named


def spreads(cases: Sequence[Judged]) -> dict[str, dict[str, float | int]]:
    """The figures that are distributions: median, 90th percentile, and of how many cases."""
    after = [c.after / c.oracle for c in cases if c.after and c.oracle]
    before = [c.before / c.oracle for c in cases if c.before and c.oracle and c.true]
    gain = [c.after / c.before for c in cases if c.after and c.before and c.true]
    found = {
        AFTER: after,
        "... of cases named exactly": [c.after / c.oracle for c in cases if c.after and c.oracle and c.exact],
        "hold-out RMSE before, over the oracle's, something missing": before,
        "hold-out RMSE after, over before, something missing": gain,
        "relative error of the named effects' parameters": [e.error for c in cases for e in c.estimates],
        # Refused ones count: the figure is what right laws leave, not what the rule that it sets lets through.
        RIGHT_LEAVE: [
            c.left for c in cases if (c.exact or c.refused is not None) and _asked(c) and c.left is not None
        ],
        "overlap of times": [c.times for c in cases if c.times is not None],
        "... of flagging everything": [c.chance for c in cases if c.chance is not None],
        "overlap of regions": [c.region for c in cases if c.region is not None],
        "seconds": [c.seconds for c in cases if c.seconds is not None],
    }
    table: dict[str, dict[str, float | int]] = {
        name: {"median": float(np.median(v)), "p90": float(np.quantile(v, 0.9)), "count": len(v)}
        for name, v in found.items()
        if v
    }
    if len(found[RIGHT_LEAVE]) >= 19:
        table[RIGHT_LEAVE]["in 19 of 20"] = conformal(found[RIGHT_LEAVE])
    return table


def conformal(values: Sequence[float]) -> float:
    """What a further value of the same kind stays below with a probability of 0.95; it takes 19 values at least."""
    return sorted(values)[math.ceil(0.95 * (len(values) + 1)) - 1]


def _asked(case: Judged) -> bool:
    """Of a kind in which something of the list is concealed, and leaves a trace."""
    return case.kind in ("single", "pair") and bool(case.true)


def by_condition(cases: Sequence[Judged]) -> dict[str, list[Rate]]:
    """First name right of what is concealed, by everything that may matter."""
    asked = [c for c in cases if _asked(c)]
    table: dict[str, list[Rate]] = {}
    for condition in ("sensors", "noise", "style"):
        values = sorted({c.conditions[condition] for c in asked})
        table[condition] = [
            rate(v, [c for c in asked if c.conditions[condition] == v], lambda c: c.in_set) for v in values
        ]
    ways = sorted({way for c in asked for way in c.conditions["hidden_by"]})
    table["hidden by"] = [
        rate(way, [c for c in asked if way in c.conditions["hidden_by"]], lambda c: c.in_set) for way in ways
    ]
    single = [c for c in asked if c.kind == "single"]
    table["size"] = [
        rate(s, [c for c in single if s in c.sizes], lambda c: c.in_set) for s in ("small", "medium", "large")
    ]
    names = sorted({c.true[0] for c in single})
    table["effect"] = [rate(n, [c for c in single if c.true[0] == n], lambda c: c.in_set) for n in names]
    return table


def confusion(cases: Sequence[Judged]) -> dict[str, dict[str, int]]:
    """What is there, and what is said first, of all cases but pairs."""
    rows: dict[str, Counter[str]] = {}
    for case in cases:
        if case.kind != "pair":
            row = (
                "nothing"
                if not case.true
                else case.true[0] + (" (outside)" if case.kind == "outside" else "")
            )
            rows.setdefault(row, Counter())[case.called] += 1
    return {row: dict(rows[row].most_common()) for row in sorted(rows)}


def board(cases: Sequence[Judged]) -> dict[str, Any]:
    """Everything as a JSON object."""

    def shown(r: Rate) -> dict[str, Any]:
        return {
            **asdict(r),
            "share": r.share if r.trials else None,
            "interval": r.interval if r.trials else None,
        }

    return {
        "cases": len(cases),
        "rates": [shown(r) for r in rates(cases)],
        "spreads": spreads(cases),
        "by": {name: [shown(r) for r in group] for name, group in by_condition(cases).items()},
        "confusion": confusion(cases),
        "every": [{**asdict(c), "called": c.called} for c in cases],
    }


def text(result: dict[str, Any]) -> str:
    """The board for a terminal."""
    lines = [f"{result['cases']} cases", ""]
    lines += [*map(_line, result["rates"]), ""]
    for name, spread in result["spreads"].items():
        also = f"  in 19 of 20 at most {spread['in 19 of 20']:.3g}" if "in 19 of 20" in spread else ""
        lines.append(
            f"{name:64}median {spread['median']:8.3g}  p90 {spread['p90']:8.3g}  of {spread['count']}{also}"
        )
    for condition, group in result["by"].items():
        lines += ["", f"first name right, by {condition}"]
        lines += [_line(r) for r in group]
    lines += ["", "what is there -> what is said first"]
    for row, said in result["confusion"].items():
        lines.append(f"  {row:36}" + ", ".join(f"{name} {n}" for name, n in said.items()))
    return "\n".join(lines)


def beside(boards: Mapping[str, dict[str, Any]]) -> str:
    """The figures of the trial that have a target, of several boards by name, as a table in Markdown."""
    first = next(iter(boards.values()))
    rows = [["figure", "asked", *boards], ["---"] * (2 + len(boards)), ["cases", "150"]]
    rows[-1] += [str(one["cases"]) for one in boards.values()]
    for k, r in enumerate(first["rates"]):
        if r["target"]:
            got = [one["rates"][k] for one in boards.values()]
            shown = [f"{g['hits']} of {g['trials']}" for g in got]
            rows.append([r["figure"], f"{100 * r['target']:.0f} %", *shown])
    for share, most in MOST.items():
        got = [one["spreads"][AFTER][share] for one in boards.values()]
        rows.append([f"{AFTER}, {share}", f"at most {most:g}", *(f"{g:.2f}" for g in got)])
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def _line(r: dict[str, Any]) -> str:
    if not r["trials"]:
        return f"{r['figure']:64}no case"
    low, high = r["interval"]
    target = f"  (at least {100 * r['target']:.0f} %)" if r["target"] else ""
    counts = f"{r['hits']}/{r['trials']}, {100 * low:.0f} to {100 * high:.0f} %"
    return f"{r['figure']:64}{100 * r['share']:5.1f} %  {counts}{target}"
