"""A job's process: what it exceeds ends it, and nothing it started stays."""

import os
import time

import psutil
import pytest

from optid.fleet.job import Limits
from optid.fleet.process import Outcome, Stopped, bounded, start_again, stop_all, supervise

MANY = 2**30


def ended(tmp_path, **limits):
    asked = Limits(**{"memory": MANY, "time_limit": 60.0, "deadline": 60.0, **limits})
    return supervise(bounded(["word"], asked), asked, tmp_path)


@pytest.mark.parametrize(
    ("status", "outcome"),
    [(0, Outcome.DONE), (1, Outcome.FAILED), (2, Outcome.BAD_INPUT), (77, Outcome.CRASHED)],
)
def test_exit_status_is_the_outcome(scripted, tmp_path, status, outcome):
    scripted(f"print('last', words[0]); sys.exit({status})")
    found = ended(tmp_path)
    assert (found.outcome, found.status, found.said) == (outcome, status, "last word")


def test_a_crash_is_an_outcome(scripted, tmp_path):
    scripted("os.abort()")
    assert ended(tmp_path).outcome is Outcome.CRASHED


def test_the_clock_ends_a_job_that_sleeps(scripted, tmp_path):
    scripted("time.sleep(60)")
    found = ended(tmp_path, deadline=0.4)
    assert found.outcome is Outcome.TIMED_OUT
    assert found.seconds < 20.0


def test_its_own_time_ends_a_job_that_computes(scripted, tmp_path):
    scripted("while True: pass")
    assert ended(tmp_path, time_limit=0.3).outcome is Outcome.TIMED_OUT


def test_memory_that_is_held_ends_a_job(scripted, tmp_path):
    scripted("held = bytearray(400_000_000)\nheld[::4096] = b'x' * len(held[::4096])\ntime.sleep(60)")
    found = ended(tmp_path, memory=200_000_000)
    assert found.outcome is Outcome.OUT_OF_MEMORY
    assert found.memory > 200_000_000


def test_memory_that_is_refused_is_out_of_memory(scripted, tmp_path):
    scripted("bytearray(10_000_000_000)")
    assert ended(tmp_path, memory=200_000_000).outcome is Outcome.OUT_OF_MEMORY


def test_what_a_job_started_ends_with_it(scripted, tmp_path):
    scripted(
        """
        import subprocess
        left = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
        print(left.pid, flush=True)
        """
    )
    number = int(ended(tmp_path).said)
    until = time.monotonic() + 10.0
    while psutil.pid_exists(number) and psutil.Process(number).status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < until, "it lives on"
        time.sleep(0.02)


def test_threads_are_bounded(scripted, tmp_path):
    scripted("print(os.environ['OPTID_THREADS'], os.environ['OPENBLAS_NUM_THREADS'])")
    assert ended(tmp_path, threads=3).said == "3 3"


def test_a_stopped_fleet_begins_nothing(scripted, tmp_path):
    scripted("print('ran')")
    stop_all()
    try:
        with pytest.raises(Stopped):
            ended(tmp_path)
    finally:
        start_again()


def test_a_job_ends_when_its_worker_is_killed(scripted, tmp_path):
    scripted("print('begun', flush=True); time.sleep(600)")
    begun, worker = tmp_path / "process", os.fork()
    if worker == 0:
        try:
            supervise(bounded([], Limits()), Limits(), tmp_path, begun)
        finally:
            os._exit(1)
    until = time.monotonic() + 20.0
    while not (begun.is_file() and begun.read_text()):
        assert time.monotonic() < until
        time.sleep(0.02)
    job = psutil.Process(int(begun.read_text().split()[0]))
    time.sleep(0.5)  # it asks the kernel for this as the first thing it does
    os.kill(worker, 9)
    os.waitpid(worker, 0)
    job.wait(10.0)
