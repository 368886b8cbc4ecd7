"""Windows that are taken together give the normal equations that each gives alone."""

import numpy as np
import pytest

from optid.core.gauss_newton_kernels import normal_equations
from optid.core.jit import compiled
from optid.core.llvm_simd import LANES
from optid.core.sheet import build
from optid.core.threads import parallel_for
from optid.rigs.rigfile import read_rig
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.core.test_integrator import DATA

BEGINS = np.array([0, 20, 41, 60, 81, 100])
COUNTS = np.array([20, 21, 19, 21, 19, 20])
CLOSED = np.array([False, False, True, False, False, True])
NAMES = ("end", "slope", "H", "g", "cost")


@pytest.fixture(scope="module")
def setting():
    model = build(servo_pneumatic, friction="smooth")
    free = tuple(model.index(name) for name in ("coulomb_friction", "discharge_coefficient", "payload_mass"))
    p, rng = model.vector(read_rig(DATA / "table1.toml").parameters), np.random.default_rng(1)
    X0 = np.array(model.start(p)[0]).ravel() + 0.2 * model.scales * rng.uniform(-1, 1, (6, len(model.states)))
    U, Y = rng.uniform(-0.5, 0.5, (121, 1)), rng.normal(0, 0.05, (121, len(model.outputs)))
    Y[:, 2] = np.nan
    Y[rng.integers(0, 121, 30), 0] = np.nan
    Y[:, 1] += X0[0, 2]
    return model, compiled(model, free), X0, p, U, Y, 1 / np.array([0.01, 1e4, 1e4]) * np.ones_like(Y)


def terms(setting, dt, first, last, huber=np.inf, X0=None):
    model, machine, starts, p, U, Y, weight = setting
    X0 = starts if X0 is None else X0
    w, nx, nd = len(BEGINS), len(model.states), machine.directions
    found = (
        np.full((w, nx), np.nan),
        np.full((w, nx, machine.width), np.nan),
        np.full((w, nd, machine.width), np.nan),
        np.full((w, machine.width), np.nan),
        np.full((w, 2), np.nan),
    )
    machine.run(
        normal_equations,
        first,
        last,
        BEGINS,
        COUNTS,
        CLOSED,
        X0,
        p,
        dt,
        U,
        Y,
        weight,
        huber,
        1e-11 * model.scales,
        *found,
    )
    end, slope, H, g, cost = (part[first:last] for part in found)
    return dict(zip(NAMES, (end, slope[..., :nd], H[..., :nd], g[..., :nd], cost), strict=True))


def alone(setting, dt, **how):
    each = [terms(setting, dt, w, w + 1, **how) for w in range(len(BEGINS))]
    return {name: np.concatenate([one[name] for one in each]) for name in NAMES}


def agree(found, expected):
    """Up to what different steps of the integrator leave."""
    for name in NAMES:
        for one, right in zip(found[name], expected[name], strict=True):
            assert one == pytest.approx(right, rel=1e-6, abs=1e-7 * np.nanmax(np.abs(right)), nan_ok=True), (
                name
            )


@pytest.mark.parametrize("huber", [np.inf, 1.345])
def test_together_as_alone(setting, huber):
    """Four windows and two, of unequal lengths, two of them closed, with missing samples."""
    dt = np.full(121, 1e-3) * (1 + 1e-13 * np.arange(121))
    agree(terms(setting, dt, 0, 6, huber=huber), alone(setting, dt, huber=huber))


def test_unequal_samplings_are_not_mixed(setting):
    dt = np.random.default_rng(2).uniform(0.5e-3, 1.5e-3, 121)
    found, expected = terms(setting, dt, 0, 6), alone(setting, dt)
    for name in NAMES:
        assert np.array_equal(found[name], expected[name])


def test_a_window_that_fails_spoils_no_other(setting):
    X0 = setting[2]
    lost = X0.copy()
    lost[1, 1] = np.nan
    dt = np.full(121, 1e-3)
    found = terms(setting, dt, 0, 6, X0=lost)
    assert np.isnan(found["cost"][1, 0])
    assert np.isfinite(found["cost"][[0, 2, 3, 4, 5]]).all()
    agree(found, alone(setting, dt, X0=lost))


def test_threads_share_whole_groups():
    seen = []
    parallel_for(11, lambda first, last: seen.append((first, last)), LANES)
    assert sorted(k for first, last in seen for k in range(first, last)) == list(range(11))
    assert all(first % LANES == 0 for first, _ in seen)
