"""The public names of Python, from `optid.__all__` and their docstrings."""

from __future__ import annotations

import inspect

import optid

HEAD = """# Python API

Everything that `import optid` offers; nothing else is public. This page is generated from the docstrings, which a
linter checks (numpydoc's validation, `tests/docs/test_docstrings.py`). Units are SI unless a line says otherwise. How
to use the calls together is described in [from Python](../../reference/python.md).
"""
GROUPS = {
    "The jobs": ("check", "simulate", "fit", "profile", "diagnose", "identify", "tune", "plan", "load"),
    "Rigs and recordings": ("read_rig", "write_rig", "Rig", "read_recording", "Recording", "datasets"),
    "Plants and effects of your own": ("build", "Sheet", "Parameter", "Effect", "laws", "Driver"),
    "Many rigs": ("fleet",),
    "Models in other tools": ("Model", "CasadiFunctions", "linearise", "from_control", "export_fmu"),
}


def pages() -> dict[str, str]:
    """File name -> text."""
    grouped = {name for names in GROUPS.values() for name in names}
    rest = [name for name in optid.__all__ if name not in grouped and name != "__version__"]
    groups = {
        **GROUPS,
        "Results": [n for n in rest if not _error(n)],
        "Errors": [n for n in rest if _error(n)],
    }
    parts = [HEAD]
    for title, names in groups.items():
        parts.append(f"\n## {title}\n")
        parts += [_name(name) for name in names]
    return {"index.md": "\n".join(parts)}


def _error(name: str) -> bool:
    thing = getattr(optid, name)
    return inspect.isclass(thing) and issubclass(thing, BaseException)


def _name(name: str) -> str:
    thing = getattr(optid, name)
    if inspect.ismodule(thing):
        own = [f"optid.{name}.{one}" for one in _public(thing)]
        return f"\n### optid.{name}\n\n{_first(thing)}\n" + "\n".join(
            _directive(n, getattr(thing, n.rpartition(".")[2])) for n in own
        )
    return f"\n### {name}\n\n" + _directive(f"optid.{name}", thing)


def _public(module: object) -> list[str]:
    listed = getattr(module, "__all__", None)
    return (
        list(listed)
        if listed is not None
        else [
            name
            for name, thing in vars(module).items()
            if not name.startswith("_") and getattr(thing, "__module__", "") == module.__name__  # type: ignore[attr-defined]
        ]
    )


def _first(thing: object) -> str:
    return (inspect.getdoc(thing) or "").split("\n\n")[0]


def _directive(name: str, thing: object) -> str:
    if inspect.isclass(thing):
        options = "   :members:\n   :inherited-members: Exception, Enum, object\n"
        return f"```{{eval-rst}}\n.. autoclass:: {name}\n{options}```\n"
    return f"```{{eval-rst}}\n.. autofunction:: {name}\n```\n"
