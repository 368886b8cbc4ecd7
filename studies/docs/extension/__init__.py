"""The site's own Sphinx extension: pages generated from the code, and what the commands on the pages printed."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from studies.docs.extension import api, atlas, cli_reference, plants, schemas
from studies.docs.extension.sessions import Session


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the generator and the directive `session`."""
    app.add_config_value("optid_quick", False, "env")
    app.add_directive("session", Session)
    app.connect("builder-inited", generate)
    return {"parallel_read_safe": False}


def generate(app: Sphinx) -> None:
    """Write every generated page anew into generated/, but for the gallery, which keeps what it ran."""
    folder = Path(app.srcdir) / "generated"
    for part in (atlas, cli_reference, plants, schemas, api):
        place = folder / part.__name__.rpartition(".")[2]
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir(parents=True)
        for name, text in part.pages().items():
            (place / name).write_text(text, encoding="utf-8")
    if not app.config.optid_quick:
        atlas.draw_figures(folder / "atlas")
