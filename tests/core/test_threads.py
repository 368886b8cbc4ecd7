"""Work on all cores is done once, in its order, at once, and does not wait for itself."""

import gc
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from optid.core import threads
from optid.core.threads import parallel_for, parallel_map


@pytest.fixture(params=[1, 2, 3])
def cores(request, monkeypatch):
    monkeypatch.setattr(threads, "WORKERS", request.param)
    for pool in (threads._kernels, threads._searches):
        pool.cache_clear()
    yield request.param
    for pool in (threads._kernels, threads._searches):
        pool().shutdown(wait=False, cancel_futures=True)  # what waits for itself would wait on
        pool.cache_clear()


@pytest.mark.parametrize("grain", [1, 4])
@pytest.mark.parametrize("count", [0, 1, 7, 64])
def test_a_spread_covers_all_once(cores, count, grain):
    seen = []
    parallel_for(count, lambda first, last: seen.append((first, last)), grain)
    assert sorted(i for first, last in seen for i in range(first, last)) == list(range(count))
    assert all(first % grain == 0 for first, _ in seen)


def test_results_come_in_the_order_of_what_was_asked(cores):
    assert parallel_map(lambda x: x * x, range(20)) == [x * x for x in range(20)]


def test_as_many_work_at_a_time_as_there_are_cores(cores):
    """They would wait for each other in vain if they came one after the other."""
    meeting = threading.Barrier(cores)
    assert parallel_map(lambda _: meeting.wait(timeout=10.0) >= 0, range(cores)) == [True] * cores


def test_the_first_that_fails_says_so(cores):
    with pytest.raises(ZeroDivisionError):
        parallel_map(lambda x: 1 / x, [2, 1, 0, 3])


def test_what_works_together_may_call_for_more_of_it(cores):
    """More than there are threads, so that they would all wait for one that none of them can begin."""

    def outer(x):
        parallel_for(8, lambda first, last: None)
        return sum(parallel_map(lambda y: x * y, range(5)))

    done = []
    thread = threading.Thread(target=lambda: done.extend(parallel_map(outer, range(8))), daemon=True)
    thread.start()
    thread.join(timeout=10.0)
    assert done == [10 * x for x in range(8)]


def test_symbolic_work_is_never_in_two_threads_at_once_nor_while_garbage_is_collected():
    inside, most, collecting = [], [], []

    @threads.one_at_a_time
    def build(number):
        inside.append(number)
        most.append(len(inside))
        collecting.append(gc.isenabled())
        time.sleep(0.01)
        inside.remove(number)
        return number

    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(build, range(8))) == list(range(8))
    assert max(most) == 1
    assert not any(collecting)
    assert gc.isenabled()


def test_a_builder_may_build_and_may_fail():
    @threads.one_at_a_time
    def build(depth):
        if depth:
            return build(depth - 1)
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        build(2)
    assert gc.isenabled()
