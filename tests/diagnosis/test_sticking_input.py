"""An input that sticks, beside a law of the same input that leaves more than the noise."""

from dataclasses import replace

import numpy as np
import pytest

from optid.core.recording import Channel
from optid.diagnosis.base_fit import fit_base
from optid.diagnosis.proposals import propose
from optid.diagnosis.selection.forward import contend
from optid.diagnosis.selection.path import nothing_selected
from optid.diagnosis.surrogate import sticking_input
from optid.effects.library import admitted
from optid.errors import SolveError
from tests.diagnosis.trolley import problem_of, recording

WIDTH = 0.3


def stuck(u, width=WIDTH):
    """What stands until the command is so far away, and then goes there."""
    stands, out = 0.0, np.empty_like(u)
    for k, command in enumerate(u):
        if abs(command - stands) > width:
            stands = command
        out[k] = stands
    return out


def played(u):
    """A play of the same half width."""
    stands, out = 0.0, np.empty_like(u)
    for k, command in enumerate(u):
        stands = min(max(stands, command - WIDTH), command + WIDTH)
        out[k] = stands
    return out


def named(folder, concealed, worse=1.0):
    """The problem of a trolley, the search's, and its path to a named hysteresis; positions noisier than stated."""

    def noisier(seed):
        one = recording(seed, f"record {seed}", concealed)
        more = np.random.default_rng(100 + seed).standard_normal(len(one))
        x = one["position"]
        values = x.values + np.sqrt(worse**2 - 1.0) * x.sd * more
        return replace(
            one, channels={**one.channels, "position": Channel("position", "x", "m", values, x.sd)}
        )

    problem = problem_of(folder, [noisier(seed) for seed in (1, 2, 3)])
    base, search = fit_base(problem.at_search_accuracy())
    nothing = nothing_selected(base, search)
    (law,) = (one for one in admitted(base.rig.model, ()) if one.name == "hysteresis@drive.command")
    (led,) = propose(base, [law], search).ranked
    found = contend(base, nothing.first, nothing.first, search, 1, led)
    without = {law.name: (base, nothing.first)}
    return problem, search, replace(nothing, best=found.model, validated=found.validated, without=without)


def test_what_sticks_is_described_to_the_noise(tmp_path):
    problem, search, path = named(tmp_path, stuck)
    assert path.validated.error_over_noise > 2.0
    found = sticking_input.find_sticking_input(path, search, problem)
    assert found.validated.error_over_noise < 1.1
    assert found.effect.sites == ("drive.command",)
    own = found.model.own_values(found.effect)
    width = 1.001 * own["size"] * own["width"]  # its threshold is 0.1 % wide
    for one in problem.train:  # it jumps whenever the truth does, and never else
        u = one["command"].values
        assert np.array_equal(stuck(u, width), stuck(u))


def test_a_law_that_leaves_more_for_another_reason_keeps_its_name(tmp_path):
    problem, search, path = named(tmp_path, played, worse=1.5)
    assert path.validated.error_over_noise > search.criteria.error_over_noise
    assert sticking_input.find_sticking_input(path, search, problem) is None


def test_what_windows_do_not_tell_from_the_law_does_not_stand_in_its_place(tmp_path, monkeypatch):
    problem, search, path = named(tmp_path, stuck)
    monkeypatch.setattr(sticking_input, "is_told_apart", lambda worse, better, problem: False)
    assert sticking_input.find_sticking_input(path, search, problem) is None


def test_where_it_cannot_be_simulated_the_law_keeps_its_name(tmp_path, monkeypatch):
    problem, search, path = named(tmp_path, stuck)

    def diverges(*_):
        raise SolveError("the simulation diverged")

    monkeypatch.setattr(sticking_input, "fit_model", diverges)
    assert sticking_input.find_sticking_input(path, search, problem) is None


def test_a_law_at_the_noise_is_not_asked(tmp_path, monkeypatch):
    problem, search, path = named(tmp_path, played)
    monkeypatch.setattr(sticking_input, "sticking", lambda *_: pytest.fail("it was asked"))
    assert sticking_input.find_sticking_input(path, search, problem) is None
