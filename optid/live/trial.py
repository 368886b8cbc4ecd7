"""Gains on trial: are the rig's own answers with new gains as good as those with the old ones were?

An episode begins when the reference moves and lasts `WINDOW`. Its cost is ITAE over the span of the reference in it.
A new episode is set against the median cost of the old ones that asked for the same move, or of all where none did.
The median of these ratios decides: after `EARLY` episodes gains go that are worse by more than `MUCH`, after `ALL`
gains go that are worse at all.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from statistics import median

WINDOW = 1.5  # s of an episode
EARLY, ALL = 3, 7  # episodes with new gains before the first verdict, and before the last one
MUCH, WORSE = 1.5, 1.0  # ratios beyond which new gains go, at the first verdicts and at the last
KEPT = 28  # old episodes that are remembered
MISSING = 0.2  # share of an episode's samples without a measurement beyond which it says nothing
SMALLEST = 0.02  # of the stroke limits' span: smaller moves drown in noise and friction


@dataclass(frozen=True)
class Verdict:
    """On new gains: median ratio of the costs of `episodes` (new over old; NaN where none compare), kept or not."""

    ratio: float
    episodes: int
    kept: bool

    @property
    def words(self) -> str:
        """For the log and the page."""
        if not self.episodes:
            return "not compared: the reference did not move while the old gains were in use"
        return f"real ITAE {self.ratio:.2f} times that of the old gains (median of {self.episodes} episodes)"


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
class _Cost:
    move: tuple[int, int]  # from where to where, in steps of the smallest move
    value: float


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
    _old: deque[_Cost] = field(default_factory=lambda: deque(maxlen=KEPT))
    _new: list[_Cost] = field(default_factory=list)
    _episode: _Episode | None = None
    _reference: float = math.nan

    def begin(self) -> Verdict | None:
        """New gains are in use from now on; a verdict at once where nothing is there to compare them with."""
        self._new, self._episode, self.running = [], None, bool(self._old)
        return None if self.running else Verdict(math.nan, 0, True)

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
        """The verdict so far."""
        ratios = self._ratios()
        return Verdict(median(ratios) if ratios else math.nan, len(ratios), True)

    def _ended(self, episode: _Episode) -> Verdict | None:
        size = episode.high - episode.low
        if size < self.smallest or episode.missing > MISSING * episode.samples:
            return None
        move = (round(episode.before / self.smallest), round(episode.last / self.smallest))
        cost = _Cost(move, episode.cost / size)
        if not self.running:
            self._old.append(cost)
            return None
        self._new.append(cost)
        return self._judge()

    def _judge(self) -> Verdict | None:
        ratios = self._ratios()
        ratio, number = median(ratios), len(ratios)
        if number >= ALL:
            worse = ratio > WORSE
        elif number >= EARLY and ratio > MUCH:
            worse = True
        else:
            return None
        if not worse:
            self._old.clear()
            self._old.extend(self._new)
        self.withdraw()
        return Verdict(ratio, number, not worse)

    def _ratios(self) -> list[float]:
        whole = median(one.value for one in self._old) if self._old else math.nan
        found = []
        for new in self._new:
            same = [old.value for old in self._old if old.move == new.move]
            found.append(new.value / max(median(same) if same else whole, 1e-300))
        return found
