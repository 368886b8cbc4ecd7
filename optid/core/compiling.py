"""How machine code is kept between runs: in a folder of the user's cache that is named after optid's sources.

numba looks at the file of the outermost function alone: a change of a function that others call, as an upgrade
brings, would leave machine code with the old one inside. Models are kept there, too, under what they consist of.
"""

from __future__ import annotations

import contextlib
import hashlib
import tempfile
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
import platformdirs

MOST = 4000  # models kept, some tens of kilobytes each; half of them go when there are more


def kept(**options: Any) -> Any:
    """`numba.njit` with these options and a cache that follows every change of optid."""

    def decorate(function: Any) -> Any:
        before = numba.config.CACHE_DIR
        numba.config.CACHE_DIR = _folder()
        try:
            return numba.njit(cache=True, **options)(function)
        finally:
            numba.config.CACHE_DIR = before

    return decorate


def stored(key: str, make: Callable[[], bytes]) -> bytes:
    """What `make` returned when it was first called under this key, on this machine or in another run.

    A file that is damaged is made anew, and a folder that cannot be written to is done without.
    """
    place = Path(_folder()) / "models" / hashlib.sha256(key.encode()).hexdigest()
    with contextlib.suppress(OSError):
        digest, held = (whole := place.read_bytes())[:32], whole[32:]
        if held and hashlib.sha256(held).digest() == digest:
            return held
    held = make()
    with contextlib.suppress(OSError):
        place.parent.mkdir(parents=True, exist_ok=True)
        _thin(place.parent)
        with tempfile.NamedTemporaryFile(dir=place.parent, suffix=".part", delete=False) as file:
            file.write(hashlib.sha256(held).digest() + held)
        Path(file.name).replace(place)
    return held


def _thin(folder: Path) -> None:
    """Delete the older half where there are too many."""
    files = list(folder.iterdir())
    if len(files) > MOST:
        for file in sorted(files, key=lambda one: one.stat().st_mtime)[: len(files) // 2]:
            file.unlink(missing_ok=True)


@lru_cache(maxsize=1)
def _folder() -> str:
    digest = hashlib.sha256()
    root = Path(__file__).parents[1]
    for source in sorted(root.rglob("*.py")):
        digest.update(source.read_bytes())
    return str(Path(platformdirs.user_cache_dir("optid")) / "kernels" / digest.hexdigest()[:16])
