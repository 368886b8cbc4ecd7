"""Nothing POSIX-only outside `live`, and there only behind a question whether the system has it."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "optid"
FILES = sorted(PACKAGE.rglob("*.py"))
MODULES = {"fcntl", "grp", "posix", "pty", "pwd", "resource", "syslog", "termios", "tty"}
OF_OS = {
    *("fork", "forkpty", "getuid", "geteuid", "getgid", "getloadavg", "killpg", "mkfifo", "nice", "setsid"),
    *("sched_getaffinity", "sched_setaffinity", "sched_setscheduler", "sysconf", "uname", "wait", "wait4"),
    *("chown", "fchmod", "fchown", "getpgid", "getpriority", "setpriority", "statvfs"),
}
SIGNALS = {
    "SIGALRM",
    "SIGHUP",
    "SIGKILL",
    "SIGQUIT",
    "SIGUSR1",
    "SIGUSR2",
    "setitimer",
    "alarm",
    "pthread_kill",
}


def guarded(parents):
    """Does a question, or what catches an ImportError, an AttributeError or an OSError, stand around it?"""
    for node in parents:
        if isinstance(node, (ast.If, ast.IfExp)) and any(
            asked in ast.unparse(node.test) for asked in ("hasattr", "os.name", "sys.platform")
        ):
            return True
        if isinstance(node, ast.Try) and any(
            "ImportError" in ast.unparse(h.type or ast.Name("")) for h in node.handlers
        ):
            return True
        if isinstance(node, ast.With) and any(
            name in ast.unparse(node.items[0].context_expr) for name in ("AttributeError", "ImportError")
        ):
            return True
    return False


def posix_only(source):
    """Lines that a system without POSIX cannot run."""
    found = []

    def walk(node, parents):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names if alias.name in MODULES]
        elif isinstance(node, ast.ImportFrom):
            names = [node.module] if node.module in MODULES else []
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            of = {"os": OF_OS, "signal": SIGNALS}.get(node.value.id, set())
            names = [f"{node.value.id}.{node.attr}"] if node.attr in of else []
        found.extend(f"{node.lineno}: {name}" for name in names if not guarded(parents))
        for child in ast.iter_child_nodes(node):
            walk(child, [*parents, node])

    walk(ast.parse(source), [])
    return found


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(PACKAGE).as_posix())
def test_nothing_is_posix_only(path):
    assert posix_only(path.read_text(encoding="utf-8")) == []


def test_what_is_posix_only_is_seen():
    assert (
        posix_only("import fcntl")
        and posix_only("import os\nos.fork()")
        and posix_only("import signal\nsignal.alarm(1)")
    )
    assert posix_only("import os\nif ready:\n    os.setsid()")  # not every question is a guard
    assert not posix_only("import os\nif hasattr(os, 'setsid'):\n    os.setsid()")
