"""A process killed at each file operation of writing results, one after the other; prints what was found wrong.

Run as a program of its own: it forks, which a process with threads must not. At the n-th call into the operating
system the writing process ends by SIGKILL; then the folder is read back, and the next run looks after it.
"""

import json
import os
import signal
import sys
import tempfile
from pathlib import Path

from optid.cli.results import deliver, results_folder
from optid.core.resultset import MANIFEST, located

OLD = {"a.json": '{"is": "old"}', "b.csv": "old", "gone.h": "old"}
NEW = {"a.json": '{"is": "new"}', "b.csv": "new", "more.st": "new"}


def write(content):
    def into(place):
        for name, text in content.items():
            (place / name).write_text(text)

    return into


def state(text):
    return json.loads(text)["is"] if text.startswith("{") else text


def seen(folder, place=located):
    """What each name of either set holds, as a reader finds it."""
    found = {}
    for name in (*OLD, "more.st"):
        path = place(folder / name)
        found[name] = state(path.read_text()) if path.is_file() else None
    return found


WHOLE = (
    {"a.json": "old", "b.csv": "old", "gone.h": "old", "more.st": None},
    {"a.json": "new", "b.csv": "new", "gone.h": None, "more.st": "new"},
)


def kill_at(number, work):
    """Fork, and end the child before its n-th call into the operating system; whether it came so far."""
    child = os.fork()
    if child:
        _, status = os.waitpid(child, 0)
        return os.WIFSIGNALED(status)
    count = 0

    def watch(frame, event, what):
        nonlocal count
        owner = getattr(what, "__self__", None)
        if event == "c_call" and (
            getattr(owner, "__name__", "") == "posix" or type(owner).__module__ == "_io"
        ):
            count += 1
            if count == number:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.setprofile(watch)
    work()
    sys.setprofile(None)
    os._exit(0)


def trial(number, home):
    """What is wrong after a kill at this operation; ``None`` when the work was done before it."""
    folder = home / f"out{number}"
    deliver(folder, write(OLD))
    if not kill_at(number, lambda: deliver(folder, write(NEW))):
        return None
    wrong = []
    readable = seen(folder)
    if readable not in WHOLE:
        wrong.append(f"read back as {readable}")
    results_folder(str(folder))  # the next run
    if seen(folder, place=lambda path: path) not in WHOLE:
        wrong.append(f"repaired to {seen(folder, place=lambda path: path)}")
    names = {path.name for path in folder.iterdir()}
    if litter := names - {*OLD, *NEW, MANIFEST}:
        wrong.append(f"litter {litter}")
    return wrong


def main():
    number, faults = 1, 0
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None  # many files, all of them short-lived
    with tempfile.TemporaryDirectory(dir=memory) as home:
        while (wrong := trial(number, Path(home))) is not None:
            for words in wrong:
                sys.stdout.write(f"operation {number}: {words}\n")
            faults += bool(wrong)
            number += 1
    sys.stdout.write(f"{number - 1} operations, {faults} faults\n")


main()
