"""A signal that sticks and jumps: against the law itself, sample by sample."""

from pathlib import Path

import numpy as np
import pytest

from optid.core.sheet import build
from optid.core.simulation import simulate
from optid.effects.library import admitted, find_effect
from optid.effects.sticking import Sticking
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.effects.plants import grown

STICKING = Sticking("valve.command", "command", size=0.2)


def jumped(u, width):
    """The law by its letter: stays until the command has gone so far, then is there."""
    stands, out = u[0], []
    for one in u:
        if abs(one - stands) > width:
            stands = one
        out.append(stands)
    return np.array(out)


def test_it_is_found_by_its_name_and_is_no_candidate():
    found = find_effect(STICKING.name, Path())
    assert (found.name, found.sites) == ("sticking@valve.command@command", ("valve.command",))
    assert not any(effect.name.startswith("sticking") for effect in admitted(build(servo_pneumatic)))


@pytest.mark.parametrize("width", [0.0112, 0.0342])
def test_it_jumps_where_the_law_does_and_has_arrived_a_sample_later(width):
    model = build(servo_pneumatic, [STICKING])
    own = STICKING.qualified({"width": width / 0.2})
    p = model.vector({**grown("servo-pneumatic").values, **own})
    t = np.arange(1500) * 1e-3
    u = 0.08 * np.sin(2 * np.pi * 1.3 * t) + 0.02 * np.sin(2 * np.pi * 7.0 * t)
    u = 0.0005 * np.round(u / 0.0005)  # as a converter has it
    start = np.array(model.start(p)[0]).ravel()
    names = [state.name for state in model.states]
    start[names.index("pressure_a")], start[names.index("pressure_b")] = 4e5, 4.4e5
    states = simulate(model, p, start, np.full(len(t), 1e-3), u[:, None]).states[0]
    stands = states[1:, names.index(f"{STICKING.name}.stands")]
    off = np.abs(stands - jumped(u, width)[:-1])
    # what is left when it is caught is little, and none of the jumps is missed
    assert off.max() < 0.01 * width
    assert 10 < np.count_nonzero(np.diff(jumped(u, width))) < len(t) / 5


def test_next_to_no_width_changes_next_to_nothing():
    plain, model = build(servo_pneumatic), build(servo_pneumatic, [STICKING])
    values = grown("servo-pneumatic").values
    u = 0.3 * np.sin(2 * np.pi * 2.0 * np.arange(400) * 1e-3)
    found = []
    for one in (plain, model):
        p = one.vector(values)
        start = np.array(one.start(p)[0]).ravel()
        states = simulate(one, p, start, np.full(len(u), 1e-3), u[:, None]).states[0]
        found.append(states[:, [state.name for state in one.states].index("position")])
    assert np.abs(found[1] - found[0]).max() < 0.01 * np.ptp(found[0])
