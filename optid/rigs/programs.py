"""The user's own Python files that a rig file names, found without running them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from optid.core.document import parsed_toml, read_bounded


def programs(rig: Path) -> Iterator[Path]:
    """The files of its plant and its effects; none where the rig file cannot be read."""
    try:
        content = parsed_toml(read_bounded(rig).decode("utf-8-sig"))
    except (OSError, ValueError):
        return
    effects = content.get("effects", {})
    for name in (content.get("model"), *(effects if isinstance(effects, dict) else ())):
        file, colon, _ = str(name).rpartition(":")
        if colon and file.endswith(".py"):
            yield rig.parent / file
