"""The page on how the house is built agrees with the tree: stages, files, floors."""

import ast
import re
from pathlib import Path

from tests.test_floors import FLOORS

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "studies" / "docs" / "house" / "stages.md").read_text(encoding="utf-8")
PIPELINE = ROOT / "optid" / "diagnosis" / "pipeline.py"


def rows(head):
    """Cells of the table that begins with this head."""
    table = PAGE.partition(head)[2].partition("\n\n")[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.strip().splitlines()[1:]]


STAGES = rows("| stage | file | function | takes | gives | asks of the data |")


def test_every_file_on_the_page_is_there():
    named = set(re.findall(r"`((?:optid|tests|studies)/[\w/.]+\.\w+)`", PAGE))
    assert len(named) > 20
    assert [name for name in named if not (ROOT / name).is_file()] == []


def test_every_stage_is_the_function_in_its_file():
    assert len(STAGES) == 14
    for stage, file, function, _, gives, _ in STAGES:
        tree = ast.parse((ROOT / file.strip("`")).read_text(encoding="utf-8"))
        defined = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert function.strip("`") in defined, stage
        result = defined[function.strip("`")].returns
        for name in re.findall(r"`(\w+)`", gives):
            assert result is not None and name in ast.unparse(result), (stage, name)


def test_the_stages_stand_in_the_diagram_in_their_order():
    diagram = PAGE.partition("```text")[2].partition("```")[0]
    places = [re.search(rf"(?<![\w-]){re.escape(stage)}(?![\w-])", diagram) for stage, *_ in STAGES[:-1]]
    assert all(places)
    inside = [place.start() for place in places if place]
    assert inside[3:] == sorted(inside[3:])  # what comes before stands side by side


def test_the_pipeline_calls_the_stages_in_the_pages_order():
    tree = ast.parse(PIPELINE.read_text(encoding="utf-8"))
    functions = {n.name: n for n in tree.body if isinstance(n, ast.FunctionDef)}
    listed = [function.strip("`") for _, file, function, *_ in STAGES if "optid/diagnosis/" in file]

    def called(function):
        calls = (n for n in ast.walk(function) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name))
        for call in sorted(calls, key=lambda n: (n.lineno, n.col_offset)):
            if call.func.id in functions:
                yield from called(functions[call.func.id])
            elif call.func.id in listed:
                yield call.func.id

    order = list(dict.fromkeys(called(functions["diagnose"])))
    assert order == [name for name in listed if name != "propose"]  # the selection asks for proposals


def test_the_floors_are_those_that_the_imports_keep():
    told = {
        name: int(floor)
        for floor, names, _ in rows("| floor | packages | content |")
        for name in re.findall(r"`(\w+)`", names)
    }
    assert told == FLOORS
