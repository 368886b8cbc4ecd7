"""Caches heal: a damaged file, a folder that refuses or no home at all cost time, never a result."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from optid.core import cache
from optid.core import jit_cache as compiling

PROGRAM = """
import json, sys
from optid.core import cache
told = []
cache.first_compile(lambda: told.append(1))
from optid.core.jit_cache import kept

@kept()
def twice(x):
    return 2 * x

print(json.dumps([twice(21), twice(0.5), len(told), str(cache.cache_folder())]))
"""


def run(tmp_path, **environment):
    """What the program above printed: its results, whether something was compiled, and the folder."""
    (tmp_path / "program.py").write_text(PROGRAM)
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), **environment}
    done = subprocess.run(
        [sys.executable, tmp_path / "program.py"],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    *results, told, folder = json.loads(done.stdout)
    assert results == [42, 1.0]
    return bool(told), folder


def compiles(folder, monkeypatch):
    """Does a fresh start of the function find nothing that it can use?"""
    told = []
    cache.first_compile(lambda: told.append(1))
    monkeypatch.setattr(compiling, "kernels_folder", lambda: folder)
    assert compiling.kept()(twice)(21) == 42
    return bool(told)


def twice(x):
    return 2 * x


def test_a_function_is_compiled_once_and_every_damage_heals(tmp_path, monkeypatch):
    assert compiles(tmp_path, monkeypatch)
    assert not compiles(tmp_path, monkeypatch)
    files = sorted(tmp_path.iterdir())
    assert [file.suffix for file in files] == [".nbc", ".nbi", ".sum"]
    for file in files:
        content = file.read_bytes()
        for damage in (b"", content[: len(content) // 2], b"\x80" + content[1:] + b"x"):
            file.write_bytes(damage)
            assert compiles(tmp_path, monkeypatch)
            assert not compiles(tmp_path, monkeypatch)
        file.unlink()
        assert compiles(tmp_path, monkeypatch)


def test_a_folder_that_cannot_be_is_done_without(tmp_path, monkeypatch):
    (tmp_path / "cache").write_text("a file in the way")
    assert compiles(tmp_path / "cache" / "inner", monkeypatch)
    assert (tmp_path / "cache").read_text() == "a file in the way"


def test_without_a_home_nothing_is_kept(tmp_path):
    nobody = {"XDG_CACHE_HOME": "", "HOME": "/dev/null/home"}
    told, folder = run(tmp_path, **nobody)
    assert told
    assert folder.startswith("/dev/null")


@pytest.mark.parametrize("stated", ["", "relative/path"])
def test_only_an_absolute_place_is_taken_from_the_environment(stated, monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_CACHE_HOME", stated)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache.cache_folder().is_relative_to(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "there"))
    assert cache.cache_folder() == tmp_path / "there" / "optid"


def test_no_name_in_the_user_database_is_done_without(monkeypatch):
    def nobody(*_):
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(cache.platformdirs, "user_cache_dir", nobody)
    assert cache.cache_folder() is None
    monkeypatch.setattr(cache, "kernels_folder", lambda: None)
    assert cache.stored("key", lambda: b"made") == b"made"
    assert compiling.kept()(lambda x: x + 1)(2) == 3


def test_a_full_disk_leaves_no_half_file(monkeypatch, tmp_path):
    monkeypatch.setattr(cache, "kernels_folder", lambda: tmp_path)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cache.Path, "replace", full)
    assert cache.stored("key", lambda: b"made") == b"made"
    assert list((tmp_path / "models").iterdir()) == []


@pytest.mark.parametrize("changed", ["loops.py", "laws/friction.py", "laws/__init__.py"])
def test_code_is_made_anew_when_what_it_imports_changes(changed, tmp_path, monkeypatch):
    package = tmp_path / "optid"
    (package / "laws").mkdir(parents=True)
    monkeypatch.setattr(cache, "__file__", str(package / "core" / "cache.py"))
    (package / "loops.py").write_text("from optid.laws import (\n    friction,\n)\n")
    (package / "laws" / "__init__.py").write_text("")
    (package / "laws" / "friction.py").write_text("STRIBECK = 0.01\n")
    (package / "page.py").write_text("from optid import loops\n")
    digest = cache.sources.__wrapped__
    before = digest(package / "loops.py")
    (package / "page.py").write_text("title = 'a page'\n")
    assert digest(package / "loops.py") == before
    (package / changed).write_text("STRIBECK = 0.02\n")
    assert digest(package / "loops.py") != before


def test_each_signature_has_files_of_its_own(monkeypatch, tmp_path):
    """Two processes that compile two signatures at once must not write one file."""
    monkeypatch.setattr(compiling, "kernels_folder", lambda: tmp_path)

    @compiling.kept()
    def total(x):
        return x.sum()

    total(np.ones(3))
    total(np.ones(3, dtype=np.int64))
    assert len(list(tmp_path.glob("*.nbc"))) == len(list(tmp_path.glob("*.nbi"))) == 2
