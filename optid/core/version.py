"""The version of the installed package."""

from __future__ import annotations

import importlib.metadata


def version() -> str:
    """Of the installed package; "0" where it runs from a folder that was never installed."""
    try:
        return importlib.metadata.version("optid")
    except importlib.metadata.PackageNotFoundError:
        return "0"
