"""A user's own plant and effect files are copied with a rig file, so that its folder is self-contained."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from optid.core.loading import Loaded, loaded, loaded_from
from optid.effects.effect import Effect
from optid.errors import RigError


def plant_file(model_name: str, home: Path) -> Loaded | None:
    """The file of a user's own plant; ``None`` for a built-in one.

    Args:
        model_name: as the rig file names it.
        home: the rig file's folder.
    """
    file, colon, _ = model_name.rpartition(":")
    if not colon:
        return None
    path = (home / file).resolve()
    known = next((one for one in loaded() if one.path == path), None)
    return known or Loaded(path, path.read_bytes())


def effect_files(effects: Iterable[Effect]) -> dict[str, Loaded]:
    """The files of a user's own effects, by the effects' names."""
    found = {effect.name: loaded_from(effect) for effect in effects}
    return {name: file for name, file in found.items() if file is not None}


def carried(files: Iterable[Loaded], folder: Path) -> dict[Path, str]:
    """Paths by which a rig file in a folder names files; files from elsewhere are copied there, as they were run.

    Raises:
        RigError: the folder cannot be written.
    """
    names: dict[Path, str] = {}
    for file in files:
        if file.path in names:
            continue
        if file.path.is_relative_to(folder.resolve()):
            names[file.path] = file.path.relative_to(folder.resolve()).as_posix()
            continue
        try:
            name = _free(file, folder, set(names.values()))
            (folder / name).write_bytes(file.content)
        except OSError as error:
            raise RigError(f"cannot be written ({error})", where=folder / file.path.name) from None
        names[file.path] = name
    return names


def _free(file: Loaded, folder: Path, taken: set[str]) -> str:
    """The file's name, with a number if another file has it."""
    name, number = file.path.name, 2
    while name in taken or ((folder / name).exists() and (folder / name).read_bytes() != file.content):
        name, number = f"{file.path.stem}_{number}.py", number + 1
    return name
