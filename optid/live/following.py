"""Parameters and effects monitored beside the loop: an estimate from each newest stretch of the log."""

from __future__ import annotations

import math
import tempfile
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from optid.live.background import Background
from optid.live.commissioning import RIG_FILE, Commissioned, document, read_since, sentence
from optid.live.excerpt import last_rows, offer_diagnosis
from optid.live.log import LOG
from optid.live.plan import Plan
from optid.monitoring.one_step import Quantity

if TYPE_CHECKING:
    from optid.effects.effect import Effect
    from optid.rigs.rigfile import Rig

SECONDS = 20.0  # s of an estimate
LOOKS = 4  # newest estimates that are judged together
LEAST = 2  # estimates before anything is reported


@dataclass(frozen=True, eq=False)
class StretchEstimates:
    """Estimates of a stretch, the rig file's values (an effect's null), and the bounds of possible values."""

    found: Mapping[str, Quantity]
    stated: Mapping[str, float]
    bounds: Mapping[str, tuple[float, float]]


class ParameterMonitor:
    """One estimate at a time, in the background.

    Args:
        plan: of the session.
        rate: Hz.
        note: called with events in words.

    Attributes:
        standing: current result, as in live.json; ``None`` before the first.

    Raises:
        InputError: the plan's `since` cannot be read.
    """

    def __init__(self, plan: Plan, rate: float, note: Callable[[str], None]) -> None:
        self._plan, self._rate, self._note = plan, rate, note
        self._since = None if plan.since is None else read_since(plan.since)
        self._background: Background[StretchEstimates | str] = Background(not plan.fast)
        self._looks: deque[StretchEstimates] = deque(maxlen=LOOKS)
        self._next, self._first, self._command, self._failed = SECONDS, "", "", ""
        self.standing: dict[str, Any] | None = None

    def poll(self, now: float) -> None:
        """Start an estimate when a stretch is complete, and take the result of the last one.

        Args:
            now: s of the session.
        """
        if now >= self._next and not self._background.busy:
            self._next = now + SECONDS
            self._background.begin(look, self._plan, self._rate)
        try:
            found = self._background.result()
        except Exception as error:  # its process died: the loop continues
            found = f"{type(error).__name__}: {error}"
        if found is not None:
            self._next = max(
                self._next, now + SECONDS
            )  # from the end of an estimate on: stretches do not overlap
        if isinstance(found, StretchEstimates):
            self._looks.append(found)
            if len(self._looks) >= LEAST:
                self._judge()
        elif found and found != self._failed:
            self._failed = found
            self._note(f"the parameters are not tracked: {found}")

    def close(self) -> None:
        """Cancel the job."""
        self._background.close()

    def _judge(self) -> None:
        newest = self._looks[-1]
        stated = {name: (value, 0.0, 0.0) for name, value in newest.stated.items()}
        since = self._since or Commissioned(RIG_FILE, stated)
        standings = since.compare([one.found for one in self._looks], newest.bounds)
        first = next((one.name for one in standings if one.changed), "")
        fresh, self._first = first != self._first, first
        if fresh:
            # The first minutes that showed it are kept: writing them each time would delay the session.
            self._command = offer_diagnosis(self._plan.rig, self._plan.out, self._rate) if first else ""
        words = sentence(standings, since.source, SECONDS * len(self._looks), self._command)
        self.standing = document(standings, since.source, words, self._command)
        if fresh:
            self._note(words)


@lru_cache(maxsize=1)
def _understood(path: Path) -> tuple[Rig, tuple[Effect, ...]]:
    """The rig and the effects that its plant admits, cached for all estimates."""
    from optid.effects.library import admitted, built_in
    from optid.rigs.rigfile import read_rig

    rig = read_rig(path)
    return rig, tuple(one for one in admitted(rig.model) if one.name in built_in())


def look(plan: Plan, rate: float) -> StretchEstimates | str:
    """Estimate all quantities from the newest stretch of a session's log; or the reason why that is impossible."""
    from optid.core.readers import read_recording
    from optid.errors import OptidError
    from optid.live.gains import gentle
    from optid.live.settings import live_settings, wiring_of
    from optid.live.windows import estimates

    rig, effects = _understood(plan.rig)
    try:
        head, rows = last_rows(plan.out / LOG, round(SECONDS * rate))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "stretch.csv"
            path.write_bytes(b"\n".join((head, *rows)) + b"\n")
            recording = read_recording(path, rig)
        limits = live_settings(rig, rate, relaxed=True).limits
        pull = gentle(limits).kp if math.isfinite(limits.stroke[1] - limits.stroke[0]) else 0.0
        found = estimates(rig, wiring_of(rig), recording, effects, pull)
    except (OptidError, OSError) as error:
        return str(error)
    stated = {one.name: rig.parameters[one.name] for one in rig.freed if one.name in rig.parameters}
    bounds: dict[str, tuple[float, float]] = {}
    for one in effects:
        stated |= one.qualified(one.at_null())
        bounds |= {f"{one.name}.{q.name}": q.bounds for q in one.parameters}
    return StretchEstimates({name: one for name, one in found.items() if name in stated}, stated, bounds)
