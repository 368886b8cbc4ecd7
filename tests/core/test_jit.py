"""Code is compiled once for equations that are the same, and stays in memory while it runs."""

import gc
import threading
import time
import weakref
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np
import pytest

from optid.core import jit as module
from optid.core import simulation
from optid.core.jit import compiled, compiled_lanes, compiled_runs
from optid.core.parameter import Parameter
from optid.core.recording import Channel, Recording
from optid.core.sheet import build
from optid.core.simulation import simulate
from optid.estimation import likelihood
from optid.estimation.likelihood import run_filter, run_fixed_gain_filter
from optid.estimation.problem import build_problem
from tests.core.test_simulation import decay


def others(count):
    """Models of as many kinds."""

    def one(power):
        def drag(s):
            x = s.state("x", "m", 1.0)
            rate = s.param(Parameter("rate", "1/s", 3.0, "of the decay", "a test", bounds=(0.0, 100.0)))
            s.rate(x, s.input("push", "1") - rate * x**power)
            s.output("position", "m", x)

        return build(drag)

    return [one(power) for power in range(1, count + 1)]


def test_equal_equations_are_compiled_once(monkeypatch):
    one, same = build(decay), build(decay)
    assert one != same
    assert compiled(one) is compiled(one)
    assert compiled(one, (0,)).engine is not compiled(one).engine
    monkeypatch.setattr(module, "object_code", lambda text: pytest.fail("compiled again"))
    assert compiled(same) is not compiled(one)


def test_who_asks_for_a_model_that_is_being_compiled_waits_for_it(monkeypatch, tmp_path):
    calls, code = [], module.object_code

    def slowly(text):
        calls.append(text)
        time.sleep(0.1)
        return code(text)

    monkeypatch.setattr(module, "object_code", slowly)
    monkeypatch.setattr("optid.core.cache.kernels_folder", lambda: tmp_path)
    model = build(decay)
    threads = [threading.Thread(target=compiled, args=(model, (0,))) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(calls) == 1


def simulated(model):
    return simulate(model, np.array([3.0]), np.zeros(1), np.full(2000, 1e-3), np.ones((2000, 1))).states[
        0, -1, 0
    ]


def filtered(model):
    time = 1e-3 * np.arange(2000)
    channels = {
        role: Channel(role, role, unit, np.sin(time)) for role, unit in (("push", "1"), ("position", "m"))
    }
    problem = build_problem(model, [Recording("sine", time, channels)], 10.0)
    p, Q, R = np.array([[3.0]]), np.array([[1e-4]]), np.array([[1e-4]])
    f = run_filter(model, problem, p, Q, R, keep=True)
    return f.innovations[0, -1, 0], run_fixed_gain_filter(model, problem, p, f, [0])[0, -1, 0]


@pytest.mark.parametrize(
    ("asked", "cache", "module", "name"),
    [
        (simulated, compiled_runs, simulation.kernel, "simulate"),
        (filtered, compiled_lanes, likelihood.kernel, "filtered"),
        (filtered, compiled_lanes, likelihood.kernel, "fixed_gain"),
    ],
)
def test_code_stays_while_it_runs_though_the_cache_lets_it_go(asked, cache, module, name, monkeypatch):
    """Who keeps the addresses alone runs into memory that is no longer its own."""
    (model,), seen = others(1), []
    engine = weakref.ref(cache(model).engine)

    def run(*arguments):
        cache.cache_clear()
        gc.collect()
        seen.append(engine() is not None)

    monkeypatch.setattr(module, name, run)
    asked(model)
    assert seen
    assert all(seen)


@pytest.mark.parametrize("asked", [simulated, filtered])
def test_many_models_run_at_once_through_a_cache_that_holds_one(asked, monkeypatch):
    monkeypatch.setattr(simulation, "compiled_runs", lru_cache(maxsize=1)(compiled_runs.__wrapped__))
    monkeypatch.setattr(likelihood, "compiled_lanes", lru_cache(maxsize=1)(compiled_lanes.__wrapped__))
    models = others(5)
    alone = [asked(model) for model in models]
    assert len(set(alone)) == len(models)
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(asked, models * 20)) == alone * 20
