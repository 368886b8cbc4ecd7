"""Where an input switches inside a hold, a model moves as it does along a command sampled finely enough to say so."""

import numpy as np
import pytest

from optid.core.gauss_newton_kernels import normal_equations
from optid.core.jit import compiled
from optid.core.kernel import trace
from optid.core.linearise import linearise
from optid.core.llvm_simd import LANES
from optid.core.parameter import Parameter
from optid.core.recording import Channel, Recording
from optid.core.sheet import build
from optid.core.simulation import simulate
from optid.estimation.likelihood import WHOLE, run_filter, run_fixed_gain_filter
from optid.estimation.problem import build_problem
from optid.live.twin import Twin

SHARE = Parameter("share", "1", 0.3, "of a hold that the former command lasts", "test", 0.3, (0.0, 1.0))
DRAG = Parameter("drag", "1/s", 4.0, "of a cart", "test", 4.0, (0.0, 100.0))
N, FINER, DT = 120, 10, 0.01


def cart(s, *, late=True):
    """Of a positive command it takes thrice as much as of a negative one: a mean of both is no stand-in."""
    x, v = s.state("x", "m", 0.1, spread=0.05), s.state("v", "m/s", 1.0, spread=0.1)
    u = s.input("command", "1", idle=0.0)
    if late:
        u = s.switch_within_hold(s.param(SHARE), s.past("command", 1), u)
    s.rate(x, v)
    s.rate(v, 20.0 * u + 10.0 * abs(u) - s.param(DRAG) * v)
    s.output("position", "m", x)


def commanded(seed=1):
    return np.random.default_rng(seed).choice([-1.0, 1.0], N)


def recorded(u, dt, shown):
    measured = np.full(len(u), np.nan)
    every = len(u) // N
    measured[::every] = shown
    channels = {
        "command": Channel("command", "u", "1", u),
        "position": Channel("position", "x", "m", measured),
    }
    return Recording("run.csv", dt * np.arange(len(u)), channels)


def both(seed=1, shown=None):
    """The model with the switch inside holds, and without it along a command sampled ten times as fast."""
    u = commanded(seed)
    shown = np.zeros(N) if shown is None else shown
    fine = np.r_[np.zeros(3), np.repeat(u, FINER)][: N * FINER]
    models = build(cart), build(cart, late=False)
    problems = (
        build_problem(models[0], [recorded(u, DT, shown)], WHOLE),
        build_problem(models[1], [recorded(fine, DT / FINER, shown)], WHOLE),
    )
    return models, problems


def test_a_switch_inside_a_hold_is_that_of_a_finer_command():
    models, problems = both()
    ends = [
        simulate(m, m.vector({}), np.zeros(2), q.dt, q.inputs, tolerance=1e-12).states[0]
        for m, q in zip(models, problems, strict=True)
    ]
    assert np.abs(ends[0] - ends[1][::FINER]).max() < 1e-10
    mean = simulate(models[1], models[1].vector({}), np.zeros(2), problems[0].dt, problems[0].inputs[:, :1])
    assert np.abs(mean.states[0] - ends[0]).max() > 1e-2


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_slopes_reach_the_moment_of_the_switch(share):
    model, q = both()[0][0], both()[1][0]
    machine, free = compiled(model, (model.index("share"), model.index("drag"))), (0, 1)
    p, X = model.vector({"share": share}), np.full((N, 2), np.nan)
    Y, G = np.full((N, 1), np.nan), np.zeros((N, 1, machine.width))
    given = (q.begins, q.counts, q.closed, np.zeros((1, 2)), p, q.dt, q.inputs, 1e-12 * model.scales)
    machine.run(trace, 0, 1, *given, X, Y, G)
    for column, name in enumerate(("share", "drag")):
        nudge = {0.0: 1e-6, 1.0: -1e-6}.get(share, 1e-6)
        moved = model.vector({"share": share, name: p[model.index(name)] + nudge})
        ends = [
            simulate(model, one, np.zeros(2), q.dt, q.inputs, tolerance=1e-13).outputs[0, :, 0]
            for one in (p, moved)
        ]
        expected = (ends[1] - ends[0]) / nudge
        assert G[:, 0, len(free) + column] == pytest.approx(expected, rel=1e-4, abs=1e-5)


def test_windows_taken_together_switch_each():
    model, q = both()[0][0], both(shown=np.sin(np.arange(N)))[1][0]
    machine, p = compiled(model, (model.index("share"),)), model.vector({})
    begins, counts = np.arange(0, N - 20, 20), np.full(5, 20)
    closed, weight = np.zeros(5, dtype=bool), np.ones((N, 1))

    def terms(first, last):
        found = (
            np.empty((5, 2)),
            np.empty((5, 2, machine.width)),
            np.empty((5, machine.directions, machine.width)),
            np.empty((5, machine.width)),
            np.empty((5, 2)),
        )
        machine.run(
            normal_equations,
            first,
            last,
            begins,
            counts,
            closed,
            np.zeros((5, 2)),
            p,
            q.dt,
            q.inputs,
            q.measured,
            weight,
            np.inf,
            1e-12 * model.scales,
            *found,
        )
        return [part[first:last] for part in found]

    together, alone = terms(0, 5), [terms(w, w + 1) for w in range(5)]
    for k, part in enumerate(together):
        assert part == pytest.approx(np.concatenate([one[k] for one in alone]), rel=1e-8, abs=1e-8)


def test_filters_switch_inside_holds():
    (late, plain), (coarse, fine) = both(shown=0.1 * (1.0 - np.cos(0.1 * np.arange(N))))
    assert late.halves is not None and plain.halves is None
    quiet, R = np.full((1, 2), 1e-16), np.full((1, 1), 1e-4)
    f = run_filter(late, coarse, late.vector({})[None], quiet, R, keep=True)
    g = run_filter(plain, fine, plain.vector({})[None], quiet, R, keep=True)
    assert f.innovations[0] == pytest.approx(g.innovations[0][::FINER], rel=1e-5, abs=1e-7)
    assert f.variances[0] == pytest.approx(g.variances[0][::FINER], rel=1e-5)
    # Sets side by side, each of them in lanes of its own.
    shares = np.linspace(0.0, 1.0, LANES + 1)
    P = np.array([late.vector({"share": share}) for share in (0.3, *shares)])
    E = run_fixed_gain_filter(late, coarse, P, f, range(2))
    assert E[0] == pytest.approx(f.innovations[0], rel=1e-5, abs=1e-7)
    for row, p in zip(E[1:], P[1:], strict=True):
        assert row == pytest.approx(
            run_fixed_gain_filter(late, coarse, p[None], f, range(2))[0], rel=1e-4, abs=1e-6
        )


def test_a_twin_switches_inside_holds():
    (late, _), (coarse, _) = both()
    run = simulate(late, late.vector({}), np.zeros(2), coarse.dt, coarse.inputs, tolerance=1e-10)
    twin = Twin(late, late.vector({}), np.zeros(2))
    for n, u in enumerate(commanded()[:-1]):
        assert twin.outputs()[0] == pytest.approx(run.outputs[0, n, 0], abs=1e-6)
        assert twin.advance(u, DT)


def test_a_linearisation_takes_the_mean_of_a_hold():
    found = linearise(build(cart), {}, {"v": 0.0, "command": 1e-3, "command@1": 1e-3}, moving=["v", "x"])
    assert list(found.system.input_labels) == ["command", "command@1"]
    assert found.system.B[1] == pytest.approx([0.7 * 30.0, 0.3 * 30.0])


@pytest.mark.parametrize(("speed", "before"), [(0.0, 0.0), (0.3, 1.0)])
def test_before_a_record_the_command_was_idle_unless_the_record_begins_in_motion(speed, before):
    rng, time = np.random.default_rng(4), DT * np.arange(N)
    shown = speed * time + (0.5 * 8.0 * time**2 if speed == 0.0 else 0.0) + 1e-4 * rng.normal(size=N)
    q = build_problem(build(cart), [recorded(np.ones(N), DT, shown)], WHOLE)
    assert q.inputs[0].tolist() == [1.0, before]


def test_a_record_too_short_to_tell_begins_idle():
    one = recorded(np.ones(N), DT, np.arange(N) * 1.0)
    assert build_problem(build(cart), [one.taken(np.arange(8))], WHOLE).inputs[0, 1] == 0.0
