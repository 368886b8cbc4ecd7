"""How numba's machine code is kept between runs: beside optid's other caches, with checksums.

numba trusts its files: a damaged one crashes the process, two processes can write one file for two functions, and a
folder that is not writable is an error. Here each signature of a function has files of its own, which are handed to
numba once their checksum is right. They are named after the function's source file and all of optid that it imports:
numba looks at the file of the outermost function alone, and a change of one that others call would leave machine code
with the old one inside.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from pathlib import Path
from typing import Any

import llvmlite
import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile

from optid.core.cache import compiling, kernels_folder, sources

STAMP = "named after its sources"


def kept(**options: Any) -> Any:
    """`numba.njit` with these options and a cache that follows every change of optid."""

    def decorate(function: Any) -> Any:
        dispatcher = numba.njit(**options)(function)
        if kernels_folder() is not None and Path(function.__code__.co_filename).is_file():
            dispatcher._cache = _Cache(function)
        return dispatcher

    return decorate


class _Locator:
    """Tells numba where a function's files are, without touching the disk."""

    def __init__(self, function: Any, file: str) -> None:
        self._py_file, self._line = file, function.__code__.co_firstlineno

    @classmethod
    def from_function(cls, function: Any, file: str) -> _Locator:
        return cls(function, file)

    def ensure_cache_path(self) -> None:
        Path(self.get_cache_path()).mkdir(parents=True, exist_ok=True)

    def get_cache_path(self) -> str:
        return str(kernels_folder())

    def get_source_stamp(self) -> str:
        return STAMP

    def get_disambiguator(self) -> str:
        return str(self._line)


class _Implementation(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = (_Locator,)


class _Cache(FunctionCache):  # type: ignore[misc]
    """numba's cache of one function, whose damaged files are compiled again."""

    _impl_class = _Implementation

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        name = f"{function.__module__}.{self._impl.filename_base} {sources(function.__code__.co_filename)}"
        self._cache_file = _Files(self._cache_path, name)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        found = None
        with contextlib.suppress(Exception):  # whatever is wrong with the file, it can be compiled again
            found = super().load_overload(sig, target_context)
        if found is None:
            compiling()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        with contextlib.suppress(OSError):  # read-only, or a full disk: nothing is cached
            super().save_overload(sig, data)


class _Files:
    """For each signature an index and a data file of numba's, and the checksum of both."""

    def __init__(self, folder: str, name: str) -> None:
        self._folder, self._name = folder, name

    def load(self, key: Any) -> Any:
        base, files = self._of(key)
        seal = Path(f"{base}.sum")
        if not seal.is_file() or seal.read_text() != _sum(base):
            return None
        return files.load(key)

    def save(self, key: Any, data: Any) -> None:
        base, files = self._of(key)
        seal = Path(f"{base}.sum")
        seal.unlink(missing_ok=True)
        files.flush()  # a damaged index is not used
        files.save(key, data)
        draft = Path(f"{base}.{os.getpid()}.part")
        draft.write_text(_sum(base))
        draft.replace(seal)

    def flush(self) -> None:
        """Nothing: a file's name says whether its content is fresh."""

    def _of(self, key: Any) -> tuple[Path, Any]:
        signature, target, code = key
        host = f"{numba.__version__} {llvmlite.__version__} {signature} {target} {code}"
        name = hashlib.sha256(f"{self._name} {host}".encode()).hexdigest()[:32]
        return Path(self._folder) / name, IndexDataCacheFile(self._folder, name, STAMP)


def _sum(base: Path) -> str:
    """Of an entry's index and data."""
    digest = hashlib.sha256()
    for path in (Path(f"{base}.nbi"), Path(f"{base}.1.nbc")):
        digest.update(path.read_bytes())
    return digest.hexdigest()
