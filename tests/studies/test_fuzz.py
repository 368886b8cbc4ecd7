"""A thousand damaged inputs: none ends in anything but a value or one line, and a fault would be seen."""

import signal

import numpy as np
import pytest

from studies import fuzz


def test_a_thousand_inputs_are_read_or_refused():
    counts = fuzz.fuzz(1000, seed=7)
    assert dict(counts.pop("faults", {})) == {}
    assert sum(counter["refused"] for counter in counts.values()) > 300
    assert sum(counter["read"] for counter in counts.values()) > 100
    assert all(counts[kind]["read"] + counts[kind]["refused"] >= 16 for kind in fuzz.SHARES)


def test_an_input_can_be_repeated():
    sound = b'{"schema": "optid.pid/1", "gains": {"kp": 1.0}}'
    made = [fuzz.mutated(sound, np.random.default_rng((3, n))) for n in range(50)]
    assert made == [fuzz.mutated(sound, np.random.default_rng((3, n))) for n in range(50)]
    assert len(set(made)) > 40


def endless(*_):
    """A loop that a signal can end: one inside C, as `sum` of an endless iterator, hears none."""
    while True:
        pass


@pytest.mark.parametrize(
    ("failing", "words"),
    [
        (lambda *_: 1 / 0, "ZeroDivisionError"),
        (lambda *_: np.ones(2**40), "more than 1 GB"),
        (endless, "more than 1 s"),
    ],
    ids=["bug", "memory", "time"],
)
def test_a_fault_is_seen(failing, words, tmp_path, monkeypatch):
    monkeypatch.setattr(fuzz, "SECONDS", 1)
    before = signal.signal(signal.SIGVTALRM, fuzz._too_long)
    try:
        read = dict.fromkeys(fuzz.SHARES, failing)
        known = {kind: [b"x"] for kind in fuzz.SHARES}
        how, said = fuzz.tried(0, 0, known, read, tmp_path)
    finally:
        signal.signal(signal.SIGVTALRM, before)
    assert how == "fault"
    assert words in said
