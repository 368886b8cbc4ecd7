"""A name that leaves more than the noise has to hold against descriptions at other places."""

from types import SimpleNamespace

import numpy as np
import pytest

from optid.diagnosis.criteria import Criteria
from optid.diagnosis.result import Verdict
from optid.diagnosis.validation import Validated
from optid.diagnosis.verdict import _verdict, is_beyond_doubt, is_explained_elsewhere, is_sufficient
from optid.effects.sticking import Sticking

NAME = SimpleNamespace(name="named", sites=("force.external",), depends_on=("velocity",))


def problem(form_error=None):
    return SimpleNamespace(criteria=Criteria(), plain=SimpleNamespace(form_error=form_error))


def errors_at(ratio):
    """Twenty windows of two outputs that err alike."""
    return Validated(np.full((20, 2), ratio**2))


def path_left_at(ratio):
    """From ten times the noise."""
    errors = [errors_at(r) for r in (10.0, ratio)]
    return SimpleNamespace(first=errors[0], validated=errors[1], best=SimpleNamespace(effects=(NAME,)))


def described(ratio, site, signal="velocity"):
    effect = SimpleNamespace(sites=(site,), depends_on=(signal,))
    contender = SimpleNamespace(validated=errors_at(ratio), effect=effect)
    return SimpleNamespace(contender=contender)


STICKING = SimpleNamespace(
    contender=SimpleNamespace(validated=errors_at(1.05), effect=Sticking("force.external", "velocity"))
)


@pytest.mark.parametrize(
    ("left", "form_error", "sure"), [(1.1, None, True), (2.0, None, False), (2.0, 0.05, True)]
)
def test_names_at_the_noise_or_within_what_the_plant_states_need_no_description(left, form_error, sure):
    assert is_sufficient(path_left_at(left), problem(form_error))
    assert is_beyond_doubt(path_left_at(left), problem(form_error)) is sure


@pytest.mark.parametrize(
    ("left", "surrogate", "elsewhere"),
    [
        (2.0, described(1.05, "sensor.position"), True),
        (2.0, described(1.05, "force.external"), False),  # the law's own form, drawn freely
        (2.0, described(1.05, "force.external", "command"), True),
        (2.0, described(1.6, "sensor.position"), False),
        (1.1, described(1.05, "sensor.position"), False),
        (1.5, described(1.05, "sensor.position"), False),  # of 99 variances it explains another 1.1
        (2.0, STICKING, True),  # not the law's form at all
        (2.0, SimpleNamespace(contender=None), False),
        (2.0, None, False),
    ],
)
def test_only_what_reaches_the_noise_apart_from_a_law_speaks_against_its_name(left, surrogate, elsewhere):
    assert is_explained_elsewhere(path_left_at(left), surrogate, problem()) is elsewhere


@pytest.mark.parametrize(
    ("free", "site", "elsewhere"),
    [
        ((12.0, 5.0), "flow.chamber_a", True),
        ((12.0, 5.0), "force.external", False),  # the law's own place and signal
        ((12.0, 35.0), "flow.chamber_a", False),  # more than half of the pressure's error is left by either
    ],
)
def test_an_output_that_a_law_leaves_out_and_a_description_elsewhere_explains_speaks_against_it(
    free, site, elsewhere
):
    """A flow force, told as an asymmetric valve: the position was right, the pressure erred as before."""
    path = path_left_at(8.0)
    path.first, path.validated = (
        Validated(np.tile(np.square(one), (20, 1))) for one in ((150.0, 42.0), (17.0, 42.0))
    )
    contender = described(8.0, site).contender
    contender.validated = Validated(np.tile(np.square(free), (20, 1)))
    assert is_explained_elsewhere(path, SimpleNamespace(contender=contender), problem()) is elsewhere
    path.first = Validated(np.tile([150.0**2, 1.3], (20, 1)))  # the pressure was at the noise
    path.validated = Validated(np.tile([17.0**2, 1.3], (20, 1)))
    assert not is_explained_elsewhere(path, SimpleNamespace(contender=contender), problem())


@pytest.mark.parametrize(
    ("left", "held_out", "found"),
    [
        (
            6.0,
            9.0,
            Verdict.MISSING_PHYSICS,
        ),  # the test is passed: what is left there does not refuse the name
        (7.5, 9.0, Verdict.MISSING_PHYSICS),  # 44 % of the squared error
        (9.0, 9.0, Verdict.UNEXPLAINED),
        (9.0, 1.1, Verdict.MISSING_PHYSICS),
        (6.0, float("nan"), Verdict.UNEXPLAINED),
    ],
)
def test_how_much_a_name_explains_is_asked_of_windows_that_selected_it_and_not_of_the_hold_out(
    left, held_out, found
):
    path, asked = path_left_at(left), problem()
    asked.noise = {}
    best = SimpleNamespace(effects=(NAME,))
    test = SimpleNamespace(best=SimpleNamespace(error_over_noise=lambda noise: held_out))
    s = SimpleNamespace(problem=asked, search=asked, path=path, wide=False, names=True, best=best, test=test)
    assert _verdict(s, ()) is found
