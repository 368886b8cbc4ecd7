"""Compile a model: emitted equations and the kernel side by side in a cached package, loaded by content."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import itertools
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from pathlib import Path
from typing import Any

import platformdirs

from optid.core.emit import source
from optid.core.model import Model

_KERNEL = Path(__file__).with_name("kernel.py")
WORKERS = max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


@lru_cache(maxsize=64)
def compiled(model: Model, free: tuple[int, ...] = ()) -> Any:
    """The kernel module of a model, with slopes to the states and to the `free` parameters.

    The first call for a model compiles for some seconds; later ones, in this run or another, load it. The
    cache is the user's cache folder, or ``OPTID_CACHE``. Within a run the answer is remembered by model, since
    writing the equations anew costs as much as a pass over ten seconds of data.
    """
    return _load(source(model, free))


@lru_cache(maxsize=64)
def _load(equations: str) -> Any:
    kernel = _KERNEL.read_text(encoding="utf-8").replace("from equations import", "from .equations import")
    digest = hashlib.sha256((equations + kernel).encode()).hexdigest()[:24]
    name = f"optid_model_{digest}"
    folder = _folder() / name
    if not (folder / "kernel.py").exists():
        _write(folder, {"__init__.py": "", "equations.py": equations, "kernel.py": kernel})
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            name, folder / "__init__.py", submodule_search_locations=[str(folder)]
        )
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return importlib.import_module(f"{name}.kernel")


def _folder() -> Path:
    wanted = Path(os.environ.get("OPTID_CACHE") or platformdirs.user_cache_path("optid"))
    try:
        wanted.mkdir(parents=True, exist_ok=True)
        if os.access(wanted, os.W_OK):
            return wanted
    except OSError:
        pass
    return Path(tempfile.gettempdir())  # a home that cannot be written: compile once per machine start


def _write(folder: Path, files: dict[str, str]) -> None:
    """Make the package whole or not at all, also when two processes compile the same model."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(dir=folder.parent))
    for name, text in files.items():
        (draft / name).write_text(text, encoding="utf-8")
    try:
        draft.replace(folder)
    except OSError:  # the other process was first
        shutil.rmtree(draft, ignore_errors=True)


def spread(count: int, work: Callable[[int, int], None]) -> None:
    """Run ``work(first, last)`` over 0..count in as many threads as there are cores; the kernels hold no lock."""
    chunks = min(WORKERS, count)
    if chunks <= 1:
        work(0, count)
        return
    edges = [round(i * count / chunks) for i in range(chunks + 1)]
    for future in [_pool().submit(work, a, b) for a, b in itertools.pairwise(edges)]:
        future.result()


@lru_cache(maxsize=1)
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(WORKERS, thread_name_prefix="optid")
