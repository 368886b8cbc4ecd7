"""A real Dask cluster on this machine: a scheduler and two workers as processes, some of which are killed."""

import threading
import time

import pytest

pytest.importorskip("distributed")

from optid.errors import InputError, JobError
from optid.fleet import cluster
from optid.fleet.cluster import connected, is_open
from optid.fleet.job import Job
from optid.fleet.running import run_jobs
from studies.plant.cluster import Cluster, kill

SLOW = """
out = words[words.index("--out") + 1]
open(out + "/begun", "a").write(f"{os.getpid()}\\n")
time.sleep(0.4)
open(out + "/count", "a").write("x")
"""


def jobs(tmp_path, count):
    (tmp_path / "rig.toml").write_text('name = "a"\n')
    return [Job(f"r{n}", "check", str(tmp_path / "rig.toml"), ("none.csv",)) for n in range(count)]


def begun(out, count):
    until = time.monotonic() + 60.0
    while len(list(out.glob("*/begun"))) < count:
        assert time.monotonic() < until
        time.sleep(0.02)


def often_begun(out, name):
    return len((out / name / "begun").read_text().split())


def test_workers_and_schedulers_are_killed_and_no_row_is_lost_or_done_twice(scripted, tmp_path):
    scripted(SLOW)
    todo, out, counts = jobs(tmp_path, 8), tmp_path / "out", []
    with Cluster(tmp_path, preload=tmp_path / "preload.py") as here:

        def client():
            with connected(here.address) as executor:
                try:
                    counts.append(run_jobs(todo, out, executor=executor))
                except JobError as error:
                    counts.append(str(error))

        first = threading.Thread(target=client)
        first.start()
        begun(out, 2)
        kill(here.workers.pop(0))
        here.add_worker()
        begun(out, 5)
        kill(here.scheduler)
        first.join(60.0)
        here.start()
        done = {place.parent.name: place.stat().st_mtime_ns for place in out.glob("*/run.json")}
        client()
    assert "the scheduler is lost" in counts[0]
    assert counts[1] == {"done": 8}
    assert {name: (out / name / "run.json").stat().st_mtime_ns for name in done} == done
    often = [(out / job.name / "count").read_text() for job in todo]
    assert all(often)
    # A job that was killed between its last line and its mark is done once more: at most the three that ran then.
    assert sum(len(marks) > 1 for marks in often) <= 3
    assert all((out / name / "count").read_text() == "x" for name in done if often_begun(out, name) == 1)


def test_nobody_answers(monkeypatch):
    monkeypatch.setattr(cluster, "PATIENCE", 0.5)
    with pytest.raises(InputError, match="no scheduler responds"), connected("tcp://127.0.0.1:9"):
        pass


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("tcp://head:8786", True),
        ("tcp://10.0.0.1:8786", True),
        ("tls://head:8786", False),
        ("tcp://127.0.0.1:8786", False),
        ("tcp://localhost:8786", False),
        ("tcp://[::1]:8786", False),
    ],
)
def test_what_others_can_reach_is_told(address, told):
    assert is_open(address) is told
