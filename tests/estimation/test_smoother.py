"""The smoother's descent: exact derivatives, steps that bounds and powerless parameters do not spoil."""

from dataclasses import replace

import numpy as np
import pytest

from optid.estimation.initial_trajectory import guess
from optid.estimation.objective import objective_of, with_nuisance_parameters
from optid.estimation.problem import build_problem
from optid.estimation.smoother import Point, descend, evaluate, priced
from tests.estimation.cart import TRUTH, moved, record, recording, rig


def posed(cart, data):
    problem = build_problem(cart.model, data, 0.5)
    o, p = objective_of(cart, with_nuisance_parameters(cart), problem)
    return replace(o, tolerance=1e-10), Point(guess(cart.model, problem, p), p)


def gradient(o, at, q):
    """Of half the cost: to the free parameters, and to every node's states, from the terms of one linearisation."""
    t, nx, b = evaluate(o, at, q), len(o.model.states), o.problem
    Qd = t.defect / q**2
    theta = -t.g[:, nx:].sum(axis=0) - np.einsum("wki,wk->i", t.slope[:, :, nx:], Qd)
    theta += (at.p[list(o.free)] - o.prior) / o.prior_sd**2
    X = -t.g[:, :nx] - np.einsum("wki,wk->wi", t.slope[:, :, :nx], Qd * b.linked[:, None])
    X[1:] += Qd[:-1]
    return theta, X + o.heads[:, None] * (at.X - o.start) / o.spread**2


@pytest.mark.parametrize("huber", [np.inf, 1.345])
def test_gradient_is_that_of_the_cost(tmp_path, huber):
    free = 'gain = { bounds = ["0.1 m/s**2", "50 m/s**2"] }\ndrag = { bounds = ["0.01 1/s", "50 1/s"], sd = "0.3 1/s" }'
    rng = np.random.default_rng(4)
    o, at = posed(rig(tmp_path, free), [recording(rng), recording(rng, name="other.csv")])
    o, q = replace(o, huber=huber), 0.05 * o.model.scales
    at = Point(at.X + 1e-3 * rng.standard_normal(at.X.shape), at.p)
    theta, X = gradient(o, at, q)

    def cost(node, state, step):
        moved = Point(at.X.copy(), at.p.copy())
        if node is None:
            moved.p[o.free[state]] += step
        else:
            moved.X[node, state] += step
        return 0.5 * evaluate(o, moved, q).cost

    places = [(None, k) for k in range(len(o.free))] + [(w, i) for w in (0, 3, len(X) - 1) for i in range(2)]
    for node, k in places:
        step = 1e-5
        slope = (cost(node, k, step) - cost(node, k, -step)) / (2 * step)
        exact = theta[k] if node is None else X[node, k]
        assert exact == pytest.approx(slope, rel=1e-5, abs=1e-3), (node, k)


def test_a_parameter_without_influence_stops_no_other(tmp_path):
    """A push of nothing leaves its share powerless; the drag is found from the coasting all the same."""
    free = 'share = { bounds = [0.1, 10] }\ndrag = { bounds = ["0.01 1/s", "50 1/s"] }'
    o, at = posed(rig(tmp_path, free, gain=0.0), [record(np.ones(400), moved(np.zeros(400), 1 / 200, v=1.0))])
    at, _, settled = descend(o, at, 1e-5 * o.model.scales, iterations=50, precision=1e-10)
    assert settled
    share, drag = at.p[list(o.free)]
    assert drag == pytest.approx(TRUTH["drag"], rel=1e-4)
    assert share == 1.0


def test_bounds_hold_and_the_rest_settles(tmp_path):
    free = 'gain = { bounds = ["0.1 m/s**2", "2.5 m/s**2"] }\ndrag = { bounds = ["0.01 1/s", "50 1/s"] }'
    data = [recording(np.random.default_rng(5))]
    o, at = posed(rig(tmp_path, free), data)
    q = 1e-5 * o.model.scales
    at, _, settled = descend(o, at, q, iterations=50, precision=1e-10)
    assert settled
    assert at.p[o.free[0]] == 2.5
    theta, _ = gradient(o, at, q)
    assert theta[0] < 0  # it would go on
    assert abs(theta[1]) < 1e-4 * abs(theta[0])


def test_another_process_noise_changes_the_price_alone(tmp_path):
    o, at = posed(rig(tmp_path), [recording(np.random.default_rng(6))])
    loose, tight = (level * o.model.scales for level in (0.1, 1e-3))
    terms = evaluate(o, at, loose)
    again, anew = priced(o, at, terms, tight), evaluate(o, at, tight)
    assert again.cost == anew.cost > terms.cost
    assert np.array_equal(again.H, anew.H)


def test_a_promise_saves_the_last_evaluation(tmp_path, monkeypatch):
    """With the gain alone free the cost is a parabola: one step ends at its bottom, and the next promises nothing."""
    free = 'gain = { bounds = ["0.1 m/s**2", "50 m/s**2"] }'
    o, at = posed(rig(tmp_path, free, drag=TRUTH["drag"]), [recording(np.random.default_rng(7))])
    q, calls = 1e-2 * o.model.scales, []
    monkeypatch.setattr(
        "optid.estimation.smoother.evaluate", lambda *given, **how: calls.append(1) or evaluate(*given, **how)
    )
    at, terms, settled = descend(o, at, q, iterations=20, precision=1e-6)
    assert settled
    assert len(calls) == 2
    best, exact, _ = descend(o, at, q, iterations=20, precision=1e-14, terms=terms)
    assert terms.cost == pytest.approx(exact.cost, rel=1e-6)
    assert at.p[o.free[0]] == pytest.approx(best.p[o.free[0]], rel=1e-4)
