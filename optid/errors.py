"""What can go wrong, as exceptions a user can act on.

OptidError
├── InputError          the call or an input file is wrong            -> exit status 2
│   ├── RigError        a rig file: which field, what was found, what was expected
│   ├── RecordingError  a recording: which column or row
│   └── PlantError      a plant's equations do not close
└── JobError            a job ran and failed; says what was kept       -> exit status 1
    ├── SolveError      the numbers went wrong (divergence, non-finite values)
    └── NotIdentifiable the data cannot determine the parameters
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable

LONGEST = 1200  # characters of a message
MANY = 2000  # names that are compared with a mistyped one


class OptidError(Exception):
    """The root of everything optid raises on purpose."""


class InputError(OptidError):
    """The call or an input file is wrong.

    The message is one line: ``where: field: what was found; expected ...; hint``.

    Parameters
    ----------
    message : str
        what was found.
    where : object
        file, or option of the call.
    field : str | None
        entry of the file.
    expected : str | None
        what should stand there.
    hint : str | None
        what to do.
    """

    def __init__(
        self,
        message: str,
        *,
        where: object = None,
        field: str | None = None,
        expected: str | None = None,
        hint: str | None = None,
    ) -> None:
        self.where, self.field, self.expected, self.hint = where, field, expected, hint
        head = ": ".join(str(part) for part in (where, field) if part is not None)
        tail = "; ".join(part for part in (message, expected and f"expected {expected}", hint) if part)
        super().__init__(one_line(f"{head}: {tail}" if head else tail))


def one_line(text: str) -> str:
    """A message fit for a terminal: without line breaks, and without its middle where it is very long."""
    if len(text) > 4 * LONGEST:  # before anything that takes time goes over it
        text = f"{text[: 2 * LONGEST]} ... {text[-2 * LONGEST :]}"
    line = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"


class RigError(InputError):
    """A rig file says something that cannot be."""


class RecordingError(InputError):
    """A recording cannot be read or does not hold what the rig file maps."""


class PlantError(InputError):
    """A plant's equations do not close: a state without a rate, an unknown site, a wrong option."""


class JobError(OptidError):
    """A job ran and failed."""


class SolveError(JobError):
    """The numbers went wrong: a diverging simulation, a singular system."""


class NotIdentifiable(JobError):
    """The data cannot determine the parameters."""


def nearest(name: str, valid: Iterable[str]) -> str:
    """Say which of the valid names was probably meant, or list them all."""
    names = sorted(valid)
    # Each comparison takes time with the length of both: a name of thousands of letters is no slip.
    close = difflib.get_close_matches(name[:80], [n for n in names[:MANY] if len(n) <= 80], n=1, cutoff=0.6)
    if close:
        return f'did you mean "{close[0]}"?'
    shown = ", ".join(n if len(n) <= 80 else f"{n[:76]} ..." for n in names[:40])
    more = f" and {len(names) - 40} more" if len(names) > 40 else ""
    return f"valid names: {shown}{more}" if names else "there are none"
