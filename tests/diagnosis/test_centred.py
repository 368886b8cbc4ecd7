"""What recordings together tell of an effect of which each has something of its own."""

import math

import numpy as np
import pytest

from optid.diagnosis.candidate import Data, centred, refitted
from optid.diagnosis.judge import judge
from optid.effects.catalogue.periodic_disturbance import ALIKE, SCATTER, PeriodicDisturbance
from optid.estimation.scoring import maximise
from optid.rigs.rigfile import with_effects
from tests.diagnosis.trolley import SD, TRUTH, recording, rig

ACCELERATION, HERTZ, PHASE = 0.8, 1.7, 0.9


class Shaken(PeriodicDisturbance):
    """The trolley's, by its mass."""

    sites = ("drag.force",)


def found(folder, phases):
    """A fit that came to amplitude and phase from afar, as the states of its recordings allow, and its data."""
    runs = [
        recording(
            seed,
            f"run_{seed}",
            beside=lambda t, x, v, at=at: ACCELERATION * np.sin(2 * np.pi * HERTZ * t + at),
        )
        for seed, at in enumerate((*phases, PHASE), 1)
    ]
    data = Data(tuple(runs[:-1]), (runs[-1],), {"position": SD}, np.random.default_rng(0))
    plain, effect = rig(folder), Shaken()
    # The site is a drag: what pushes counts against it.
    start = {"amplitude": 1.4 * ACCELERATION, "frequency": HERTZ, "phase": PHASE + math.pi + 0.6}
    grown = with_effects(plain, [effect], {**TRUTH, **effect.qualified(start)})
    question = data.question(grown, plain.model)
    answer = maximise(
        question, grown.model.vector(grown.parameters), np.array([-8.0]), iterations=3, polish=False
    )
    return effect, grown, answer, data, plain


def values(model, p):
    return {q.name.removeprefix("periodic_disturbance."): v for q, v in zip(model.parameters, p, strict=True)}


def test_one_phase_in_common_is_told_and_foretells_a_recording(tmp_path):
    effect, grown, answer, data, _ = found(tmp_path, (PHASE, PHASE, PHASE))
    mine, better = centred((effect,), grown, answer)
    told = values(better.question.model, better.p)
    assert told["amplitude"] == pytest.approx(ACCELERATION, rel=0.05)
    assert math.remainder(told["phase"] - PHASE - math.pi, 2 * math.pi) == pytest.approx(0.0, abs=0.05)
    assert told["scatter"] <= 0.1
    assert mine.parameters["periodic_disturbance.scatter"] == told["scatter"]
    assert better.score < answer.score
    before, after = (judge(one, data.holdout).deviance[:50].sum() for one in (answer, better))
    assert after < before - 5.0
    assert centred((effect,), mine, better)[1] is better  # there is nothing more to tell


def test_recordings_of_different_phases_have_their_mean_amplitude_in_common(tmp_path):
    effect, grown, answer, _, _ = found(tmp_path, (0.3, 2.9, 4.4))
    told = values(grown.model, centred((effect,), grown, answer)[1].p)
    assert told["amplitude"] == pytest.approx(ACCELERATION, rel=0.1)
    assert told["scatter"] == SCATTER.bounds[1] > ALIKE


def test_one_recording_says_nothing_of_others(tmp_path):
    effect, grown, answer, _, _ = found(tmp_path, (PHASE,))
    told = values(grown.model, centred((effect,), grown, answer)[1].p)
    assert told["amplitude"] == pytest.approx(ACCELERATION, rel=0.05)
    assert told["scatter"] == SCATTER.bounds[1]


def test_a_model_without_it_stays(tmp_path):
    _, _, answer, data, plain = found(tmp_path, (PHASE, PHASE))
    base = refitted(
        plain, (), type("Near", (), {"answer": answer, "rig": answer.question.rig}), data, plain.model
    )
    assert centred((), base.rig, base.answer) == (base.rig, base.answer)
