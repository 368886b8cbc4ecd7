"""Rows: answered once, again where something changed, and by one worker at a time."""

import json
import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace

import pytest

from optid.errors import InputError, JobError
from optid.fleet import row
from optid.fleet.job import Job, Limits, inputs_of, key_of
from optid.fleet.row import answer, is_running, read_run
from optid.fleet.running import run_jobs

WRITES = """
out = words[words.index("--out") + 1]
with open(out + "/count", "a") as file:
    file.write("x")
"""


@pytest.fixture
def job(tmp_path):
    (tmp_path / "rig.toml").write_text('name = "a"\n')
    (tmp_path / "a.csv").write_text("t,u\n0,1\n")
    return Job("a", "check", str(tmp_path / "rig.toml"), (str(tmp_path / "a.csv"),))


def times(out, name="a"):
    return len((out / name / "count").read_text())


def test_a_row_is_answered_once(scripted, tmp_path, job):
    scripted(WRITES)
    first, second = (answer(job.document(), str(tmp_path / "out")) for _ in range(2))
    assert (first["fresh"], second["fresh"]) == (True, False)
    assert times(tmp_path / "out") == 1
    kept = json.loads((tmp_path / "out" / "a" / "run.json").read_text())
    assert kept["command"].startswith(f"optid check {job.rig} {job.train[0]} --out")
    assert not is_running(tmp_path / "out" / "a")


@pytest.mark.parametrize("change", ["rig", "recording", "options", "tags", "program", "version"])
def test_what_changed_is_done_again(scripted, tmp_path, job, change, monkeypatch):
    scripted(WRITES)
    plant = tmp_path / "plant.py"
    plant.write_text("x = 1\n")
    (tmp_path / "rig.toml").write_text('model = "plant.py:axis"\n')
    answer(job.document(), str(tmp_path / "out"))
    if change == "rig":
        (tmp_path / "rig.toml").write_text('model = "plant.py:axis"\nname = "b"\n')
    elif change == "recording":
        (tmp_path / "a.csv").write_text("t,u\n0,2\n")
    elif change == "program":
        plant.write_text("x = 2\n")
    elif change == "version":
        monkeypatch.setattr(row, "version", lambda: "other")
    else:
        job = replace(job, **{change: {"rate": "5"}})
    assert answer(job.document(), str(tmp_path / "out"))["fresh"]
    assert times(tmp_path / "out") == 2


def test_limits_change_no_answer(scripted, tmp_path, job):
    scripted(WRITES)
    answer(job.document(), str(tmp_path / "out"))
    more = replace(job, limits=Limits(deadline=7.0))
    assert not answer(more.document(), str(tmp_path / "out"))["fresh"]


def test_a_row_without_its_last_file_is_not_answered(scripted, tmp_path, job):
    scripted(WRITES)
    answer(job.document(), str(tmp_path / "out"))
    (tmp_path / "out" / "a" / "run.json").write_text("{", encoding="utf-8")
    assert read_run(tmp_path / "out" / "a") is None
    assert answer(job.document(), str(tmp_path / "out"))["fresh"]


def test_a_crash_is_tried_again_and_a_failure_is_not(scripted, tmp_path, job):
    scripted(WRITES + "os.abort() if len(open(out + '/count').read()) < 3 else None")
    twice = replace(job, limits=Limits(retries=2))
    assert answer(twice.document(), str(tmp_path / "out"))["outcome"] == "done"
    assert read_run(tmp_path / "out" / "a")["attempts"] == 3
    scripted(WRITES + "sys.exit(1)")
    assert answer({**twice.document(), "name": "b"}, str(tmp_path / "out"))["outcome"] == "failed"
    assert times(tmp_path / "out", "b") == 1


def test_two_workers_do_a_row_once(scripted, tmp_path, job):
    scripted("time.sleep(0.3)" + WRITES)
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda _: answer(job.document(), str(tmp_path / "out")), range(2)))
    assert sorted(one["fresh"] for one in found) == [False, True]
    assert times(tmp_path / "out") == 1


def test_any_executor_runs_jobs(scripted, tmp_path, job):
    scripted(WRITES)
    jobs = [replace(job, name=f"r{number}") for number in range(5)]
    with ThreadPoolExecutor(2) as pool:
        assert run_jobs(jobs, tmp_path / "out", executor=pool) == {"done": 5}
    assert all(json.loads(json.dumps(one.document())) for one in jobs)
    assert run_jobs(jobs, tmp_path / "out", workers=2) == {"done": 5}
    assert all(times(tmp_path / "out", one.name) == 1 for one in jobs)


class Loses(ThreadPoolExecutor):
    """An executor whose workers die `times` times before a job is through."""

    def __init__(self, times):
        super().__init__(1)
        self.times = times

    def submit(self, function, *args):
        if self.times:
            self.times -= 1
            future = Future()
            future.set_exception(OSError("the worker died"))
            return future
        return super().submit(function, *args)


@dataclass(frozen=True, eq=False)
class QueueJob:
    """What submitit gives back for a job, as far as it is used."""

    done: Callable[[], bool]
    result: Callable[[], object]


class Queue:
    """As submitit has it: its jobs are no futures, they can only be asked whether they are done."""

    def __init__(self):
        self.pool = ThreadPoolExecutor(1)

    def submit(self, function, *args):
        future = self.pool.submit(function, *args)
        return QueueJob(future.done, future.result)


def test_jobs_that_are_no_futures_are_waited_for(scripted, tmp_path, job):
    scripted(WRITES)
    jobs = [job, replace(job, name="b")]
    assert run_jobs(jobs, tmp_path / "out", executor=Queue()) == {"done": 2}


def test_relative_paths_start_at_the_current_folder(tmp_path, job, monkeypatch):
    monkeypatch.chdir(tmp_path)
    relative = Job("a", "check", "rig.toml", ("a.csv",), holdout=("b/b.csv",))
    assert relative.rig == job.rig
    assert relative.train == job.train
    assert relative.holdout == (str(tmp_path / "b" / "b.csv"),)


def test_a_lost_job_is_given_again(scripted, tmp_path, job):
    scripted(WRITES)
    with Loses(2) as pool:
        assert run_jobs([job], tmp_path / "out", executor=pool) == {"done": 1}
    with Loses(3) as pool:
        assert run_jobs([replace(job, name="b")], tmp_path / "out", executor=pool) == {"lost": 1}


def test_a_lost_scheduler_is_said(tmp_path, job, monkeypatch):
    monkeypatch.setattr("optid.fleet.running.LOOK", 0.05)

    class Gone(ThreadPoolExecutor):
        is_lost = True

        def submit(self, function, *args):
            return Future()

    with Gone(1) as pool, pytest.raises(JobError, match="scheduler is lost"):
        run_jobs([job], tmp_path / "out", executor=pool)


def test_names_are_unique(scripted, tmp_path, job):
    scripted(WRITES)
    with pytest.raises(InputError, match="two jobs have this name"):
        run_jobs([job, job], tmp_path / "out", workers=1)


def test_the_key_is_of_content_not_of_time(job):
    one = key_of(job, inputs_of(job), "1")
    os.utime(job.train[0], (1, 1))
    assert key_of(job, inputs_of(job), "1") == one
