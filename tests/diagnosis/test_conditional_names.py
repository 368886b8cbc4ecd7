"""A name found beside another one stands as far as it stands without it; one that is contradicted is not suspected."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.diagnosis import verdict
from optid.diagnosis.criteria import Criteria
from optid.diagnosis.validation import Validated

LARGE, SMALL = SimpleNamespace(name="large_one"), SimpleNamespace(name="small_one")


def path_left_at(ratio, first=10.0):
    """To the small one alone, which leaves a multiple of the noise."""
    before, after = (Validated(np.full((20, 1), r**2)) for r in (first, ratio))
    return SimpleNamespace(first=before, validated=after, best=SimpleNamespace(effects=(SMALL,)))


@pytest.mark.parametrize(
    ("confirmed", "suspected"),
    [
        (None, []),  # the hold-out confirms everything
        (path_left_at(9.8), ["small_one"]),  # 2 % of the error, 4 % of the squared one
        (path_left_at(5.0), []),  # three quarters: it stands alone
    ],
)
def test_what_explains_little_without_an_unconfirmed_effect_is_suspected_too(
    monkeypatch, confirmed, suspected
):
    monkeypatch.setattr(verdict, "own_estimates", lambda effect, estimates: ())
    monkeypatch.setattr(
        verdict, "disagreement", lambda effect, *rest: "not confirmed" if effect is LARGE else ""
    )
    problem = SimpleNamespace(criteria=Criteria(), plain=SimpleNamespace(form_error=None), noise={})
    s = SimpleNamespace(
        best=SimpleNamespace(effects=(LARGE, SMALL)),
        names=True,
        test=SimpleNamespace(names={"large_one": None, "small_one": None}, base=None, best=None),
        problem=problem,
        search=problem,
        confirmed=confirmed,
        unconfirmed=("large_one",),
    )
    found = {one.effect: one.why for one in verdict._suspects(s, ())}
    assert found.pop("large_one") == "not confirmed"
    assert list(found) == suspected
    assert all("without large one" in why and "4 %" in why for why in found.values())


@pytest.mark.parametrize(
    ("first", "held_out", "gains", "contradicted"),
    [
        (0.6, 1.0, (-4.0,), True),  # at the noise without it, and far from it with it
        (0.6, 1.0, (-0.1, 0.0), True),
        (0.6, 1.0, (-0.1, 0.02), False),  # one of them helps a little: suspected
        (3.0, 1.0, (-4.0,), False),  # what it was fitted to lacks something
        (0.6, 3.0, (-4.0,), False),  # and what was held out
        (0.6, np.nan, (-4.0,), False),
        (np.nan, 1.0, (-4.0,), False),
        (0.6, 1.0, (np.nan,), False),
    ],
)
def test_a_name_that_a_sound_base_contradicts_leaves_no_suspicion(first, held_out, gains, contradicted):
    s = SimpleNamespace(
        path=SimpleNamespace(first=SimpleNamespace(error_over_noise=first)),
        problem=SimpleNamespace(criteria=Criteria(), noise={}),
        test=SimpleNamespace(
            base=SimpleNamespace(error_over_noise=lambda noise: held_out),
            names={str(k): SimpleNamespace(error_gain=gain) for k, gain in enumerate(gains)},
        ),
    )
    assert verdict._is_contradicted(s) is contradicted


@pytest.mark.parametrize(
    ("ratio", "together", "sure"),
    [
        (1.0, 0.5, True),  # at the noise
        (3.0, 1e-6, True),  # its strengths together are away from none
        (3.0, 0.5, False),
    ],
)
def test_beyond_the_noise_an_effect_is_sure_by_all_of_its_strengths(monkeypatch, ratio, together, sure):
    asked = []
    monkeypatch.setattr(verdict, "_birge", lambda s, evaluation: ratio)
    monkeypatch.setattr(verdict, "intervals", lambda model, by: ("estimates",))
    monkeypatch.setattr(verdict, "joint_p_value", lambda model, effect, by: together)
    monkeypatch.setattr(
        verdict, "apart_from_none", lambda found, effect, p, sure: asked.append(sure) or found
    )
    s = SimpleNamespace(
        best=SimpleNamespace(effects=(SMALL,)),
        names=True,
        problem=SimpleNamespace(criteria=Criteria(), noise={}),
        test=SimpleNamespace(
            best=SimpleNamespace(error_over_noise=lambda noise: ratio),
            names={"small_one": SimpleNamespace(p_value=1e-4)},
        ),
    )
    assert verdict._best_parameters(s) == ("estimates",)
    assert asked == [sure]
