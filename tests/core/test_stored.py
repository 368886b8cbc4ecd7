"""Machine code is kept between runs: made once, made anew where its file is damaged or what it depends on differs."""

import os
import stat
from pathlib import Path

import numpy as np
import pytest

from optid.core import cache
from optid.core import jit as module
from optid.core.jit import compiled, compiled_lanes, compiled_runs
from optid.core.simulation import simulate
from optid.rigs.rigfile import read_rig

DATA = Path(__file__).parents[2] / "data"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr(cache, "kernels_folder", lambda: tmp_path)
    return tmp_path / "models"


def made(counted):
    counted.append(1)
    return b"code"


def test_made_once(folder):
    counted = []
    assert [cache.stored("key", lambda: made(counted)) for _ in range(3)] == [b"code"] * 3
    assert len(counted) == 1
    cache.stored("another", lambda: made(counted))
    assert len(counted) == len(list(folder.iterdir())) == 2


@pytest.mark.parametrize("damage", [b"", b"short", bytes(40)])
def test_a_damaged_file_is_made_anew(folder, damage):
    counted = []
    cache.stored("key", lambda: made(counted))
    next(folder.iterdir()).write_bytes(damage)
    assert cache.stored("key", lambda: made(counted)) == b"code"
    assert cache.stored("key", lambda: made(counted)) == b"code"
    assert len(counted) == 2


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_done_without(folder):
    folder.parent.chmod(stat.S_IRUSR | stat.S_IXUSR)
    assert cache.stored("key", lambda: b"code") == b"code"


def test_a_file_where_the_folder_should_be_is_done_without(folder):
    folder.write_text("in the way")
    assert cache.stored("key", lambda: b"code") == b"code"
    assert folder.read_text() == "in the way"


def test_the_older_half_goes_when_there_are_too_many(folder, monkeypatch):
    monkeypatch.setattr(cache, "MOST", 10)
    for k in range(11):
        cache.stored(f"key {k}", lambda: b"code")
        os.utime(max(folder.iterdir(), key=lambda one: one.stat().st_ctime_ns), (k, k))
    cache.stored("last", lambda: b"code")
    assert len(list(folder.iterdir())) == 7
    counted = []
    cache.stored("key 10", lambda: made(counted))
    cache.stored("key 0", lambda: made(counted))
    assert len(counted) == 1


def test_a_model_from_the_cache_runs_as_one_compiled_afresh(folder, monkeypatch):
    rig = read_rig(DATA / "table1.toml")
    p, start = rig.model.vector(rig.parameters), np.array([[0.0, 0.0, 3e5, 3e5, 0.0]])
    u, dt = np.full((400, 1), 0.3), np.full(400, 1e-3)

    def run():
        compiled_runs.cache_clear()
        return simulate(rig.model, p, start, dt, u).outputs

    fresh = run()
    assert len(list(folder.iterdir())) == 1
    monkeypatch.setattr(module, "object_code", lambda text: pytest.fail("compiled again"))
    np.testing.assert_array_equal(run(), fresh)
    compiled_runs.cache_clear()


def test_what_is_asked_of_a_model_is_kept_apart(folder):
    """The same equations with other slopes, or for other loops, are other code."""
    model = read_rig(DATA / "table1.toml").model
    for asked in (
        lambda: compiled(model),
        lambda: compiled(model, (0,)),
        lambda: compiled(model, (1,)),
        lambda: compiled_runs(model),
        lambda: compiled_lanes(model),
    ):
        asked()
    assert len(list(folder.iterdir())) == 5
