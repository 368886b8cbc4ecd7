"""A diagnosis that is killed by the system goes on at its last stage, with the same answer."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

DATA = Path(__file__).parents[1] / "data"


def diagnose(out, cache, until=""):
    """Run `optid diagnose` on the worn bench; kill it as soon as its progress says `until`. Returns what it said."""
    files = [str(DATA / name) for name in ("bench.toml", "worn.csv")]
    call = [
        sys.executable,
        "-m",
        "optid.cli",
        "diagnose",
        *files,
        "--holdout",
        str(DATA / "worn_holdout.csv"),
    ]
    said = []
    with subprocess.Popen(
        [*call, "--out", str(out), "--progress", "json"],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env=dict(os.environ, XDG_CACHE_HOME=str(cache)),
    ) as process:
        for line in process.stderr:
            said.append(line)
            if until and until in line:
                process.send_signal(signal.SIGKILL)
                break
        said += process.stderr
    assert process.returncode == (-signal.SIGKILL if until else 0), said
    return "".join(said)


def answer(out):
    """What the diagnosis says, without times and places."""
    document = json.loads((out / "diagnosis.json").read_text())
    return {key: document[key] for key in ("verdict", "summary", "findings", "test")}


@pytest.mark.full
@pytest.mark.skipif(os.name != "posix", reason="SIGKILL is POSIX's")
def test_a_killed_diagnosis_goes_on_with_the_same_answer(tmp_path):
    diagnose(tmp_path / "whole", tmp_path / "cache")
    killed = tmp_path / "killed"
    diagnose(killed, tmp_path / "cache", until="ranking the effects")  # after the base fit
    assert "fitting the base model" not in diagnose(killed, tmp_path / "cache", until="maximum likelihood")
    assert "ranking the effects" not in diagnose(killed, tmp_path / "cache")
    assert answer(killed) == answer(tmp_path / "whole")
