"""What stands beside the code for other programs: citation, workflows, issue templates."""

import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
yaml = pytest.importorskip("yaml")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def read(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def test_the_citation_is_of_this_version():
    citation = read("CITATION.cff")
    assert citation["version"] == PROJECT["version"] and citation["license"] == PROJECT["license"]
    assert {"cff-version", "title", "message", "authors"} <= set(citation)


@pytest.mark.parametrize(("file", "job"), [("test.yml", "wheel"), ("release.yml", "try")])
def test_every_system_and_python_is_tried(file, job):
    matrix = read(f".github/workflows/{file}")["jobs"][job]["strategy"]["matrix"]
    assert {name.split("-")[0] for name in matrix["os"]} == {"ubuntu", "macos", "windows"}
    told = {line.rpartition(" ")[2] for line in PROJECT["classifiers"] if ":: 3." in line}
    assert set(matrix["python"]) == told == {"3.11", "3.12", "3.13", "3.14"}


def test_a_release_waits_for_everything():
    jobs = read(".github/workflows/release.yml")["jobs"]
    assert set(jobs["publish"]["needs"]) == {"full", "try", "site"}
    assert {"build"} == {jobs["try"]["needs"]}


def test_an_issue_asks_what_is_needed():
    for path in (ROOT / ".github" / "ISSUE_TEMPLATE").glob("*.yml"):
        form = read(path.relative_to(ROOT))
        assert path.stem == "config" or {"name", "description", "body"} <= set(form), path.name
