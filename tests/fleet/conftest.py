"""Jobs that take no time: the process of a job is a script of the test's own instead of optid's command line."""

import sys
import textwrap

import pytest

from optid.fleet import process


@pytest.fixture
def scripted(monkeypatch, tmp_path):
    """Have jobs run a script, bounded as ever; it is given what stands behind `optid`."""

    def use(body: str) -> None:
        script = tmp_path / "job.py"
        script.write_text(
            "import os, sys, time\n"
            "from optid.fleet.bounds import bound, die_with\n"
            "memory, seconds, parent = int(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])\n"
            "die_with(parent)\n"
            "bound(memory, seconds)\n"
            "words = sys.argv[4:]\n" + textwrap.dedent(body),
            encoding="utf-8",
        )
        monkeypatch.setattr(process, "PROGRAM", (sys.executable, str(script)))
        # For workers that are processes of their own.
        (tmp_path / "preload.py").write_text(
            f"from optid.fleet import process\nprocess.PROGRAM = {process.PROGRAM!r}\n", encoding="utf-8"
        )

    return use
