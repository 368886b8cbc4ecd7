"""The directive `session`: command lines of a page, and what each printed when it was last run.

    python studies/docs/run_sessions.py    runs all, page after page, and writes sessions.json anew

.ci/full does so as well. A command that is not in the file, or differs from it, fails the build.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

DOCS = Path(__file__).resolve().parents[1]
RECORD = DOCS / "sessions.json"
BLOCK = re.compile(r"^```\{session\}[^\n]*\n(.*?)^```", re.M | re.S)


def commands_of(page: Path) -> list[str]:
    """The command lines of a page, in order."""
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [line for block in blocks for line in block.splitlines() if line and not line.startswith(":")]


def session_pages() -> list[Path]:
    """The pages that have any."""
    pages = (p for p in sorted(DOCS.rglob("*.md")) if "generated" not in p.relative_to(DOCS).parts)
    return [page for page in pages if commands_of(page)]


def recorded() -> dict[str, list[dict[str, Any]]]:
    """Page -> its commands, each with `command`, `status`, `output` and `seconds`."""
    if not RECORD.is_file():
        return {}
    found: dict[str, list[dict[str, Any]]] = json.loads(RECORD.read_text(encoding="utf-8"))
    return found


class Session(SphinxDirective):
    """Command lines, one a line; `:quiet:` shows no output."""

    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {"quiet": lambda _: True}

    def run(self) -> list[nodes.Node]:
        """A literal block of commands with their output."""
        runs = {one["command"]: one for one in recorded().get(self.env.docname, ())}
        lines = []
        for command in (line for line in self.content if line.strip()):
            lines.append(f"$ {command}")
            if command not in runs:
                logging.getLogger(__name__).warning(
                    f"never run: {command}; python studies/docs/run_sessions.py", location=self.get_location()
                )
            elif "quiet" not in self.options and (self.env.docname == "start" or " example " not in command):
                lines += [f"{line}" for line in runs[command]["output"].splitlines()]
        block = nodes.literal_block("\n".join(lines), "\n".join(lines))
        block["language"] = "console"
        block["classes"] = ["session"]
        return [block]
