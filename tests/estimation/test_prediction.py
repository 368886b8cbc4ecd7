"""Prediction by windows: nothing of a window, and nothing after it, is in its start."""

from dataclasses import replace

import numpy as np
import pytest

from optid.core.simulation import simulate
from optid.estimation import moving_horizon
from optid.estimation.moving_horizon import predict_windows
from optid.estimation.objective import objective_of
from optid.estimation.prediction import PROCESS_NOISE, predict
from optid.estimation.problem import build_problem
from optid.estimation.result import Score
from tests.estimation.cart import RATE, SD, TRUTH, moved, record, recording, rig

WINDOW = round(0.5 * RATE)


@pytest.fixture
def cart(tmp_path):
    return rig(tmp_path, gain=TRUTH["gain"], drag=TRUTH["drag"])


def test_a_window_knows_the_past_only(cart):
    data = recording(np.random.default_rng(1), seconds=4.0)
    x, u = np.array(data["position"].values), data["command"].values
    before = predict(cart, data).frame["position_window"].to_numpy()
    begin = int(np.round(np.linspace(0, len(x) - 1, 9))[4])
    spoilt = x.copy()
    spoilt[begin:] += np.random.default_rng(2).normal(0.0, 0.05, len(x) - begin)
    after = predict(cart, record(u, spoilt)).frame["position_window"].to_numpy()
    seen = slice(0, begin + WINDOW - 2)
    assert np.array_equal(after[seen], before[seen], equal_nan=True)
    assert not np.allclose(after[begin + WINDOW + 2 :], before[begin + WINDOW + 2 :], atol=1e-3)
    # One sample earlier is the past, and counts.
    spoilt = x.copy()
    spoilt[begin - 1] += 0.05
    after = predict(cart, record(u, spoilt)).frame["position_window"].to_numpy()
    assert not np.array_equal(after[begin : begin + 20], before[begin : begin + 20])


def test_the_first_window_has_no_past(cart):
    data = recording(np.random.default_rng(3), seconds=4.0)
    frame = predict(cart, data).frame
    known = frame["position_window"].notna().to_numpy()
    assert known[WINDOW:].all()
    assert not known[: WINDOW - 1].any()
    assert frame["position_free_run"].notna().all()


def test_both_kinds_are_as_good_as_the_noise_at_the_truth(cart):
    found = predict(cart, recording(np.random.default_rng(4), seconds=6.0)).scores
    assert found["free_run"]["position"].rmse == pytest.approx(SD, rel=0.1)
    assert found["window"]["position"].rmse < 1.25 * SD


def test_a_gap_starts_anew(cart):
    """After a long gap the state is unknown: the window behind it has no past."""
    rng = np.random.default_rng(5)
    data = recording(rng, seconds=4.0)
    keep = np.r_[0:400, 600:800]
    holed = type(data)(
        "gap.csv",
        data.time[keep],
        {
            role: type(c)(c.role, c.column, c.unit, c.values[keep], sd=c.sd)
            for role, c in data.channels.items()
        },
    )
    known = predict(cart, holed).frame["position_window"].notna().to_numpy()
    assert known[WINDOW : 400 - 1].all()
    assert not known[400 : 400 + WINDOW - 2].any()


def test_scores_are_those_of_the_contract():
    y = moved(np.ones(50), 0.01)
    guess = y + 0.01 * np.cos(np.arange(50))
    score = Score.of(y, guess, "m")
    assert score.fit_percent == pytest.approx(
        100 * (1 - np.linalg.norm(y - guess) / np.linalg.norm(y - y.mean()))
    )
    assert score.rmse == pytest.approx(np.sqrt(np.mean((y - guess) ** 2)))
    holed = np.where(np.arange(50) == 7, np.nan, y)
    assert np.isfinite(Score.of(holed, guess, "m").rmse)
    assert np.isnan(Score.of(np.full(50, np.nan), guess, "m").fit_percent)


def commanded(recording, lost):
    """The recording with its command, which holds from sample to sample, missing at some rows."""
    command = recording["command"]
    values = np.array(command.values)
    values[lost] = np.nan
    channels = {**recording.channels, "command": replace(command, values=values, held=True)}
    return replace(recording, channels=channels)


def test_nothing_is_predicted_where_the_command_is_missing_for_long(cart):
    data = recording(np.random.default_rng(6), seconds=4.0)
    found = predict(cart, commanded(data, slice(300, 500)))
    frame = found.frame
    assert len(frame) == len(data)
    assert frame["position_free_run"].isna().to_numpy().nonzero()[0].tolist() == list(range(300, 500))
    assert frame["position_window"][300:500].isna().all()
    assert "200 samples" in found.notes[0]
    assert len(found.begins) == 2


def test_a_free_run_starts_at_the_first_measured_sample_as_it_is_measured(tmp_path):
    """Even where the model is wrong, and though the start's other states come from what follows."""
    wrong = rig(tmp_path, gain=3 * TRUTH["gain"], drag=TRUTH["drag"] / 3)
    data = recording(np.random.default_rng(7), seconds=4.0)
    values = np.array(data["position"].values)
    values[:40] = np.nan
    late = replace(data, channels={**data.channels, "position": replace(data["position"], values=values)})
    found = predict(wrong, late)
    free_run = found.frame["position_free_run"].to_numpy()
    assert np.isnan(free_run[:40]).all()
    assert free_run[40] == pytest.approx(values[40], abs=4 * SD)
    ((begin, state),) = found.begins
    assert begin == data.time[40]
    assert state["position"] == free_run[40]


def test_a_prediction_that_leaves_the_numbers_is_said_with_its_time(cart):
    runaway = {**cart.parameters, "drag": -2000.0}
    found = predict(cart, recording(np.random.default_rng(8), seconds=4.0), runaway)
    assert "free run of position is not finite from" in " ".join(found.notes)
    assert np.isnan(found.scores["free_run"]["position"].rmse)  # and not that of the few samples before
    assert not np.isinf(found.frame["position_free_run"].to_numpy()).any()


def test_windows_of_a_wrong_model_begin_where_the_newest_data_are(tmp_path, monkeypatch):
    """No state lets a wrong drag fit half a second: what is fitted to a whole window is off at its end."""
    wrong = rig(tmp_path, gain=TRUTH["gain"], drag=3 * TRUTH["drag"])
    data = recording(np.random.default_rng(9), seconds=6.0)
    in_pieces = predict(wrong, data).scores["window"]["position"].rmse
    monkeypatch.setattr(moving_horizon, "PIECES", 1)
    assert in_pieces < 0.9 * predict(wrong, data).scores["window"]["position"].rmse


def test_how_surely_windows_begin_is_what_the_noise_makes_of_it(cart):
    """Squared errors of starts over their covariance average one a state, whatever process noise the filter has."""
    p = cart.model.vector(cart.parameters)
    squares = []
    for seed in range(20):
        data = recording(np.random.default_rng(seed), seconds=4.0)
        objective, _ = objective_of(cart, (), build_problem(cart.model, [data], 0.5))
        found = predict_windows(objective, p, PROCESS_NOISE * cart.model.scales)
        x = moved(data["command"].values, 1 / RATE)
        fade = (1 - np.exp(-TRUTH["drag"] / RATE)) / TRUTH["drag"]
        final = TRUTH["gain"] * data["command"].values[:-1] / TRUTH["drag"]
        v = final + (np.diff(x) - final / RATE) / fade
        for w, begin in list(enumerate(objective.problem.begins))[1:]:
            off = found.starts[w] - [x[begin], v[begin]]
            squares.append(off @ np.linalg.solve(found.covariances[w], off) / 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.2)


def test_behind_a_window_that_left_the_numbers_the_others_are_predicted(cart, monkeypatch):
    data = recording(np.random.default_rng(10), seconds=4.0)

    def lost(*given, **named):
        run = simulate(*given, **named)
        if np.array_equal(named.get("first"), [3 * WINDOW]):
            run.states[:], run.outputs[:] = np.nan, np.nan
        return run

    monkeypatch.setattr(moving_horizon, "simulate", lost)
    found = predict(cart, data).frame["position_window"].to_numpy()
    assert np.isnan(found[3 * WINDOW : 4 * WINDOW - 1]).all()
    assert np.isfinite(found[4 * WINDOW + 1 :]).all()
