"""A message is one line that a terminal bears, whatever a file holds."""

import time

from optid.errors import LONGEST, RecordingError, nearest, one_line


def test_a_message_of_megabytes_is_cut_in_its_middle():
    began = time.process_time()
    message = str(RecordingError("x" * 4_000_000 + "\n the end", where="run.csv", expected="less"))
    assert time.process_time() - began < 1.0
    assert len(message) <= LONGEST + 5
    assert message.startswith("run.csv: xxx")
    assert message.endswith("expected less")


def test_what_a_terminal_would_obey_is_left_out():
    assert one_line("a\x1b[31m\r\nb\u2028c\x00") == "a [31m b c"


def test_hundreds_of_thousands_of_names_are_not_all_compared():
    began = time.process_time()
    said = nearest("q" * 100_000, [f"column {k}" for k in range(200_000)])
    assert time.process_time() - began < 2.0
    assert said.endswith("and 199960 more")
    assert nearest("comand", ["command", "position"]) == 'did you mean "command"?'
