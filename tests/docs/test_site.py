"""The site: built without a warning, its links lead somewhere, its commands are those of the parsers and were run."""

import json
import os
import re
import shlex
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import click
import pytest

from optid.cli import cli
from optid.effects.library import anywhere, built_in

pytest.importorskip("sphinx")
from optid.live.settings import _KEYS as LIVE_KEYS
from optid.rigs.channels import _KEYS as CHANNEL_KEYS
from optid.rigs.rigfile import TABLES
from studies.docs.extension import atlas
from studies.docs.extension.sessions import DOCS, commands_of, recorded, session_pages

ROOT = Path(__file__).resolve().parents[2]
FULL = os.environ.get("OPTID_FULL") == "1"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The built site; without figures and examples unless everything is asked for."""
    out = tmp_path_factory.mktemp("site")
    call = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-b",
        "html",
        "-d",
        str(out / "trees"),
    ]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **({} if FULL else {"OPTID_DOCS": "quick"})}
    done = subprocess.run(
        [*call, str(DOCS), str(out / "html")], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return out / "html"


class Page(HTMLParser):
    """What a page links to, and the places in it that can be linked to."""

    def __init__(self, text):
        super().__init__()
        self.links, self.ids = [], set()
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        own = dict(attributes)
        self.ids |= {own[key] for key in ("id", "name") if own.get(key)}
        self.links += [own[key] for key in ("href", "src") if own.get(key)]


def test_every_link_within_the_site_leads_somewhere(site):
    pages = {path: Page(path.read_text(encoding="utf-8")) for path in site.rglob("*.html")}
    broken = []
    for path, page in pages.items():
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme or parts.netloc or link.startswith("data:"):
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            place = unquote(parts.fragment)
            if not target.exists() or (place and target in pages and place not in pages[target].ids):
                broken.append((path.name, link))
    assert len(pages) > 60 and broken == []


def test_no_page_needs_the_network(site):
    for path in site.rglob("*.html"):
        links = Page(path.read_text(encoding="utf-8")).links
        assert [link for link in links if re.match(r"(https?:)?//.*\.(js|css|woff2?|png|svg)", link)] == [], (
            path.name
        )


def test_every_effect_has_a_page_with_all_it_says(site):
    names = {*built_in(), *anywhere()}
    for name in names:
        text = (site / "generated" / "atlas" / f"{name}.html").read_text(encoding="utf-8")
        for title in ("What it does to a record", "Smallest size worth a name", "Look-alikes"):
            assert title in text, name
        assert not FULL or f"{name}.png" in text, name


def test_no_figure_is_left_without_a_plant():
    """The text that stands for a figure is one; drawing puts the figure in its place."""
    assert all(
        text.count(atlas.NO_FIGURE) == 1
        for name, text in atlas.pages().items()
        if name[:-3] in atlas.effects()
    )


def lines_with_optid():
    """Every command line of optid that stands on a page of the site or in the README, with its page."""
    pages = [*DOCS.rglob("*.md"), ROOT / "README.md"]
    for page in (page for page in pages if "generated" not in page.relative_to(ROOT).parts):
        text = page.read_text(encoding="utf-8")
        blocks = re.findall(r"```(?:sh|\{session\})[^\n]*\n(.*?)```", text, re.S)
        for line in (line for block in blocks for line in block.splitlines()):
            for call in re.split(r"&&|#", line):
                if call.strip().startswith("optid "):
                    yield page.relative_to(ROOT).as_posix(), call.strip()


@pytest.mark.parametrize(("page", "line"), sorted(set(lines_with_optid())))
def test_a_command_line_is_one_that_the_parsers_take(page, line):
    name, *rest = shlex.split(line)[1:]
    context = cli.commands[name].make_context(name, rest, resilient_parsing=False)
    assert isinstance(context, click.Context)


def test_the_options_in_running_text_exist():
    commands = [
        one
        for command in cli.commands.values()
        for one in (command, *getattr(command, "commands", {}).values())
    ]
    known = {
        option
        for command in commands
        for parameter in command.get_params(click.Context(command))
        for option in (*parameter.opts, *parameter.secondary_opts)
    }
    foreign = {"--keep-going", "--count", "--seed", "--key", "--repeats", "--colour", "--plant", "--fast"}
    for page in (p for p in DOCS.rglob("*.md") if "generated" not in p.relative_to(DOCS).parts):
        for option in re.findall(r"(?<![\w-])--[a-z][a-z-]+", page.read_text(encoding="utf-8")):
            assert option in known | foreign, (page.name, option)


def test_every_command_of_the_pages_was_run():
    kept = recorded()
    for page in session_pages():
        name = page.relative_to(DOCS).with_suffix("").as_posix()
        assert [one["command"] for one in kept.get(name, ())] == commands_of(page), name


@pytest.mark.full
@pytest.mark.parametrize("page", session_pages(), ids=lambda page: page.stem)
def test_every_command_of_a_page_runs(page, tmp_path):
    from studies.docs.run_sessions import copy_beside, run_page

    copy_beside(page, tmp_path)
    assert run_page(page, tmp_path)


def test_the_rig_files_page_has_every_table_and_key():
    text = (DOCS / "reference" / "rigfile.md").read_text(encoding="utf-8")
    for key in (*LIVE_KEYS, *CHANNEL_KEYS):
        assert f"| `{key}` |" in text, key
    for table in TABLES:
        assert f"[{table}" in text or ("## name, model" in text and table in ("name", "model")), table


def test_a_notebook_keeps_no_output():
    for path in (DOCS / "notebooks").glob("*.ipynb"):
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        assert not [cell for cell in cells if cell.get("outputs")], path.name


def ends():
    """The last line of what each command of a job printed on the pages."""
    for page, runs in recorded().items():
        for one in runs:
            if one["command"].startswith("optid ") and one["output"]:
                yield page, one["command"], one["output"].splitlines()[-1]


def test_every_command_ends_with_the_next_one():
    jobs = set()
    for page, command, line in ends():
        name = shlex.split(command)[1]
        if name == "example":  # its last lines are calls and what they do
            continue
        following = shlex.split(line[line.index("optid ") :])
        assert cli.commands[following[1]].make_context(following[1], following[2:]), (page, command)
        jobs.add(name)
    assert jobs == {"check", "simulate", "fit", "diagnose", "plan", "identify", "tune", "live"}
