"""Every name has an answer: one that no file can have, and a file that has no end."""

import hashlib
import os
from pathlib import Path

import pytest

import optid
from optid.core.paths import digest_of, is_file, is_folder
from optid.datasets import example
from optid.errors import InputError
from optid.experiments.rivals import from_diagnosis
from optid.fleet.fleetfile import read_fleet

IMPOSSIBLE = ["n" * 300, "n/" * 3000, "a\0b"]


@pytest.mark.parametrize("name", IMPOSSIBLE, ids=["long", "long path", "null"])
def test_a_name_that_no_file_can_have_is_no_files(name):
    assert not is_file(name) and not is_folder(name)
    assert digest_of(name) is None


@pytest.mark.parametrize("name", IMPOSSIBLE, ids=["long", "long path", "null"])
@pytest.mark.parametrize("call", [optid.load, example, from_diagnosis], ids=lambda one: one.__name__)
def test_whoever_is_given_one_says_so(call, name):
    with pytest.raises(InputError):
        call(Path(name))


def test_a_fleet_file_with_one_is_refused_by_its_row(tmp_path):
    (tmp_path / "fleet.toml").write_text('[[rows]]\nrig = "a.toml"\ntrain = ["b\\u0000.csv"]\n')
    with pytest.raises(InputError, match="rows 1: train"):
        read_fleet(tmp_path / "fleet.toml")


def test_what_has_no_end_is_not_digested(tmp_path):
    if not os.path.exists("/dev/zero"):  # noqa: PTH110
        pytest.skip("no such device here")
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_bytes(b"x")
    assert digest_of("/dev/zero") is None
    assert digest_of(tmp_path / "pipe") is None
    assert digest_of(tmp_path / "file") == hashlib.sha256(b"x").hexdigest()
