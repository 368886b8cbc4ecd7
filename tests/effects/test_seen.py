"""Every effect at its usual size shows in a run of the axis, and the compiled model of all is CasADi's."""

from functools import lru_cache

import casadi as ca
import numpy as np
import pytest

from optid.core.jit import compiled
from optid.core.rosenbrock import moved
from optid.core.simulation import simulate
from tests.core.test_integrator import rates
from tests.effects.excitation import DT, N, inputs_of, run, strokes
from tests.effects.plants import PLANTS, grown

WINDOW = 500
NOISE = (3e-5, 1e3, 1e3)  # m, Pa, Pa
EFFECTS = grown("servo-pneumatic").effects
# Those that the rich run cannot show: its chambers stay above twice the exhaust pressure.
OWN_EXCITATION = {"exhaust_restriction": strokes}


@lru_cache(maxsize=2)
def signatures(record, only=None):
    """What effects change at a usual point: sd of noise, over every other 0.5 s window, by name, (outputs,)."""
    plant, (X, u) = grown("servo-pneumatic"), record()
    model, first = plant.model, np.arange(WINDOW, N - WINDOW, 2 * WINDOW)
    effects = [e for e in plant.effects if only in (None, e.name)]
    points = [(e.name, e.qualified(e.usual[len(e.usual) // 2])) for e in effects]
    P = np.array([plant.vector(), *(plant.vector(values) for _, values in points)])
    start = np.tile(np.array(model.start(P[0])[0]).ravel(), (len(first), 1))
    start[:, plant.shared[0]] = X[first]
    y = simulate(
        model,
        np.repeat(P, len(first), axis=0),
        np.tile(start, (len(P), 1)),
        np.full(N, DT),
        inputs_of(model, u),
        first=np.tile(first, len(P)),
        intervals=WINDOW,
    ).outputs.reshape(len(P), -1, len(model.outputs))
    change = np.sqrt(np.square((y[1:] - y[0]) / NOISE).sum(axis=1))
    return {name: own for (name, _), own in zip(points, change, strict=True)}


@pytest.mark.parametrize("effect", EFFECTS, ids=repr)
def test_its_usual_size_shows(effect):
    own = OWN_EXCITATION.get(effect.name)
    changes = (signatures(own, effect.name) if own else signatures(run))[effect.name]
    assert np.isfinite(changes).all()
    channels = slice(1, 3) if effect.name == "pressure_sensor_offset" else slice(0, 1)
    assert changes[channels].max() > 100.0


def test_back_pressure_does_not_show_while_the_exhaust_is_choked():
    assert signatures(run)["exhaust_restriction"].max() < 0.1  # of the noise; 100 and more where it shows


@pytest.mark.parametrize("name", PLANTS)
def test_the_compiled_model_of_all_effects_is_casadis(name):
    plant, rng = grown(name), np.random.default_rng(6)
    code = compiled(plant.model).code
    c, out = np.empty(code.hoisted), np.empty(len(plant.model.states) + 1)
    p = plant.vector({k: v for e in plant.effects for k, v in e.qualified(e.usual[0]).items()})
    for x, u in zip(plant.states(rng, 50), plant.inputs(rng, 50), strict=True):
        rates(code, x, u, p, c, out)
        expected = np.array(ca.DM(moved(plant.model, x, u, p, 0, 0))).ravel()
        assert out[:-1] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_with_all_effects_at_null_the_run_is_the_plain_one():
    plant, (X, u) = grown("servo-pneumatic"), run()
    start = np.array(plant.model.start(plant.vector())[0]).ravel()
    start[plant.shared[0]] = X[0]
    out = simulate(plant.model, plant.vector(), start, np.full(N, DT), inputs_of(plant.model, u)).states[0]
    assert np.abs(out[:3000, plant.shared[0]] - X[:3000])[:, 0].max() < 5e-8
