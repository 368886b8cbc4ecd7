"""Multi-step prediction errors: windows begin where the filter stands, and parameters that predict them are found."""

from dataclasses import replace

import numpy as np
import pytest

from optid.core.simulation import simulate
from optid.estimation import multistep
from optid.estimation.likelihood import WHOLE, run_filter, run_steered
from optid.estimation.multistep import ASTRAY, foreseeing, misses, preferable, windows
from optid.estimation.place import Answer
from optid.estimation.problem import pose
from optid.estimation.scoring import _start, maximise, question_of
from tests.estimation.cart import RATE, SD, TRUTH, moved, record, recording, rig

SECONDS = 0.5


@pytest.fixture(scope="module")
def asked(tmp_path_factory):
    cart = rig(tmp_path_factory.mktemp("cart"))
    data = [recording(np.random.default_rng(k)) for k in (1, 2)]
    q = question_of(cart, pose(cart.model, data, WHOLE))
    return q, cart.model.vector(cart.parameters)


def at(q, p, level) -> Answer:
    place = _start(q, p, np.full(len(q.groups), level))
    place.differentiate()
    return place.answer(False)


def test_windows_begin_every_so_many_seconds_and_the_first_one_is_known_sample_by_sample(asked):
    looks = windows(asked[0].problem, SECONDS)
    count = round(8.0 * RATE)
    for first in (0, count):
        mine = looks[first : first + count]
        assert mine[: round(SECONDS * RATE)].all()
        assert np.flatnonzero(mine)[round(SECONDS * RATE) :].tolist() == list(range(100, count, 100))


def test_between_looks_a_model_runs_freely_from_where_its_filter_stood(asked):
    q, p = asked
    level = np.full(len(q.groups), -3.0)
    here = _start(q, p, level)
    looks = windows(q.problem, SECONDS)
    E = run_steered(q.model, q.problem, p[None], here.filtered, range(2), looks=looks)[0, :, 0]
    starts = np.array([300, 700, 2100])
    free = simulate(
        q.model,
        p,
        here.filtered.states[0][starts],
        q.problem.dt,
        q.problem.inputs,
        first=starts,
        intervals=99,
    ).outputs[:, :, 0]
    for row, start in enumerate(starts):
        missed = q.problem.measured[start : start + 100, 0] - free[row]
        assert np.abs(E[start : start + 100] - missed).max() < 1e-5
    every = run_steered(q.model, q.problem, p[None], here.filtered, range(2))[0, :, 0]
    assert np.array_equal(E[looks], every[looks])  # the filter itself goes on as it did
    assert np.abs(E - every).max() > SD


def test_several_sets_in_lanes_run_as_each_would_alone(asked):
    q, p = asked
    f = run_filter(q.model, q.problem, p[None], np.full((1, 2), 1e-4), q.measurement[None], keep=True)
    P = np.array([p * share for share in (1.0, 1.05, 0.9, 1.2, 0.8)])
    looks = windows(q.problem, SECONDS)
    E = run_steered(q.model, q.problem, P, f, range(2), looks=looks)
    for row, one in zip(E, P, strict=True):
        assert row == pytest.approx(run_steered(q.model, q.problem, one[None], f, range(2), looks=looks)[0])


def test_parameters_far_off_are_found_by_windows_where_noise_would_hide_them(asked):
    q, p = asked
    loud = at(q, p, 1.0)  # so much process noise follows any motion
    found = foreseeing(loud, SECONDS)
    assert found.p[list(q.free)] == pytest.approx([TRUTH["gain"], TRUTH["drag"]], rel=1e-3)
    assert misses(found, SECONDS) < 0.01 * misses(loud, SECONDS)
    assert (
        found.noise.levels < loud.noise.levels - 5.0
    ).all()  # and with them the noise that hid them is gone


def test_parameters_that_predict_best_stay(asked):
    q, p = asked
    found = foreseeing(maximise(q, p), SECONDS)
    again = foreseeing(found, SECONDS)
    assert again.p == pytest.approx(found.p, rel=1e-5)
    assert misses(again, SECONDS) <= misses(found, SECONDS)


def test_no_time_no_search(asked):
    q, p = asked
    answer = at(replace(q, until=0.0), p, 1.0)
    assert foreseeing(answer, SECONDS) is answer


def test_of_a_law_that_is_not_natures_the_windows_are_predicted_better_than_by_the_likeliest(tmp_path):
    """A drive whose gain falls where it pushes hard: the cart's law cannot say so."""
    cart, data = rig(tmp_path), []
    for k in range(3):
        u = np.repeat(np.random.default_rng(k).uniform(-1.0, 1.0, 16), 100)
        x = moved(u * (1.0 - 0.4 * np.abs(u)), 1 / RATE) + SD * np.random.default_rng(9 + k).standard_normal(
            1600
        )
        data.append(record(u, x, f"{k}.csv"))
    q = question_of(cart, pose(cart.model, data, WHOLE))
    likely = maximise(q, cart.model.vector(cart.parameters))
    led = foreseeing(likely, SECONDS)
    assert misses(led, SECONDS) < misses(likely, SECONDS)
    assert led.score > likely.score


def test_a_search_that_leaves_the_numbers_leaves_the_answer(asked, monkeypatch):
    q, p = asked
    answer = at(q, p, 1.0)

    def lost(*given, **named):
        raise multistep.SolveError("lost")

    monkeypatch.setattr(multistep, "steered_fit", lost)
    assert foreseeing(answer, SECONDS) is answer


@pytest.mark.parametrize(
    ("likely", "missed", "taken"),
    [
        (-9.0, 1.0, "likely"),
        (-9.0, 1.0 / (1.0 - ASTRAY) - 0.01, "likely"),
        (-9.0, 1.0 / (1.0 - ASTRAY) + 0.01, "led"),  # it is likelier by process noise alone
        (1.0, 0.5, "led"),
    ],
)
def test_of_two_answers_the_likelier_counts_unless_its_windows_are_led_astray(
    likely, missed, taken, asked, monkeypatch
):
    q, p = asked
    led = at(q, p, -4.0)
    other = replace(led, score=led.score + likely)
    monkeypatch.setattr(multistep, "misses", lambda answer, seconds: 1.0 if answer is led else missed)
    assert preferable(other, led, SECONDS) is (other if taken == "likely" else led)
