"""The study's rig and its verdicts, on the guard alone."""

import pytest

from studies.live_faults import FAULTS, Fault, tried


def test_there_are_twenty_kinds_and_a_server_that_is_away():
    assert len({fault.name for fault in FAULTS}) >= 20
    assert [fault.seconds for fault in FAULTS if "away" in fault.name] == [0.1, 0.5, 2.0, 5.0, 10.0]


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (Fault("away", "link", seconds=0.2), ""),
        (Fault("refused", "write", "refuse", old=True), "PermissionError"),
        (Fault("infinite", "read", "inf"), "position reads inf"),
    ],
)
def test_the_rig_ends_at_the_safe_command(fault, words):
    row = tried(fault, quick=True)
    assert (row.safe, row.said_safe) == (True, True)
    assert words in row.why
