"""Tunes a session once, at a given session time, and applies the gains if the review finds them better."""

from __future__ import annotations

from optid.live.session import Session


class AutomaticTuning:
    """Call `look` after each `poll` of the session.

    Args:
        session: to tune; one that runs faster than real time waits meanwhile (`Plan.hold`).
        after: s of the session's time; ``None`` never.
    """

    def __init__(self, session: Session, after: float | None) -> None:
        self._session, self._after = session, after
        self._asked = self._applied = False
        self._settled = after is None

    def look(self) -> None:
        """Do the next step if it is due."""
        session = self._session
        if self._settled or self._after is None:
            return
        if not self._asked:
            if session.holding or (not session.plan.fast and session.now() > self._after):
                self._asked = True
                session.tune()
        elif not session.busy:
            self._decide()

    def _decide(self) -> None:
        session, review = self._session, self._session.tuning.review
        if not self._applied:
            self._applied = True
            session.apply()
        if review is None or review.worse or not session.applicable:  # the loop has confirmed them
            self._settled = True
            session.resume()
