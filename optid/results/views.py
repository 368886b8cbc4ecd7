"""The modules that show results: registered by the package root, so that results do not import the floor above."""

from __future__ import annotations

import importlib
from typing import Any

_VIEWS: dict[str, str] = {}


def register(schema: str, module: str) -> None:
    """Register the module that shows results of a schema.

    Parameters
    ----------
    schema : str
        "optid.fit/1".
    module : str
        its dotted name, imported when a result is first shown; it holds ``plot(result, axes)``, which returns
        the axes, and ``page(result)``, which returns an HTML page.
    """
    _VIEWS[schema] = module


def view_of(schema: str) -> Any:
    """The module that shows results of a schema.

    Raises
    ------
    LookupError
        none is registered: the package root was not imported.
    """
    if schema not in _VIEWS:
        raise LookupError(f"nothing shows {schema}; import optid first")
    return importlib.import_module(_VIEWS[schema])
