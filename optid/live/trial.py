"""Trial of new gains: is the response of the rig with them as good as with the old ones?

An episode begins when the reference moves and lasts `WINDOW`. Its cost is ITAE divided by the span of the reference.
Logarithms of the costs are compared for equal moves, each move with the same weight, once old and new gains have
made the same moves; until then all new ones with all old ones. The scatter of the costs is estimated from repeated
moves, for old and new gains separately (Welch, Biometrika 34, 1947), and Student's quantiles bound the ratio.

The comparison is made after each number of episodes in `LOOKS`. New gains are kept as soon as they are shown to be
worse by less than `TOLERATED`, unless they have made only some of the old moves. They are taken back as soon as they
are shown to be worse, and after the last comparison if neither is shown. Each comparison has its share of `LEVEL`
(Bonferroni). So `LEVEL` bounds the probability of keeping gains that are worse by `TOLERATED` or more, and that of
taking gains back as worse that are not.
"""

from __future__ import annotations

import math
from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import fmean

from scipy.special import stdtrit

WINDOW = 1.5  # s of an episode
LOOKS = (4, 8, 16, 32, 64)  # episodes with new gains
LEVEL = 0.05  # probability of a wrong verdict in a trial, of either kind
TOLERATED = 1.02  # ratio of the costs up to which gains count as no worse
KEPT = 28  # old episodes that are remembered
MISSING = 0.2  # share of an episode's samples without a measurement beyond which it is not used
SMALL, LARGE = 1e-300, 700.0  # a cost, and the logarithm of a ratio, that still are numbers
SMALLEST = 0.02  # of the stroke limits' span: smaller moves drown in noise and friction


@dataclass(frozen=True)
class Verdict:
    """On new gains.

    Attributes:
        ratio: mean ratio of the costs, new over old; NaN where none compare.
        low, high: between which it lies, surely enough for a verdict; 0 and infinite where that is not known.
        episodes: with the new gains.
        kept: or not.
    """

    ratio: float
    low: float
    high: float
    episodes: int
    kept: bool

    @property
    def words(self) -> str:
        """For the log and the page."""
        if not self.episodes:
            return "not compared: the reference has not moved with both"
        known = (
            f"{self.low:.2f} to {self.high:.2f}" if math.isfinite(self.high) else "how surely is not known"
        )
        return f"real ITAE {self.ratio:.2f} times that of the old gains ({known}; {self.episodes} episodes)"

    @property
    def word(self) -> str:
        """Of a verdict: "kept", "worse", or "undecided" where neither is sure."""
        return "kept" if self.kept else "worse" if self.low > 1.0 else "undecided"


@dataclass
class _Episode:
    begin: float
    before: float
    low: float
    high: float
    last: float
    cost: float = 0.0
    samples: int = 0
    missing: int = 0

    def add(self, time: float, reference: float, measured: float, span: float) -> None:
        self.low, self.high, self.last = min(self.low, reference), max(self.high, reference), reference
        self.samples += 1
        error = abs(reference - measured)
        if error - error == 0.0:
            self.cost += (time - self.begin) * error * span
        else:
            self.missing += 1


@dataclass(frozen=True)
class Cost:
    """Of one episode: from where to where, in steps of the smallest move, and the logarithm of its value."""

    move: tuple[int, int]
    log: float


@dataclass
class Trial:
    """Costs of the episodes with the gains in use and, while new ones are on trial, with the old ones.

    Attributes:
        span: sampling time, s.
        smallest: move of the reference that counts, m.
        running: new gains are on trial.
    """

    span: float
    smallest: float
    running: bool = False
    _old: deque[Cost] = field(default_factory=lambda: deque(maxlen=KEPT))
    _new: list[Cost] = field(default_factory=list)
    _episode: _Episode | None = None
    _reference: float = math.nan

    def begin(self) -> Verdict | None:
        """New gains are in use from now on; a verdict at once where nothing is there to compare them with."""
        self._new, self._episode, self.running = [], None, bool(self._old)
        return None if self.running else Verdict(math.nan, 0.0, math.inf, 0, True)

    def withdraw(self) -> None:
        """The old gains are in use again."""
        self._new, self._episode, self.running = [], None, False

    def add(self, time: float, reference: float, measured: float) -> Verdict | None:
        """Take one sample (s, m, m; NaN is missing); the verdict when it falls."""
        before, self._reference = self._reference, reference
        episode = self._episode
        if episode is None:
            if not (before == before and reference != before):
                return None
            episode = self._episode = _Episode(time, before, before, before, before)
        episode.add(time, reference, measured, self.span)
        if time - episode.begin < WINDOW:
            return None
        self._episode = None
        return self._ended(episode)

    @property
    def standing(self) -> Verdict:
        """What is known before a verdict: the old gains stand until the new ones are shown to be as good."""
        return compare(self._old, self._new)

    def _ended(self, episode: _Episode) -> Verdict | None:
        size = episode.high - episode.low
        if size < self.smallest or episode.missing > MISSING * episode.samples:
            return None
        move = (round(episode.before / self.smallest), round(episode.last / self.smallest))
        cost = Cost(move, math.log(max(episode.cost / size, SMALL)))
        if not self.running:
            self._old.append(cost)
            return None
        self._new.append(cost)
        return self._judge() if len(self._new) in LOOKS else None

    def _judge(self) -> Verdict | None:
        verdict = compare(self._old, self._new)
        if verdict.word == "undecided" and len(self._new) < LOOKS[-1]:
            return None
        if verdict.kept:
            self._old.clear()
            self._old.extend(self._new)
        self.withdraw()
        return verdict


def compare(old: Sequence[Cost], new: Sequence[Cost]) -> Verdict:
    """Compare new episodes with old ones, at one comparison's share of the level.

    Args:
        old, new: costs of the episodes; old ones not empty.
    """
    if not new:
        return Verdict(math.nan, 0.0, math.inf, 0, False)
    old_moves, new_moves = ({one.move for one in costs} for costs in (old, new))
    same, whole = old_moves == new_moves, not new_moves < old_moves
    before, after = _by_move(old, same), _by_move(new, same)
    mean = fmean(fmean(logs) - fmean(before[move]) for move, logs in after.items())
    scatter = [_scatter(groups) for groups in (after, before)]
    weights = tuple(
        sum(1.0 / len(logs) for logs in groups.values()) / len(groups) ** 2 for groups in (after, before)
    )
    half = _half(scatter, weights)
    low, high = math.exp(mean - half), math.exp(min(mean + half, LARGE))
    return Verdict(math.exp(mean), low, high, len(new), whole and high < TOLERATED)


def _by_move(costs: Sequence[Cost], same: bool) -> dict[tuple[int, int] | None, list[float]]:
    groups = defaultdict(list)
    for one in costs:
        groups[one.move if same else None].append(one.log)
    return groups


def _scatter(groups: dict[tuple[int, int] | None, list[float]]) -> tuple[float, int]:
    """Sum of squares about the groups' means, and its degrees of freedom."""
    squares = sum((log - fmean(logs)) ** 2 for logs in groups.values() for log in logs)
    return squares, sum(len(logs) - 1 for logs in groups.values())


def _half(scatter: Sequence[tuple[float, int]], weights: tuple[float, ...]) -> float:
    """Half of the interval of a weighted difference; infinite where no two episodes asked for the same.

    Where only old or only new gains have been asked twice for the same, the others are taken to scatter alike.
    """
    if not all(freedom for _, freedom in scatter):
        scatter = [(sum(squares for squares, _ in scatter), sum(freedom for _, freedom in scatter))]
        weights = (sum(weights),)
    if not scatter[0][1]:
        return math.inf
    variance = sum(w * squares / freedom for w, (squares, freedom) in zip(weights, scatter, strict=True))
    least = min(freedom for _, freedom in scatter)  # Welch's own number says too much where one is 1
    return -float(stdtrit(least, LEVEL / len(LOOKS))) * math.sqrt(variance)
