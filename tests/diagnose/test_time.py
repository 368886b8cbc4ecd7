"""How long a search goes on: as its time allows, and not as long where it has explained little."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from optid.diagnose import search as searching
from optid.diagnose.candidate import Data, fit_base
from optid.diagnose.search import explains_little, search
from tests.diagnose.trolley import SD, recording, rig


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    """A trolley whose command saturates."""
    runs = [recording(seed, f"run_{seed}", lambda u: np.clip(u, -0.5, 0.5)) for seed in (1, 2, 3)]
    data = Data(tuple(runs[:2]), (runs[2],), {"position": SD}, np.random.default_rng(0))
    return fit_base(rig(tmp_path_factory.mktemp("bent")), data, lambda share, words: None), data


def test_what_clears_less_than_it_leaves_explains_little(bent):
    base, data = bent

    def leaving(share):
        scores = {role: replace(s, rmse=s.rmse * math.sqrt(share)) for role, s in base.judged.scores.items()}
        return replace(base, judged=replace(base.judged, scores=scores))

    assert explains_little(base, base, data)
    assert explains_little(base, leaving(0.6), data)
    assert not explains_little(base, leaving(0.4), data)


def test_a_search_that_has_explained_nothing_ends_soon(bent):
    base, data = bent
    over = replace(data, soon=time.monotonic() - 1.0)
    found = search(base, (), over, lambda share, words: None)
    assert found.stopped and found.best is base


def test_one_that_has_explained_most_goes_on(bent, monkeypatch):
    base, data = bent
    monkeypatch.setattr(searching, "explains_little", lambda *_: False)
    over = replace(data, soon=time.monotonic() - 1.0)
    found = search(base, (), over, lambda share, words: None)
    assert not found.stopped and [effect.name for effect in found.best.effects] == [
        "saturation@drive.command"
    ]
