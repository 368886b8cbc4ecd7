"""The results folder: tested before the work starts, written completely or not at all, and never lost."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import click

from optid.cli.run import note_inputs, this_run, undisturbed
from optid.core import resultset
from optid.errors import InputError, JobError, OptidError

if TYPE_CHECKING:
    from optid.results.result import Result

Found = TypeVar("Found", bound="Result")
OUT = click.option("--out", required=True, metavar="DIR", help="Folder for the results; made if absent.")

Write = Callable[[Path], None]


@dataclass
class _Claim:
    """A folder that this run writes into: the parents it created, its lock, and the manifest it found."""

    folder: Path
    made: list[Path] = field(default_factory=list)
    lock: int | None = None
    found: Any = None

    def release(self) -> None:
        """Release the folder; folders that were created and are empty are removed."""
        if self.lock is not None:
            os.close(self.lock)
            self.lock = None
        if tempfile.tempdir == str(self.folder):
            tempfile.tempdir = None
        for folder in reversed(self.made):
            with contextlib.suppress(OSError):
                folder.rmdir()


def results_folder(out: str, keeps: Path | None = None) -> Path:
    """The results folder, tested before any work starts by doing once what writing will do.

    Raises:
        InputError: it is a file, cannot be written to, is another run's, or would lose the file that it `keeps`.
    """
    try:
        folder = Path(out).resolve()
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{out} is a file", where="--out", expected="a folder")
    except (OSError, RuntimeError, ValueError) as error:
        raise InputError(f"this cannot name a folder ({error})", where="--out", expected="a folder") from None
    if keeps is not None and keeps.resolve() == folder / "rig.toml":
        raise InputError(f"the fitted rig would overwrite {keeps}", where="--out", expected="another folder")
    context = click.get_current_context(silent=True)
    claim = _claimed(folder, out)
    if context is None:
        claim.release()
        return folder
    context.call_on_close(claim.release)
    context.meta[f"claim {folder}"] = claim
    note_inputs(context)
    return folder


def _claimed(folder: Path, out: str) -> _Claim:
    claim = _Claim(folder)
    try:
        for place in reversed([folder, *folder.parents]):
            if not place.exists():
                place.mkdir(exist_ok=True)
                claim.made.append(place)
        claim.lock = _locked(folder)
        if claim.lock is not None:
            resultset.recover(folder)
        resultset.try_out(folder)
        _refuse_obstacle(folder)
        claim.found = resultset.manifest(folder)
        _lend_temporary(folder)
    except OSError as error:
        claim.release()
        raise InputError(
            f"nothing can be written in {out} ({error.strerror or error})",
            where="--out",
            expected="a writable folder",
        ) from None
    except InputError:
        claim.release()
        raise
    return claim


def _locked(folder: Path) -> int | None:
    """A lock that ends with the process; ``None`` where the file system has none.

    Raises:
        InputError: another run holds it.
    """
    try:
        import fcntl
    except ImportError:  # Windows
        return None
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise InputError(
            "another run is writing into this folder",
            where="--out",
            expected="a folder of its own for each run",
            hint="wait for it to end",
        ) from None
    except OSError:
        os.close(descriptor)
        return None
    return descriptor


def _lend_temporary(folder: Path) -> None:
    """Use it for libraries' temporary files if no other folder is writable."""
    try:
        tempfile.gettempdir()
    except OSError:
        tempfile.tempdir = str(folder)


_FILES = (
    "report.html",
    "rig.toml",
    "manifest.json",
    "metrics.json",
    "prediction.csv",
    "fit.json",
    "armax.json",
    "table2.csv",
    "pid.json",
    "diagnosis.json",
    "plan.json",
    "experiment.csv",
    "live.json",
    "check.json",
    "test.json",
    "fleet.json",
    "fleet.parquet",
    "tables.npz",
)


def _refuse_obstacle(folder: Path) -> None:
    for name in _FILES:
        if (folder / name).is_dir():
            raise InputError(
                f"it contains a folder named {name}, which is the name of a result file",
                where="--out",
                expected="a folder without a subfolder of that name",
            )


def deliver(folder: Path, write: Write) -> None:
    """Write all files into the folder, as one set.

    If the folder cannot be written, its present files stay and all new ones go to another folder. If one file cannot
    be made, the others are kept there as well.

    Args:
        folder: as `results_folder` gave it.
        write: writes the files into the folder it is given; may be called again.

    Raises:
        JobError: it could not be done; says where the results are instead.
    """
    context = click.get_current_context(silent=True)
    claim = context.meta.get(f"claim {folder}") if context is not None else None
    with undisturbed():
        try:
            if claim is not None and claim.lock is None and resultset.manifest(folder) != claim.found:
                raise FileExistsError("another run wrote into this folder in the meantime")
            _save(folder, write)
        except OSError as error:
            _elsewhere(folder, write, f"{error}", "all of them are")
        except Exception as error:
            bug = "" if isinstance(error, OptidError) else "this is a bug in optid, please report it: "
            why = f"{bug}{type(error).__name__}: {error}"
            _elsewhere(folder, _bearing(write), why, "the files that could be written are")


def _save(folder: Path, write: Write) -> None:
    fresh = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    staged = None
    try:
        staged = resultset.staging(folder)
        write(staged)
        _stamp(staged)
        resultset.commit(folder, staged, this_run().facts)
    except BaseException:
        if staged is not None:
            shutil.rmtree(staged, ignore_errors=True)
        if fresh:
            with contextlib.suppress(OSError):
                folder.rmdir()
        raise
    this_run().delivered = folder


def _bearing(write: Write) -> Write:
    """Keep what was written before a failure, if anything."""

    def kept(staged: Path) -> None:
        try:
            write(staged)
        except Exception:
            if not any(staged.iterdir()):
                raise

    return kept


def _elsewhere(folder: Path, write: Write, why: str, what: str) -> NoReturn:
    """Save the set at the next best place and say where.

    Raises:
        JobError: always.
    """
    said = f"the results could not be written to {folder}: {why}"
    for place in _places(folder):
        try:
            _save(place, write)
        except Exception:
            continue
        raise JobError(f"{said}; {what} in {place}")
    raise JobError(said)


def _places(folder: Path) -> Iterator[Path]:
    """New folders: beside the intended one, in the working directory, in the home, and among temporary files."""
    name = f"{folder.name[:80] or 'optid'}-rescued"
    homes = [folder.parent]
    with contextlib.suppress(OSError):
        homes.append(Path.cwd())
    with contextlib.suppress(RuntimeError):
        homes.append(Path.home())
    with contextlib.suppress(OSError):
        homes.append(Path(tempfile.gettempdir()))
    for home in homes:
        free = (home / (name if number == 1 else f"{name}-{number}") for number in range(1, 1000))
        yield next(place for place in free if not place.exists())


def _stamp(staged: Path) -> None:
    """Every document says its schema, the version that wrote it, the command line and its inputs' digests."""
    for path in staged.glob("*.json"):
        content = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(content, dict):
            schema = content.pop("schema", f"optid.{path.stem}/1")
            facts = this_run().facts  # the command line replaces what the Python call recorded
            rest = {key: value for key, value in content.items() if key not in facts}
            write_json(path, {"schema": schema, **facts, **rest})


def placed(result: Found, out: str) -> Found:
    """The result with its folder, which the page's next command names."""
    about = {**result.document["about"], "folder": out}
    return replace(result, document={**result.document, "about": about})


def write_json(path: Path, content: object) -> None:
    """Indented, without NaN."""
    path.write_text(
        json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8"
    )
