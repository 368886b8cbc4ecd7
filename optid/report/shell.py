"""The shell of every page: a self-contained file, with the library that its figures need."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jinja2

from optid.core.quantity import plain, quantity, typeset, unit_name
from optid.report.interactive import library


def render(template: str, title: str, **context: Any) -> str:
    """A page.

    Args:
        template: file beside this one that extends `shell.html.j2`.
        title: of the page.
        **context: variables of the template; `next_command`, where given, is shown at the end as the next command,
            and `shared_library` is the address of the plotting bundle where it is not to go inside. Figures come as
            `optid.report.interactive.interactive` makes them.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {
        "words": lambda name: name.replace("_", " "),
        "typeset": typeset,
        "unit": unit_name,
        "plain": plain,
    }
    environment.globals |= {"library": library, "quantity": quantity}
    context.setdefault("next_command", "")
    context.setdefault("shared_library", None)
    return environment.get_template(template).render(title=title, **context)
