"""Comparison of a rig with its commissioning: change of each quantity, its significance, and what is reported.

The last estimates are combined by their weights; where they scatter more than their sd, these are enlarged by Birge's
ratio (Phys. Rev. 40, 1932). Significance is that of the sum of their normal scores. A difference is a suspicion only:
each estimate is of first order and assumes a single effect. The first suspect is the one that explains most of the
model's error, since a model that lacks something shifts every estimate a little, and significantly.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from statistics import NormalDist, fmean
from typing import Any

from scipy.special import ndtri, stdtr

from optid.errors import InputError
from optid.monitoring.one_step import Quantity

LEVEL = 0.001  # probability of a false alarm among all quantities, each time they are judged
CAP = 4.0  # largest normal score of one estimate
DRAWS = 3  # simulated rigs that the sd of an estimate comes from
# Of the squared errors: a quantity that explains less, compared with the rig file, is not suspected.
SHARE = 0.02
TOLD = 3  # suspicions in one sentence, the most significant first
RIG_FILE = "the rig file"


@dataclass(frozen=True)
class ParameterChange:
    """One quantity, SI.

    Attributes:
        name: of a parameter, or "effect.parameter".
        unit: of the values.
        then, then_sd: at commissioning; the sd is 0 for values of the rig file.
        now, sd: in the last estimates.
        explained: share of the squared errors that it explains now.
        changed: whether it changed significantly.
    """

    name: str
    unit: str
    then: float
    then_sd: float
    now: float
    sd: float
    explained: float
    changed: bool = False

    @property
    def sds(self) -> float:
        """The difference, in its own sd."""
        return (self.now - self.then) / math.hypot(self.sd, self.then_sd)

    @property
    def words(self) -> str:
        """A phrase for a sentence."""
        unit, name = (
            "" if self.unit == "1" else f" {self.unit}",
            self.name.replace("_", " ").replace(".", ", "),
        )
        low, high = self.now - 1.96 * self.sd, self.now + 1.96 * self.sd
        return f"{name} {self.now:.3g} ({low:.3g} to {high:.3g}){unit}, then {self.then:.3g}"


@dataclass(frozen=True)
class Commissioned:
    """The commissioned state of a rig: value, sd and explained share of each quantity, and the source."""

    source: str
    values: Mapping[str, tuple[float, float, float]]

    def compare(
        self,
        looks: Sequence[Mapping[str, Quantity]],
        bounds: Mapping[str, tuple[float, float]],
    ) -> list[ParameterChange]:
        """Compare each common quantity with the last estimates, the first suspect first.

        Args:
            looks: estimates from stretches that do not overlap, oldest first.
            bounds: of possible values: an estimate beyond them is not suspected.
        """
        names = [name for name in self.values if all(name in look for look in looks)] if looks else []
        bar = NormalDist().inv_cdf(1.0 - LEVEL / 2 / max(len(names), 1))
        found = []
        for name in names:
            then, then_sd, share = self.values[name]
            several = [look[name] for look in looks]
            now, sd = joined(several)
            explained = fmean(one.explained for one in several)
            one = ParameterChange(name, looks[-1][name].unit, then, then_sd, now, sd, explained)
            low, high = bounds.get(name, (-math.inf, math.inf))
            if sd > 0.0:
                gained = explained - share >= SHARE or then_sd > 0.0
                significant = abs(score(several, then, then_sd)) > bar
                found.append(replace(one, changed=significant and gained and low <= now <= high))
        return sorted(found, key=lambda one: (not one.changed, self.values[one.name][2] - one.explained))


def score(estimates: Sequence[Quantity], then: float, then_sd: float) -> float:
    """Normal score of the difference from an earlier value, over all estimates.

    The sd of an estimate comes from `DRAWS` simulated rigs, so its distance has the tails of Student's distribution
    with as many degrees of freedom but one. It is converted to the normal score of the same probability, at most `CAP`,
    so no single estimate decides; the scores of estimates that share the earlier value are correlated.
    """
    total = shared = 0.0
    for one in estimates:
        variance = one.sd**2 + then_sd**2
        distance = (one.value - then) / math.sqrt(variance)
        total += max(-CAP, min(CAP, float(ndtri(stdtr(DRAWS - 1, distance)))))
        shared += then_sd**2 / variance / len(estimates)
    return total / math.sqrt(len(estimates) * (1.0 + (len(estimates) - 1) * shared))


def joined(estimates: Sequence[Quantity]) -> tuple[float, float]:
    """Weighted mean and its sd; NaN where an estimate has none."""
    weights = [1.0 / one.sd**2 if one.sd > 0.0 else math.nan for one in estimates]
    total = sum(weights)
    mean = sum(w * one.value for w, one in zip(weights, estimates, strict=True)) / total
    spread = sum(w * (one.value - mean) ** 2 for w, one in zip(weights, estimates, strict=True))
    birge = spread / (len(estimates) - 1) if len(estimates) > 1 else 1.0
    return mean, math.sqrt(max(birge, 1.0) / total)


def read_since(path: Path) -> Commissioned:
    """The estimates of an earlier session, such as the commissioning, of the same rig.

    Args:
        path: its live.json.

    Raises:
        InputError: it cannot be read, or that session was too short for estimates.
    """
    try:
        rows = json.loads(path.read_text(encoding="utf-8"))["followed"]["rows"]
        values = {
            str(row["name"]): (float(row["now"]), float(row["sd"]), float(row["explained"])) for row in rows
        }
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{type(error).__name__}: {error}",
            where=str(path),
            field="followed",
            expected="the live.json of a session that tracked the parameters, of a minute or more and with motion",
        ) from None
    return Commissioned(str(path), values)


def sentence(standings: Sequence[ParameterChange], source: str, seconds: float, command: str) -> str:
    """The suspicion, and the command that tests it."""
    changed = [one for one in standings if one.changed]
    if not changed:
        return f"The last {seconds:.0f} s show no significant difference from {source}."
    more = f", and {len(changed) - TOLD} more that are correlated with these" if len(changed) > TOLD else ""
    told = "; or ".join(one.words for one in changed[:TOLD])
    return (
        f"Suspected, from the last {seconds:.0f} s beside {source}: {told}{more}. "
        f"Each is estimated as if it were the only change; next: {command}"
    )


def document(standings: Sequence[ParameterChange], source: str, words: str, command: str) -> dict[str, Any]:
    """The content for live.json and the page."""
    half = 1.96
    rows = [
        {**asdict(one), "low": one.now - half * one.sd, "high": one.now + half * one.sd} for one in standings
    ]
    return {"since": source, "rows": rows, "words": words, "command": command}
