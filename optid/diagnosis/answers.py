"""The verdicts of a diagnosis, for code that reads results only."""

import enum


class Verdict(enum.Enum):
    """The verdict of a diagnosis; the value is the word in its file."""

    CONSISTENT = "consistent"
    PARAMETERS = "parameters"
    MISSING_PHYSICS = "missing-physics"
    UNEXPLAINED = "unexplained"
