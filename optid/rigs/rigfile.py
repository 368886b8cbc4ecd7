"""Rig files: TOML in, a model with values, bounds and channels out; and back without losing a comment.

`rig` defines the result, `reading` parses the text, `writing` writes it.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from optid.core.document import read_bounded
from optid.core.resultset import located
from optid.errors import RigError, nearest
from optid.rigs.reading import TABLES as TABLES
from optid.rigs.reading import parse
from optid.rigs.rig import Freed as Freed
from optid.rigs.rig import Rig as Rig
from optid.rigs.rig import rebuilt as rebuilt
from optid.rigs.rig import with_effects as with_effects
from optid.rigs.writing import rewritten
from optid.rigs.writing import rig_text as rig_text

MOST = 4 * 2**20  # bytes of a rig file


def read_rig(path: str | Path) -> Rig:
    """Read a rig file and build its model.

    Parameters
    ----------
    path : str | Path
        of the rig file.

    Returns
    -------
    Rig
        the parsed rig file.

    Raises
    ------
    RigError
        cannot be read, is not TOML, or an entry is not valid; names file and field, what was
        found and what was expected.
    """
    path = Path(path)
    return parse(_text(path), path)


def rig_of_text(source: str, path: str | Path) -> Rig:
    """A rig from the text of its file, as a job wrote it: its values may contradict each other.

    Parameters
    ----------
    source : str
        the text.
    path : str | Path
        path used in errors and to find the user's own files.

    Raises
    ------
    RigError
        as `read_rig`.
    """
    return parse(source, Path(path), constrained=False)


def write_rig(rig: Rig, path: str | Path, parameters: Mapping[str, float] | None = None) -> None:
    """Write a rig file with new values, keeping its comments, units and layout.

    The file is written completely or not at all, and reads back to the same values within 1e-12. If it is written to
    another folder, the user's own plant and effect files are copied with it.

    Parameters
    ----------
    rig : Rig
        as read.
    path : str | Path
        file to write; its folder must exist.
    parameters : Mapping[str, float] | None
        SI values by name; the others stay unchanged. A parameter that the file did not state is
        added in its SI unit.

    Raises
    ------
    RigError
        an unknown name, a value outside its bounds, or a place that cannot be written.
    """
    path = Path(path)
    _replace(path, rewritten(rig, path, path.parent, parameters or {}))


def _text(path: Path) -> str:
    try:
        return read_bounded(located(path), MOST).decode("utf-8-sig")
    except FileNotFoundError:
        near = sorted(p.name for p in path.parent.glob("*.toml")) if path.parent.is_dir() else []
        raise RigError("no such file", where=path, hint=nearest(path.name, near) if near else None) from None
    except UnicodeDecodeError as error:
        raise RigError(f"byte {error.start} is not UTF-8", where=path, expected="a TOML text file") from None
    except (IsADirectoryError, PermissionError):
        what = "this is a directory" if path.is_dir() else "no permission to read it"
        raise RigError(what, where=path, expected="a readable rig file") from None
    except (OSError, ValueError) as error:
        raise RigError(f"cannot be read ({error})", where=path) from None


def _replace(path: Path, content: str) -> None:
    """Write beside the target and move into place, so that no half file is ever seen."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with beside.open("w", encoding="utf-8", newline="") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise RigError(f"cannot be written ({error})", where=path) from None
