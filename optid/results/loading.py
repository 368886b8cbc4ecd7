"""Results back from disk."""

from __future__ import annotations

import contextlib
import inspect
from pathlib import Path

from optid.core.document import read_document, read_json
from optid.core.paths import is_folder
from optid.core.resultset import located
from optid.errors import InputError
from optid.results.check import CheckResult
from optid.results.diagnosis import DiagnosisResult
from optid.results.fit import FitResult, ProfileResult
from optid.results.fleet import FleetResult
from optid.results.identification import IdentificationResult
from optid.results.plan import PlanResult
from optid.results.result import Result
from optid.results.simulation import SimulationResult
from optid.results.tuning import TuningResult
from optid.results.validity import parts, refuse_invalid

RESULTS: tuple[type[Result], ...] = (
    CheckResult,
    SimulationResult,
    FitResult,
    ProfileResult,
    DiagnosisResult,
    IdentificationResult,
    TuningResult,
    PlanResult,
    FleetResult,
)
EXPECTED = "a result of optid"


def load(path: str | Path) -> Result:
    """Read a result that `save` or a command of `optid` has written.

    Parameters
    ----------
    path : str | Path
        its folder, or its JSON file where a folder holds several.

    Returns
    -------
    Result
        The result, equal to the one that was saved.

    Raises
    ------
    InputError
        there is no result, more than one, a damaged one, one of a newer optid, or files of several runs.
    """
    place = Path(path)
    if not is_folder(place):
        return _read(_kind_of(place), place.parent, place)
    held = [kind for kind in RESULTS if located(place / kind.FILE).is_file()]
    if len(held) != 1:
        found = f"{len(held)} results" if held else "no result"
        names = ", ".join(kind.FILE for kind in held or RESULTS)
        raise InputError(found, where=place, expected=f"a folder with one of {names}")
    return _read(held[0], place, place / held[0].FILE)


def _kind_of(file: Path) -> type[Result]:
    """The class of result that a file's schema names."""
    content = read_json(file, EXPECTED)
    said = content.get("schema") if isinstance(content, dict) else None
    for kind in RESULTS:
        if isinstance(said, str) and said.partition("/")[0] == kind.SCHEMA.partition("/")[0]:
            return kind
    schemas = ", ".join(kind.SCHEMA for kind in RESULTS)
    raise InputError(f"{said}"[:80], where=file, field="schema", expected=f"one of {schemas}")


def _read(kind: type[Result], folder: Path, file: Path) -> Result:
    document = parts(read_document(file, kind.SCHEMA, EXPECTED), file)
    try:
        found = kind.read(folder, document)
    except (OSError, ValueError) as error:
        raise InputError(f"a file of this result cannot be read ({error})", where=folder) from None
    refuse_invalid(document, kind.SCHEMA, file)
    try:
        found.summary()
        for name in _figures(kind):
            with contextlib.suppress(InputError):  # missing, as in an older file: reported when it is used
                getattr(found, name)
    except InputError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError) as error:
        why = f"{type(error).__name__}: {error}"[:120]
        raise InputError(f"it is incomplete ({why})", where=file, expected=EXPECTED) from None
    return found


def _figures(kind: type[Result]) -> list[str]:
    """Properties of a kind that come from its document and tables alone."""
    return [name for name, held in inspect.getmembers(kind) if isinstance(held, property) and name != "rig"]
