"""The answer of a diagnosis in a word, for those who read results and diagnose nothing."""

import enum


class Verdict(enum.Enum):
    """What a diagnosis says; the value is the word in its file."""

    CONSISTENT = "consistent"
    PARAMETERS = "parameters"
    MISSING_PHYSICS = "missing-physics"
    UNEXPLAINED = "unexplained"
