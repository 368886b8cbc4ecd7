"""Cycles over short and whole windows: they go on while they pay, and never make a fit worse."""

from types import SimpleNamespace

import pytest

from optid.diagnosis import fitted
from optid.diagnosis.base_fit import fit_base
from optid.diagnosis.criteria import SearchOptions
from optid.diagnosis.fitted import alternate_horizons
from optid.errors import SolveError
from tests.diagnosis.trolley import TRUTH, problem_of, recording


@pytest.mark.parametrize(
    ("later", "ends", "fits"),
    [
        ([50.0, 49.9, 10.0], 49.9, 2),  # 0.2 % do not pay
        ([120.0, 10.0], 100.0, 1),
        ([80.0, 60.0, 40.0, 20.0, 10.0], 20.0, SearchOptions().turns),
        ([60.0, None, 10.0], 60.0, 2),  # diverged
    ],
)
def test_cycles_go_on_while_each_lowers_the_loss(monkeypatch, later, ends, fits):
    left, asked = list(later), []

    def model(loss):
        fit = SimpleNamespace(loss=loss, level=-2.0)
        return SimpleNamespace(effects=(), rig=None, likelihood_problem=None, p=loss, fit=fit)

    def fit_model(problem, effects, rig, q, p, **how):
        asked.append((p, how["short"]))
        if (loss := left.pop(0)) is None:
            raise SolveError("diverged")
        return model(loss)

    monkeypatch.setattr(fitted, "fit_model", fit_model)
    problem = SimpleNamespace(options=SearchOptions(), budget=SimpleNamespace(is_over=False))
    assert alternate_horizons(model(100.0), problem).fit.loss == ends
    assert len(asked) == fits and all(short for _, short in asked)
    assert [p for p, _ in asked] == [100.0, *later[: fits - 1]]  # each begins where the one before it ended


def test_a_fit_at_its_optimum_stays_there(tmp_path):
    base, problem = fit_base(problem_of(tmp_path, [recording(s, f"{s}.csv") for s in (1, 2)]))
    again = alternate_horizons(base, problem)
    assert again.fit.loss <= base.fit.loss
    for name, value in TRUTH.items():
        assert again.values[name] == pytest.approx(value, rel=0.01)
