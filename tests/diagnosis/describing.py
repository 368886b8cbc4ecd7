"""A description as a diagnosis looks for it: forms that are led, waves that are heard, then refits."""

from optid.diagnosis.unexplained import describe, listen, look


def description(base, current, sites, data):
    """What describes a mismatch at these sites, or nothing."""
    return describe(listen(look(base, current, sites, data, silent), data, silent), data)


def silent(words):
    """Nobody is told."""
