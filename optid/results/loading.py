"""Results back from disk."""

from __future__ import annotations

from pathlib import Path

from optid.errors import InputError
from optid.results.check import CheckResult
from optid.results.diagnosis import DiagnosisResult
from optid.results.fit import FitResult, ProfileResult
from optid.results.fleet import FleetResult
from optid.results.identification import IdentificationResult
from optid.results.plan import PlanResult
from optid.results.result import Result, read_document
from optid.results.simulation import SimulationResult
from optid.results.tuning import TuningResult

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
        no result there, several, or a damaged one.
    """
    place = Path(path)
    if place.is_dir():
        held = [kind for kind in RESULTS if (place / kind.FILE).is_file()]
        if len(held) != 1:
            found = f"{len(held)} results" if held else "no result"
            names = ", ".join(kind.FILE for kind in held or RESULTS)
            raise InputError(found, where=place, expected=f"a folder with one of {names}")
        return _read(held[0], place, place / held[0].FILE)
    document = read_document(place)
    for kind in RESULTS:
        if document.get("schema") == kind.SCHEMA:
            return _read(kind, place.parent, place)
    schemas = ", ".join(kind.SCHEMA for kind in RESULTS)
    raise InputError(f"{document.get('schema')}", where=place, field="schema", expected=f"one of {schemas}")


def _read(kind: type[Result], folder: Path, file: Path) -> Result:
    document = read_document(file)
    if document.get("schema") != kind.SCHEMA:
        raise InputError(f"{document.get('schema')}", where=file, field="schema", expected=kind.SCHEMA)
    try:
        return kind.read(folder, document)
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"a file of this result cannot be read ({error})", where=folder) from None
