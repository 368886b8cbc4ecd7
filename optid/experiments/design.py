"""The design: pieces of a reference are chosen until the time is full; then the whole is evaluated."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from optid.core.model import Array
from optid.effects.effect import Effect
from optid.errors import InputError, SolveError
from optid.experiments.loop import Loop, Run
from optid.experiments.pieces import LENGTH, Piece, Range, candidates, plain_steps
from optid.experiments.separation import NEEDED, Pair, pairs, separations
from optid.experiments.signatures import Layout, grams

LEAD = 1.0  # s of the approach from the rig's start to the middle, where it does not start there
NEAR = 0.01  # of the reach: a start this near to the middle needs no approach
SAMPLES = 50  # samples that a piece must have
MOST = 1_000_000  # samples of an experiment
TRIES = 5  # designs that leave the stroke limits as a whole before the job is given up
TWICE = 2  # largest number of repeats of a piece while others are left: the model that chooses is only nearly right
LEAST = 1e-6  # sd that counts as zero in sums of logarithms

Report = Callable[[float, str], None]


@dataclass(frozen=True)
class Separation:
    """Separation, in sd, between a rival present at its smallest size worth a name and another one.

    Attributes:
        there: name of the effect that is present.
        instead: name of the one that it could be mistaken for; None for no effect.
        planned: of the planned experiment.
        plain: of steps of the same length.
        seconds: of an experiment like the planned one that a test needs for one error in a hundred; infinite
            where nothing separates the two.
    """

    there: str
    instead: str | None
    planned: float
    plain: float
    seconds: float

    @property
    def enough(self) -> bool:
        """Whether the planned experiment distinguishes them."""
        return self.planned >= NEEDED


@dataclass(frozen=True, eq=False)
class Design:
    """An experiment and its separations.

    Attributes:
        rivals: in the requested order.
        run: predicted, on the rig's own model.
        starts: s at which each piece begins; names: what each is.
        separations: the least first.
    """

    rivals: tuple[Effect, ...]
    run: Run
    starts: tuple[float, ...]
    names: tuple[str, ...]
    separations: tuple[Separation, ...]


def design(
    loop: Loop,
    rivals: Sequence[Effect],
    seconds: float,
    generator: np.random.Generator,
    progress: Report | None = None,
) -> Design:
    """The reference that separates rivals best.

    Args:
        loop: rig and controller.
        rivals: one to detect, or several to distinguish.
        seconds: of the experiment.
        generator: of random pieces and the sensors' noise.
        progress: called with the share done and a few words.

    Raises:
        InputError: too few or too many samples.
        SolveError: no piece stays within the stroke limits.
    """
    report = progress or (lambda share, words: None)
    frame = _Frame.of(loop, seconds)
    report(0.0, "candidate pieces in closed loop")
    tried = candidates(frame.room, frame.samples, loop.settings.span, generator)
    runs = loop.runs([np.r_[frame.lead, piece.reference] for piece in tried])
    fine = [k for k, run in enumerate(runs) if loop.beyond(run) is None]
    if not fine:
        raise SolveError("every piece of a reference leaves the stroke limits; try lower gains")
    possible = [tried[k] for k in fine]
    report(0.1, f"sensitivities to {len(rivals)} effects along {len(fine)} pieces")
    skip, wanted = frame.lead.size, pairs(len(rivals))
    recordings = [loop.recording(runs[k], generator, f"piece {k}") for k in fine]
    by_piece = grams(loop.rig, rivals, recordings, skip)
    report(0.8, "choosing")
    run, chosen = _within_limits(loop, frame, possible, by_piece.values, by_piece.layout, wanted)
    report(0.85, "comparing the experiment with plain steps")
    [steps] = loop.runs([np.r_[frame.lead, plain_steps(frame.room, frame.total - skip, loop.settings.span)]])
    both = grams(
        loop.rig,
        rivals,
        [loop.recording(r, generator, n) for r, n in ((run, "plan"), (steps, "plain"))],
        skip,
    )
    planned, plain = (separations(gram, both.layout, wanted) for gram in both.values)
    span = loop.settings.span
    starts = [span * (skip + k * frame.samples) for k in range(len(chosen))]
    names = [possible[k].name for k in chosen]
    if plain.min() > planned.min() and loop.beyond(steps) is None:  # never worse than without a plan
        run, planned, starts, names = steps, plain, [span * skip], ["plain steps"]
    table = _table(rivals, wanted, planned, plain, frame.total * span)
    return Design(tuple(rivals), run, tuple(starts), tuple(names), table)


def choose(
    values: Array, layout: Layout, wanted: Sequence[Pair], count: int, left_out: Sequence[int] = ()
) -> list[int]:
    """Choose pieces: each time the one that increases the smallest separation most.

    Args:
        values: inner products along each piece, (pieces, columns, columns).
        layout: of the columns.
        wanted: pairs of rivals.
        count: of pieces to choose.
        left_out: pieces that may not be chosen.
    """
    possible = [k for k in range(len(values)) if k not in left_out]
    chosen: list[int] = []
    total = np.zeros_like(values[0])
    while possible and len(chosen) < count:
        often = TWICE * (1 + len(chosen) // (TWICE * len(possible)))
        fresh = [k for k in possible if chosen.count(k) < often]
        best = max(fresh, key=lambda k: worth(total + values[k], layout, wanted))
        chosen.append(best)
        total = total + values[best]
    return chosen


def worth(gram: Array, layout: Layout, wanted: Sequence[Pair]) -> tuple[float, float]:
    """The smallest separation, and the sum of the logarithms of all, which decides between equal ones."""
    found = separations(gram, layout, wanted)
    return float(found.min()), float(np.log(found + LEAST).sum())


@dataclass(frozen=True, eq=False)
class _Frame:
    """Division of the time: the approach to the middle, `count` pieces of `samples`, rest to `total` samples."""

    room: Range
    lead: Array
    count: int
    samples: int
    total: int

    @staticmethod
    def of(loop: Loop, seconds: float) -> _Frame:
        rate, room = loop.settings.rate, Range.of(*loop.settings.limits.stroke)
        total = round(seconds * rate)
        if total > MOST:
            raise InputError(
                f"{total} samples", where="--seconds", expected=f"at most {MOST / rate:g} s at {rate:g} Hz"
            )
        away = loop.start - room.middle
        turn = np.linspace(0.0, np.pi, max(2, round(LEAD * rate)))
        lead = room.middle + away * (1 + np.cos(turn)) / 2 if abs(away) > NEAR * room.reach else np.empty(0)
        count = max(1, round((total - lead.size) / (LENGTH * rate)))
        samples = (total - lead.size) // count
        if samples < SAMPLES:
            raise InputError(
                f"{samples} samples a piece",
                where="--seconds",
                expected=f"at least {(SAMPLES + lead.size) / rate:.3g} s at {rate:g} Hz",
            )
        return _Frame(room, lead, count, samples, total)

    def reference(self, pieces: Sequence[Piece]) -> Array:
        """The pieces one after the other."""
        joined = np.concatenate([self.lead, *(piece.reference for piece in pieces)])
        return np.concatenate([joined, np.full(self.total - joined.size, self.room.middle)])


def _within_limits(
    loop: Loop,
    frame: _Frame,
    possible: Sequence[Piece],
    values: Array,
    layout: Layout,
    wanted: Sequence[Pair],
) -> tuple[Run, list[int]]:
    """Pieces that also stay within the stroke limits as a whole: one that leaves them is removed."""
    left_out: list[int] = []
    for _ in range(TRIES):
        chosen = choose(values, layout, wanted, frame.count, left_out)
        if not chosen:
            break
        [run] = loop.runs([frame.reference([possible[k] for k in chosen])])
        at = loop.beyond(run)
        if at is None:
            return run, chosen
        left_out.append(chosen[min(max(at - frame.lead.size, 0) // frame.samples, len(chosen) - 1)])
    raise SolveError(
        "pieces that stay within the stroke limits leave them when they follow each other; try lower gains"
    )


def _table(
    rivals: Sequence[Effect], wanted: Sequence[Pair], planned: Array, plain: Array, seconds: float
) -> tuple[Separation, ...]:
    rows = [
        Separation(
            rivals[i].name,
            None if j is None else rivals[j].name,
            float(sd),
            float(simple),
            seconds * max(1.0, (NEEDED / float(sd)) ** 2) if sd > 0 else math.inf,
        )
        for (i, j), sd, simple in zip(wanted, planned, plain, strict=True)
    ]
    return tuple(sorted(rows, key=lambda row: row.planned))
