"""How long a search goes on, and what is looked at beside it."""

import math
import time
from dataclasses import replace

import numpy as np
import pytest

from optid.diagnosis import search as searching
from optid.diagnosis.candidate import Data, fit_base
from optid.diagnosis.search import explains_little, search
from tests.diagnosis.trolley import SD, recording, rig


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


def test_a_search_whose_time_is_over_names_nothing(bent):
    base, data = bent
    found = search(base, (), replace(data, until=time.monotonic() - 1.0), lambda share, words: None)
    assert found.stopped and found.best is base


@pytest.mark.parametrize("stands", [True, False])
def test_what_may_describe_it_is_looked_at_once_where_one_effect_does_not_stand(bent, monkeypatch, stands):
    """Before a second one is looked for, which takes long."""
    base, data = bent
    won = search(base, (), data, lambda share, words: None).rounds[0].winner
    assert won.effect.name == "saturation@drive.command"
    said, asked = [], []
    same = searching._Look((), (), base.answer, (won,))
    monkeypatch.setattr(searching, "_round", lambda *_, **__: same)
    monkeypatch.setattr(searching, "stands", lambda *_: stands)
    monkeypatch.setattr(searching, "excess", lambda *_: 2.0)  # something is left
    monkeypatch.setattr(searching, "_little_left", lambda *_: False)
    search(base, (), data, lambda share, words: said.append(words), lambda: asked.append(said[-1]))
    assert "round 4: screening the catalogue" in said
    assert asked == ([] if stands else ["round 2: screening the catalogue"])
