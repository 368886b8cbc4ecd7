"""The checkpoint of a long job, from which an interrupted call continues."""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path

from optid.cli.run import this_run
from optid.core.cache import cache_folder, sources
from optid.core.document import read_bounded

_API = Path(__file__).parents[1] / "api"


def checkpoint(folder: Path, resume: bool) -> Path | None:
    """A file in the user's cache for work into this folder; ``None`` where nothing can be kept.

    It is named after the folder and all that the work depends on: another version of optid, or a plant, an effect or
    a recording that was edited since, starts from the beginning.
    """
    home = cache_folder()
    if home is None:
        return None
    owner, depends = _digest(os.fsencode(folder)), _digest(repr(_depends()).encode())
    path = home / "fits" / f"{owner}-{depends}.json"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        for old in path.parent.glob(f"{owner}*"):
            if old != path or not resume:
                old.unlink(missing_ok=True)
        if not os.access(path.parent, os.W_OK):
            return None
    except OSError:
        return None
    return path


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:24]


def _depends() -> list[object]:
    """What the result of a run depends on: optid's own code, its inputs, and the programs that they name."""
    from optid.rigs.programs import programs

    run = this_run()
    found: list[object] = [sources(str(_API / name)) for name in ("diagnosing.py", "fitting.py")]
    named = {program for text in run.inputs for program in programs(Path(text)) if text.endswith(".toml")}
    for program in sorted(named):
        with contextlib.suppress(OSError, ValueError):
            found.append((str(program), _digest(read_bounded(program))))
    return [*found, sorted(run.inputs.items())]
