"""Proposals: what is looked at, and what a race keeps."""

from dataclasses import replace

import numpy as np

from optid.diagnosis import proposals
from optid.diagnosis.base_fit import fit_base
from optid.diagnosis.proposals import propose
from optid.effects.library import admitted
from tests.diagnosis.trolley import problem_of, recording

FEW = 7  # effects, of which the second is the dead band: every one is a model to compile


def dead_band(u):
    return np.sign(u) * np.maximum(np.abs(u) - 0.2, 0.0)


def test_as_many_as_contend_are_kept_and_the_best_come_first(tmp_path):
    asked = problem_of(tmp_path, [recording(seed, f"{seed}.csv", dead_band) for seed in (1, 2)])
    base, asked = fit_base(asked)
    asked = replace(asked, options=replace(asked.options, contenders=2))
    ranked = propose(base, admitted(base.rig.model)[:FEW], asked).ranked
    assert len(ranked) == 2
    assert ranked[0].effect.name == "dead_zone@drive.command"
    assert ranked[0].loss < ranked[1].loss


def test_branches_compete_where_their_linear_step_promises_enough(tmp_path, monkeypatch):
    """A trolley that lacks nothing, and one with a dead band."""
    entered, advance = [], proposals._proposal_after_steps
    monkeypatch.setattr(
        proposals, "_proposal_after_steps", lambda *given: entered.append(given[-1]) or advance(*given)
    )
    for concealed, lacking in ((lambda u: u, False), (dead_band, True)):
        asked = problem_of(tmp_path, [recording(seed, f"{seed}.csv", concealed) for seed in (1, 2)])
        base, asked = fit_base(asked)
        effects = admitted(base.rig.model)[:FEW]
        entered.clear()
        ranked = propose(base, effects, asked, promise=0.1).ranked
        names = {one.effect.name for one in entered}
        # Without any effect one competes anyway; beside another effect none would.
        assert len(names) > 1 if lacking else len(names) == 1
        assert (ranked[0].effect.name == "dead_zone@drive.command") is lacking
        entered.clear()
        beside = replace(base, effects=("another",))
        found = propose(beside, effects, asked, promise=0.1)
        assert bool(entered) is lacking
        assert np.isfinite(found.alone) == lacking
        assert set(found.visible) == {one.name for one in effects}


def test_effects_that_are_scored_in_one_model_score_as_in_models_of_their_own(tmp_path, monkeypatch):
    asked = problem_of(tmp_path, [recording(seed, f"{seed}.csv", dead_band) for seed in (1, 2)])
    base, asked = fit_base(asked)
    effects, found, score = admitted(base.rig.model)[:FEW], {}, proposals.branches_of
    sizes = set()

    def noted(*given):
        branches = score(*given)
        sizes.add(len(given[-1]))
        found.update({effect.name: some for effect, some in zip(given[-1], branches, strict=True)})
        return branches

    monkeypatch.setattr(proposals, "branches_of", noted)
    alone = propose(base, effects, asked).visible
    apart = dict(found)
    beside = propose(base, effects, asked, promise=0.02).visible
    assert sizes >= {1, proposals.TOGETHER}
    assert list(alone) == list(beside)
    assert np.allclose(list(alone.values()), list(beside.values()), rtol=0.1, atol=0.01)
    for name, some in apart.items():
        for one, other in zip(some, found[name], strict=True):
            assert (one.best is None) == (other.best is None)
            assert one.effect is other.effect
            if one.best is not None:
                assert np.isclose(one.best.loss, other.best.loss, rtol=0.03)
                assert set(one.best.values) == set(other.best.values)


def test_every_branch_of_the_nearest_effects_goes_on_and_the_best_is_kept(tmp_path, monkeypatch):
    """A linear step may choose the wrong branch, as that of a slow drift for one that settles soon."""
    offered, entered, score, advance = {}, {}, proposals.branches_of, proposals._proposal_after_steps

    def scored(*given):
        found = score(*given)
        offered.update((some[0].effect.name, sum(each.best is not None for each in some)) for some in found)
        return found

    def advanced(*given):
        one = advance(*given)
        entered.setdefault(one.effect.name, []).append(one.loss)
        return one

    monkeypatch.setattr(proposals, "branches_of", scored)
    monkeypatch.setattr(proposals, "_proposal_after_steps", advanced)
    asked = problem_of(tmp_path, [recording(seed, f"{seed}.csv", dead_band) for seed in (1, 2)])
    base, asked = fit_base(asked)
    asked = replace(asked, options=replace(asked.options, contenders=2))
    ranked = propose(base, admitted(base.rig.model), asked).ranked
    several = {name for name, count in offered.items() if count > 1}
    near = {one.effect.name for one in ranked}
    assert near & several and several - near
    assert all(len(entered[name]) == offered[name] for name in near)
    assert all(len(entered[name]) == 1 for name in several if name not in near and name in entered)
    assert all(one.loss == min(entered[one.effect.name]) for one in ranked)
