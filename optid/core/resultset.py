"""A results folder is replaced completely or not at all, whenever the writing process ends.

The new files are written into `.optid-new-...` inside the folder, with a manifest of their digests. Renaming that to
`.optid-commit` is the one step that decides: before it the old set counts, after it the new one. Then each file is
moved to its place by rename, the manifest last. Readers ask `located` for the place of a file and so see one set or
the other; the next run calls `recover`, which finishes what was begun.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import shutil
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from optid.core.paths import digest_of, is_file, is_folder
from optid.errors import InputError

MANIFEST = "manifest.json"
SCHEMA = "optid.manifest/1"
STAGED, COMMITTED, UNDONE = ".optid-new-", ".optid-commit", ".optid-undo"
OLD = "old"  # inside those: the former files, to be restored if the folder fails half-way
_MOST = 2**24  # bytes of a manifest; a file of that name may be anybody's
_TRIAL = "x" * 40  # longer than the name of any result


def staging(folder: Path) -> Path:
    """A new folder inside a folder, for files that are to take their places in it.

    Raises:
        OSError: it cannot be made.
    """
    return Path(tempfile.mkdtemp(prefix=STAGED, dir=folder))


def try_out(folder: Path) -> None:
    """Test a folder by doing what writing results will do, and leave it as it was.

    Raises:
        OSError: it cannot be done: no permission, no space, a name too long, a read-only place.
    """
    staged = staging(folder)
    moved = folder / f"{staged.name}{_TRIAL}"
    try:
        (staged / OLD).mkdir()
        _write(staged / OLD / _TRIAL, b"x" * 4096)
        (staged / OLD / _TRIAL).replace(moved)
    finally:
        with contextlib.suppress(OSError):
            moved.unlink(missing_ok=True)
        shutil.rmtree(staged, ignore_errors=True)


def recover(folder: Path) -> None:
    """Finish what an interrupted process left half-done, and remove its temporary files.

    The caller must know that no other process writes into the folder.

    Raises:
        OSError: the folder cannot be written.
    """
    if (folder / UNDONE).is_dir():
        _put_back(folder)
    if (folder / COMMITTED).is_dir():
        _move_in(folder)
    for litter in folder.glob(f"{STAGED}*"):
        if litter.is_dir():
            shutil.rmtree(litter, ignore_errors=True)
        else:
            litter.unlink(missing_ok=True)


def commit(folder: Path, staged: Path, facts: Mapping[str, Any]) -> None:
    """Move the staged files into place and write the folder's manifest.

    Former files of the same command that are not replaced are deleted, unless they were changed since; files of other
    commands stay and are listed as earlier ones.

    Args:
        folder: where nothing is half-done.
        staged: of `staging`, inside the folder.
        facts: what the manifest says of the run: version, command and inputs.

    Raises:
        OSError: the folder cannot be written; the old files then stay.
    """
    names = sorted(path.name for path in staged.iterdir())
    for name in (*names, MANIFEST):
        if (folder / name).is_dir():
            raise IsADirectoryError(errno.EISDIR, f"there is a folder named {name}", str(folder / name))
    before = manifest(folder) or {}
    known: dict[str, str] = {**before.get("earlier", {}), **before.get("files", {})}
    here = {name: digest for name in {*known, *names} if (digest := digest_of(folder / name))}
    for name in names:
        if (
            name.endswith(".py")
            and name in here
            and here[name] not in (known.get(name), digest_of(staged / name))
        ):
            raise FileExistsError(
                errno.EEXIST, "another program's file of this name is in the folder", str(folder / name)
            )
    rest = {name: digest for name, digest in known.items() if name not in names and here.get(name) == digest}
    same = _kind(before) == _kind(facts)
    removed = sorted(name for name in rest if same and name in before.get("files", {}))
    content = {
        "schema": SCHEMA,
        **facts,
        "files": {name: digest_of(staged / name) for name in names},
        "earlier": {name: digest for name, digest in rest.items() if name not in removed},
        "replaced": {name: here[name] for name in names if name in here},
        "removed": removed,
    }
    _write(staged / MANIFEST, (json.dumps(content, indent=1, ensure_ascii=False) + "\n").encode())
    _keep_old(folder, staged / OLD, [*names, *removed, MANIFEST])
    for name in names:
        if here.get(name) == content["files"][name]:
            (staged / name).unlink()  # it may be the user's own file, as a plant beside its rig is
        else:
            _settle(staged / name)
    _settle(staged)
    staged.rename(folder / COMMITTED)
    _settle(folder)
    try:
        _move_in(folder)
    except OSError:
        with contextlib.suppress(
            OSError
        ):  # else readers go on with the new set, and the next run finishes it
            (folder / COMMITTED).rename(folder / UNDONE)
            _put_back(folder)
        raise


def manifest(folder: Path) -> dict[str, Any] | None:
    """The content of a folder's manifest; ``None`` where there is none that can be parsed."""
    try:
        with (folder / MANIFEST).open("rb") as file:
            content = json.loads(file.read(_MOST))
    except (OSError, ValueError, RecursionError):
        return None
    tables = ("files", "earlier", "replaced")
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        return None
    sound = all(isinstance(content.get(table), dict) for table in tables)
    return content if sound and isinstance(content.get("removed"), list) else None


def located(path: Path) -> Path:
    """Where to read a file of a results folder: not at `path` while a replacement is half done.

    Raises:
        InputError: the file does not belong to the set that the manifest lists.
    """
    folder, name = path.parent, path.name
    for half, place in ((COMMITTED, folder / COMMITTED / name), (UNDONE, folder / UNDONE / OLD / name)):
        if is_file(place):
            return place
        if is_folder(folder / half):
            told = manifest(folder / half) or {"files": {}, "replaced": {}, "removed": []}
            new = name in told["files"] and name not in told["replaced"]
            gone = name in told["removed"] if half == COMMITTED else new
            return place if gone else path
    told = manifest(folder) or {"replaced": {}, "files": {}}
    old = told["replaced"].get(name)
    if old is not None and old != told["files"].get(name) and digest_of(path) == old:
        raise InputError(
            f"this file is older than the results that {MANIFEST} lists",
            where=path,
            expected="files that one run wrote",
            hint=f"run {_kind(told) or 'the command'} again",
        )
    return path


def _kind(facts: Mapping[str, Any]) -> str:
    """The command without what it was called with: "optid fit"."""
    return " ".join(str(facts.get("command", "")).split()[:2])


def _keep_old(folder: Path, old: Path, names: Iterable[str]) -> None:
    old.mkdir()
    for name in names:
        if (folder / name).is_file():
            try:
                os.link(folder / name, old / name)
            except OSError:  # a file system without links
                shutil.copy2(folder / name, old / name)


def _move_in(folder: Path) -> None:
    """Move files from `.optid-commit` into place; may be called again after an interruption."""
    source = folder / COMMITTED
    told = manifest(source)
    if told is not None:  # else the manifest, which goes last, has gone
        for name in sorted(told["files"]):
            if (source / name).is_file():
                (source / name).replace(folder / name)
        for name in told["removed"]:
            (folder / str(name)).unlink(missing_ok=True)
        _settle(folder)
        (source / MANIFEST).replace(folder / MANIFEST)
        _settle(folder)
    shutil.rmtree(source, ignore_errors=True)


def _put_back(folder: Path) -> None:
    """Restore the former files; may be called again after an interruption."""
    source = folder / UNDONE
    told = manifest(source) or {"files": {}}
    for name in told["files"]:
        if name not in told["replaced"]:
            (folder / name).unlink(missing_ok=True)
    if (source / OLD).is_dir():
        for path in sorted((source / OLD).iterdir()):
            path.replace(folder / path.name)
    _settle(folder)
    shutil.rmtree(source, ignore_errors=True)


def _write(path: Path, content: bytes) -> None:
    with path.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())


def _settle(path: Path) -> None:
    """Call fsync on a file, or on a folder's names; not all places can."""
    with contextlib.suppress(OSError):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)
