"""How numba's loops are compiled and kept: in a folder of the user's cache that is named after optid's sources.

numba looks at the file of the outermost function alone: a change of a function that others call, as an upgrade
brings, would leave machine code with the old one inside.
"""

from __future__ import annotations

import hashlib
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
import platformdirs


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


@lru_cache(maxsize=1)
def _folder() -> str:
    digest = hashlib.sha256()
    root = Path(__file__).parents[1]
    for source in sorted(root.rglob("*.py")):
        digest.update(source.read_bytes())
    return str(Path(platformdirs.user_cache_dir("optid")) / "kernels" / digest.hexdigest()[:16])
