"""The house keeps its floors: a file imports only from floors below its own, and only `cli` prints."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "optid"
FLOORS = {
    "errors": 0,
    "core": 1,
    "rigs": 2,
    "effects": 2,
    "estimation": 3,
    "armax": 3,
    "pid": 3,
    "quality": 3,
    "diagnosis": 4,
    "monitoring": 4,
    "tuning": 4,
    "live": 4,
    "experiments": 4,
    "results": 5,
    "report": 6,
    "api": 7,
    "datasets": 7,
    "laws": 7,
    "fleet": 8,
    "cli": 9,
}
NEIGHBOURS = {
    ("estimation", "quality"),
    ("rigs", "effects"),
    ("monitoring", "diagnosis"),
    ("live", "monitoring"),
    ("live", "tuning"),
    ("experiments", "tuning"),
    ("experiments", "live"),
}
READS_FRAMES = ("readers.memory", "readers.mapping", "readers.columns", "readers.repair")
FILES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def house(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported(path):
    """Dotted names of the package's modules that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"line {node.lineno}: a relative import"
            names = [node.module]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] == "optid")


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_imports_point_down(path):
    own = house(path)
    assert own in FLOORS, f"{own} has no floor"
    for name in imported(path):
        assert name != "optid", "imports the package root"
        other = name.split(".")[1]
        below = FLOORS[other] < FLOORS[own]
        assert other == own or below or (own, other) in NEIGHBOURS, f"{own} imports {name}"


def at_run_time(path):
    """Modules of the package that a file imports when it runs, at its head or later."""
    places = [ast.parse(path.read_text(encoding="utf-8"))]
    while places:
        node = places.pop()
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        places += ast.iter_child_nodes(node)
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield from (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))


def test_no_imports_go_in_a_ring():
    modules = {".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts): path for path in FILES}
    needs = {name: {one for one in at_run_time(path) if one in modules} for name, path in modules.items()}
    while done := [name for name, others in needs.items() if not others & needs.keys()]:
        for name in done:
            del needs[name]
    while top := [name for name in needs if not any(name in others for others in needs.values())]:
        for name in top:
            del needs[name]
    # `Recording.from_frame` reads as files are read.
    assert set(needs) <= {f"optid.core.{name}" for name in ("recording", *READS_FRAMES)}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_only_the_command_line_prints(path):
    calls = (
        node for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))) if isinstance(node, ast.Call)
    )
    printed = [call.lineno for call in calls if isinstance(call.func, ast.Name) and call.func.id == "print"]
    assert house(path) == "cli" or not printed
