"""Gains on trial: the rule on made-up answers, and worse gains taken back on a simulated rig."""

import math
from types import SimpleNamespace

import pytest

from optid.live import tuning
from optid.live.driver import open_driver
from optid.live.loop import Choices, Loop
from optid.live.messages import Sample
from optid.live.reference import Reference, tour
from optid.live.review import Review
from optid.live.session import Session
from optid.live.settings import live_settings, wiring_of
from optid.live.trial import ALL, EARLY, WINDOW, Trial
from optid.pid.controller import Gains

SPAN = 0.01


class Axis:
    """Answers a staircase with a first-order lag."""

    def __init__(self, trial, steps=(1.0, 3.0, 0.0)):
        self.trial, self.steps, self.number, self.time, self.y = trial, steps, 0, 0.0, 0.0

    def run(self, episodes, lag, missing=0.0):
        """Verdicts that fell, in the order of the episodes."""
        found = []
        for _ in range(episodes):
            goal = self.steps[self.number % len(self.steps)]
            self.number += 1
            for n in range(round((WINDOW + 0.5) / SPAN)):
                self.y += (goal - self.y) * SPAN / lag
                seen = math.nan if n < missing * WINDOW / SPAN else self.y
                found.append(self.trial.add(self.time, goal, seen))
                self.time += SPAN
        return [one for one in found if one is not None]


@pytest.fixture
def axis():
    trial = Trial(SPAN, 0.05)
    trial.add(0.0, 0.0, 0.0)
    return Axis(trial)


def test_much_worse_gains_go_early_and_slightly_worse_ones_after_all(axis):
    assert axis.run(6, 0.1) == []
    assert axis.trial.begin() is None
    (early,) = axis.run(ALL, 0.2)
    assert (early.kept, early.episodes) == (False, EARLY)
    assert early.ratio == pytest.approx(4.0, rel=0.2)  # ITAE of a lag goes with its square
    axis.trial.begin()
    (late,) = axis.run(ALL, 0.103)
    assert (late.kept, late.episodes) == (False, ALL)
    assert 1.0 < late.ratio < 1.1


def test_better_gains_stay_and_are_what_the_next_ones_are_held_against(axis):
    axis.run(6, 0.2)
    axis.trial.begin()
    (verdict,) = axis.run(ALL, 0.1)
    assert verdict.kept and verdict.ratio < 0.3
    axis.trial.begin()
    (verdict,) = axis.run(ALL, 0.15)  # better than the first, worse than those in use
    assert not verdict.kept


def test_one_odd_episode_decides_nothing(axis):
    axis.run(6, 0.1)
    axis.trial.begin()
    assert axis.run(2, 0.09) == []
    assert axis.run(1, 2.0) == []
    assert axis.run(1, 0.1, missing=0.5) == []  # says nothing
    (verdict,) = axis.run(ALL - 3, 0.09)
    assert verdict.kept and verdict.episodes == ALL


def test_without_old_episodes_nothing_is_compared(axis):
    verdict = axis.trial.begin()
    assert verdict.kept and not verdict.episodes
    assert "not compared" in verdict.words
    assert not axis.trial.running


def drive(bench, loop, driver):
    """A function that runs a loop at its rate up to a time."""
    state = {"n": 0, "u": 0.0}

    def until(seconds):
        while (time := state["n"] * loop.settings.span) < seconds:
            sample = Sample(state["n"], time, state["u"], state["u"], driver.read(time))
            state["u"] = driver.write(loop.step(sample).command, time)
            state["n"] += 1

    return until


def test_gains_that_answer_worse_on_the_rig_are_taken_back(bench):
    settings, wiring = live_settings(bench, 250.0), wiring_of(bench)
    reference = tour(settings.limits)
    loop = Loop(bench, settings, wiring, reference, Choices(Gains(20.0)))
    order = {"wiring": wiring, "settings": settings, "recording": None, "seed": 0}
    until = drive(bench, loop, open_driver("simulated", bench, order))
    until(7.9)
    loop.change(Gains(7.0))
    until(9.0)
    loop.change(Gains(8.0))  # replaces gains on trial: held against the first ones all the same
    until(15.9)
    assert loop.controller.gains == loop.parallel.controller.gains == loop.taken_back == Gains(20.0)
    assert not loop.verdict.kept and loop.verdict.ratio > 1.2


@pytest.fixture
def asked(bench):
    """A session without processes whose review says what it is told, and what reached the loop."""
    orders, notes = [], []

    def make(worse):
        review = SimpleNamespace(worse=worse, new=Gains(30.0))
        session = SimpleNamespace(
            tuning=SimpleNamespace(review=review),
            applicable=True,
            events=SimpleNamespace(note=notes.append),
            _pipes=[None, SimpleNamespace(send_bytes=orders.append)],
        )
        return session, orders, notes

    return make


def test_worse_gains_are_applied_when_confirmed_only(asked):
    session, orders, notes = asked(("it hunts",))
    Session.apply(session)
    assert orders == []
    assert notes == ["not applied: it hunts"]
    Session.apply(session, confirmed=True)
    assert len(orders) == 1
    assert "confirmed" in notes[-1]


def test_better_gains_need_no_confirmation(asked):
    session, orders, notes = asked(())
    Session.apply(session)
    assert len(orders) == 1 and notes == []


def answer(itae, last=1.0, hunting=0.0):
    return SimpleNamespace(measures={"itae": itae}, output=[0.0, last], hunting=hunting)


@pytest.mark.parametrize(
    ("identified", "physical", "sensitivity", "words"),
    [
        (answer(0.5), answer(0.5), 1.2, ()),
        (answer(1.1), answer(0.5), 1.2, ("identified model predicts a larger",)),
        (answer(0.5), answer(1.1), 1.2, ("physical model predicts a larger",)),
        (answer(0.5), answer(math.inf, last=math.nan), 1.2, ("predicts a larger", "does not settle")),
        (answer(0.5), answer(0.5, hunting=0.1), 1.2, ("hunts",)),
        (answer(0.5), answer(0.5), 1.6, ("smaller margins",)),
    ],
)
def test_a_review_says_what_speaks_against_new_gains(identified, physical, sensitivity, words):
    old = answer(1.0)
    margins = tuple(SimpleNamespace(maximum_sensitivity=one) for one in (1.4, sensitivity))
    pairs = {"identified": (old, identified), "physical": (old, physical)}
    review = Review(Gains(1.0), Gains(2.0), 1.0, SPAN, pairs, margins, 1.2)
    assert len(review.worse) == len(words)
    for found, expected in zip(review.worse, words, strict=True):
        assert expected in found
    assert review.better is not bool(words)
    assert "Ms 1.4" in review.words


def test_a_reference_that_never_rests_has_episodes_too():
    trial = Trial(SPAN, 0.05)
    ramp = Reference(tuple(n * SPAN for n in range(1000)), tuple(0.001 * n for n in range(1000)))
    for n in range(1000):
        trial.add(n * SPAN, ramp.at(n * SPAN), ramp.at(n * SPAN) - 0.01)
    assert trial.begin() is None  # there is something to compare with


@pytest.mark.parametrize(
    ("asked", "present", "room"), [(1.2, 1.1, 1.2), (1.2, 1.4, 1.4), (1.2, 9.0, 2.0), (3.0, 1.4, 3.0)]
)
def test_new_gains_may_be_as_brisk_as_those_in_use(monkeypatch, asked, present, room):
    case = SimpleNamespace(model=None, gains=Gains(1.0), episode=None, output="position")
    case.task = lambda required, bench: required
    for name, stand_in in {
        "read_rig": lambda path: None,
        "PhysicalBench": lambda *about: None,
        "plant_of": lambda model: None,
        "margins": lambda plant, gains: SimpleNamespace(maximum_sensitivity=present),
        "tune": lambda required, *about: SimpleNamespace(gains=required),
        "review": lambda case, gains, bench, sensitivity: (gains.maximum_sensitivity, sensitivity),
    }.items():
        monkeypatch.setattr(tuning, name, stand_in)
    plan = SimpleNamespace(rig=None, seed=0, sensitivity=asked)
    assert tuning.tuned(case, plan) == (room, room)
