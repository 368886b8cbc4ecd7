"""Fixtures for every test, and what only the full run does."""

import os
from pathlib import Path

import pytest

from optid.core.cache import kernels_folder


def pytest_collection_modifyitems(items):
    """Leave out what takes minutes, saying so."""
    if os.environ.get("OPTID_FULL") != "1":
        for item in items:
            if item.get_closest_marker("full"):
                item.add_marker(pytest.mark.skip(reason="minutes: OPTID_FULL=1, as .ci/full has it"))


@pytest.fixture
def shared() -> Path:
    """Folder with the real recordings and example rigs beside the checkout; skips where it is absent."""
    folder = Path(__file__).resolve().parents[2] / "shared"
    if not folder.is_dir():
        pytest.skip(f"the recordings in {folder} are absent: they are not part of the project")
    return folder


@pytest.fixture
def own_cache(tmp_path_factory, monkeypatch) -> Path:
    """A cache of the test's own, but for machine code: to compile that again would take most of its time."""
    compiled, home = kernels_folder(), tmp_path_factory.mktemp("cache")
    if compiled is not None:
        compiled.mkdir(parents=True, exist_ok=True)
        (home / "optid").mkdir()
        (home / "optid" / "kernels").symlink_to(compiled, target_is_directory=True)
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    return home
