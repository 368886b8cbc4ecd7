"""Fixtures for every test."""

from pathlib import Path

import pytest


@pytest.fixture
def shared() -> Path:
    """Folder with the real recordings and example rigs beside the checkout; skips where it is absent."""
    folder = Path(__file__).resolve().parents[2] / "shared"
    if not folder.is_dir():
        pytest.skip(f"the recordings in {folder} are absent: they are not part of the project")
    return folder
