"""Pieces of a reference stay in their range, begin and end at rest in its middle, and differ."""

import numpy as np
import pytest

from optid.experiments.pieces import Range, candidates, plain_steps

LOW, HIGH = -0.03, 0.11
ROOM = Range.of(LOW, HIGH)


@pytest.fixture(scope="module", params=[(3000, 1e-3), (150, 0.02)], ids=["1 kHz", "50 Hz"])
def pieces(request):
    return candidates(ROOM, *request.param, np.random.default_rng(3))


def test_they_stay_within_the_limits(pieces):
    for piece in pieces:
        assert piece.reference.min() > LOW, piece.name
        assert piece.reference.max() < HIGH, piece.name


def test_they_begin_and_end_at_rest_in_the_middle(pieces):
    for piece in pieces:
        n = piece.reference.size
        assert np.all(piece.reference[: n // 25] == pytest.approx(0.04)), piece.name
        assert np.all(piece.reference[-n // 8 :] == pytest.approx(0.04)), piece.name


def test_every_name_is_another_reference(pieces):
    assert len({piece.name for piece in pieces}) == len(pieces)
    assert len({piece.reference.tobytes() for piece in pieces}) == len(pieces)


def test_kinds_are_what_their_names_say(pieces):
    by_name = {piece.name: piece.reference - 0.04 for piece in pieces}
    assert not by_name["holding still"].any()
    assert np.abs(by_name["small reversals, ±1 mm"]).max() == pytest.approx(1e-3)
    full = by_name["full strokes, up first"]
    assert (full.max(), full.min()) == (pytest.approx(ROOM.reach), pytest.approx(-ROOM.reach))
    creeping = by_name["slow motion at 10 mm/s"]
    interval = 3.0 / creeping.size
    inner = np.abs(np.diff(creeping))[creeping.size // 10 : creeping.size // 5] / interval
    assert np.median(inner) == pytest.approx(0.01, rel=1e-6)


def test_the_same_seed_gives_the_same_pieces():
    one, same, other = (candidates(ROOM, 300, 0.01, np.random.default_rng(seed)) for seed in (5, 5, 6))
    assert all(np.array_equal(a.reference, b.reference) for a, b in zip(one, same, strict=True))
    assert not all(np.array_equal(a.reference, b.reference) for a, b in zip(one, other, strict=True))


def test_plain_steps_hold_a_second_each():
    steps = plain_steps(ROOM, 800, 0.01)
    assert len(steps) == 800
    assert np.flatnonzero(np.diff(steps)).tolist() == [99, 199, 299, 399, 499, 599, 699]
    assert LOW < steps.min() < steps.max() < HIGH
