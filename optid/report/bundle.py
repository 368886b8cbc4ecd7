"""The plotting bundle that pages of one folder share."""

from __future__ import annotations

from pathlib import Path

HERE = Path(__file__).parent
BUNDLE = "plotly-basic.min.js"
# Environment: where pages find the bundle that many of them share, instead of one each.
SHARED = "OPTID_PLOTLY"


def write_library(folder: Path) -> None:
    """Put the bundle into a folder whose pages share it, unless it is there."""
    content, place = (HERE / "plotly" / BUNDLE).read_bytes(), folder / BUNDLE
    if not place.is_file() or place.read_bytes() != content:
        fresh = folder / f".{BUNDLE}.new"
        fresh.write_bytes(content)
        fresh.replace(place)
