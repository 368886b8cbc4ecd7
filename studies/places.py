"""Places where results go, or cannot go: mount points, full disks, other users, no home, and what happens at the end.

    unshare -m python -m studies.places [NAME...]

Needs a Linux machine, and to be root in a mount namespace of its own. Prints one line per place: whether results came
where they were wanted, or the call was refused before any work, or, where a place refused at the end, they were kept
whole elsewhere; and how many of the places ended as they should.
"""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RIG, ROWS = ROOT / "data" / "bench.toml", 400
NOBODY, STRANGER = 65534, 54321  # the latter has no entry in the user database
SET = {"metrics.json", "prediction.csv", "report.html", "manifest.json", "tables.npz"}

# The command line with something that happens after the work and before the writing, and, where caches do not
# matter, without the work.
PROGRAM = """
import logging, os, subprocess, sys
import optid.cli
logging.getLogger("matplotlib").setLevel(logging.ERROR)  # as the command does, before what follows imports it
command = sys.modules["optid.cli.simulate"]
late, quick = os.environ.pop("LATE", ""), os.environ.pop("QUICK", "")
if late:
    real = command.deliver
    def deliver(folder, write):
        subprocess.run(late, shell=True, check=True)
        real(folder, write)
    command.deliver = deliver
if quick:
    import optid.api.simulating, pandas
    from optid.results.simulation import SimulationResult
    score = {"fit_percent": 99.0, "rmse": 1e-5, "unit": "m"}
    document = {
        "schema": "optid.simulation/1", "position": {"window": score, "free_run": score},
        "about": {"horizon": 0.5, "starts": [], "notes": []},
    }
    table = pandas.DataFrame({"recording": "run", "time": range(5000)})
    result = SimulationResult(document, {"prediction": table}, {"report.html": "<html>"})
    from optid.api.inputs import given, rig_of
    def read_only(rig, recording, **_):
        given(rig_of(rig), recording)
        return result
    optid.api.simulating.simulate = read_only
from optid.cli import main
main()
"""


@dataclass(frozen=True)
class Place:
    """A place and what should come of it.

    Attributes:
        name: of the place.
        expected: "right", "refused" or "elsewhere".
        before: shell commands that make it, in its folder.
        out: what `--out` says, relative to the folder.
        late: shell commands that run when the results are about to be written.
        user: who writes.
        environment: variables to set; an empty one is removed.
        quick: the work itself does not matter.
    """

    name: str
    expected: str
    before: str = ""
    out: str = "out"
    late: str = ""
    user: int = 0
    environment: dict[str, str] = field(default_factory=dict)
    quick: bool = True


DEEP = "/".join(["d" * 200] * 19)
FULL = "mkdir out; mount -t tmpfs -o size=200k tmpfs out; dd if=/dev/zero of=out/filler bs=1k 2>/dev/null || true"
PLACES = (
    Place("new folder", "right"),
    Place("new folders in new folders", "right", out="a/b/c"),
    Place("empty folder", "right", "mkdir out"),
    Place("folder with earlier results", "right", "cp -r old out"),
    Place("name with blanks and letters of other alphabets", "right", out="my results ü λ 2"),
    Place("name of 255 bytes", "right", out="n" * 255),
    Place("name of 256 bytes", "refused", out="n" * 256),
    Place("path of nearly 4096 bytes", "refused", out=f"{DEEP}/{'d' * 190}"),
    Place("mount point", "right", "mkdir out; mount -t tmpfs tmpfs out"),
    Place(
        "mount point in a read-only parent",
        "right",
        "mkdir -p ro/out; mount -t tmpfs tmpfs ro; mkdir ro/out; mount -t tmpfs tmpfs ro/out; mount -o remount,ro ro",
        "ro/out",
    ),
    Place("own folder, parent without permission", "right", f"mkdir out; chown {NOBODY} out", user=NOBODY),
    Place("new folder, parent without permission", "refused", user=NOBODY),
    Place("folder of another user", "refused", "mkdir out", user=NOBODY),
    Place("read-only file system", "refused", "mkdir out; mount -t tmpfs -o ro tmpfs out"),
    Place("immutable folder", "refused", "mkdir out; chattr +i out"),
    Place("full disk", "refused", FULL),
    Place(
        "no inodes left", "refused", "mkdir out; mount -t tmpfs -o nr_inodes=3 tmpfs out; touch out/a out/b"
    ),
    Place(
        "disk that is full at the end",
        "elsewhere",
        "mkdir out; mount -t tmpfs -o size=8m tmpfs out; cp old/* out",
        late="dd if=/dev/zero of=out/filler bs=1k 2>/dev/null || true",
    ),
    Place(
        "read-only at the end",
        "elsewhere",
        "mkdir out; mount -t tmpfs tmpfs out; cp old/* out",
        late="mount -o remount,ro out",
    ),
    Place(
        "permission withdrawn at the end",
        "elsewhere",
        f"cp -r old out; chown -R {NOBODY} out .",
        user=NOBODY,
        late="chmod 555 out",
    ),
    Place("folder that is gone at the end", "right", "mkdir out", late="rm -rf out"),
    Place("folder in the way", "refused", "mkdir -p out/report.html"),
    Place("folder in the way at the end", "elsewhere", "mkdir out", late="mkdir out/report.html"),
    Place("link to a folder", "right", "mkdir there; ln -s there out"),
    Place("link to nowhere yet", "right", "ln -s there out"),
    Place("link to itself", "refused", "ln -s out out"),
    Place("a file", "refused", "touch out"),
    Place("below a file", "refused", "touch file", "file/out"),
    Place("a device", "refused", out="../../../../../../../dev/null"),
    Place("folder of a run that goes on", "refused", "mkdir out; flock out sleep 60 & sleep 0.3"),
    Place(
        "what a killed run left",
        "right",
        "cp -r old out; mkdir -p out/.optid-new-x/old; touch out/.optid-new-x/y",
    ),
    Place("earlier results from the future", "right", "cp -r old out; touch -d 2099-01-01 out/*"),
    Place("no folder for temporary files", "right", environment={"TMPDIR": "/nowhere"}),
    Place(
        "no home, no name",
        "right",
        f"mkdir out; chown {STRANGER} out",
        user=STRANGER,
        quick=False,
        environment={"HOME": "", "XDG_CACHE_HOME": ""},
    ),
    Place(
        "read-only home",
        "right",
        "mkdir home; mount -t tmpfs -o ro tmpfs home",
        quick=False,
        environment={"HOME": "home", "XDG_CACHE_HOME": ""},
    ),
    Place(
        "full disk for caches",
        "right",
        FULL.replace("out", "full"),
        quick=False,
        environment={"XDG_CACHE_HOME": "full"},
    ),
    Place(
        "read-only everything but the folder",
        "right",
        "mkdir out; mount -t tmpfs tmpfs out; mount --bind / /mnt; mount -o remount,ro,bind / ; "
        "for m in /tmp /dev/shm /var/tmp; do mount --rbind $m $m; mount -o remount,ro,bind $m; done",
        quick=False,
        environment={"HOME": "/root", "XDG_CACHE_HOME": ""},
    ),
    Place(
        "damaged caches",
        "right",
        'cp -r "$XDG_CACHE_HOME" cache; find cache -type f | while read f; do head -c 200 /dev/urandom > "$f"; done',
        quick=False,
        environment={"XDG_CACHE_HOME": "cache"},
    ),
)


def listing(folder: Path) -> dict[str, str]:
    """What stands in a folder: path -> digest of a file, target of a link, or "" for a folder."""
    found = {}
    for path in sorted(folder.rglob("*")):
        name = str(path.relative_to(folder))
        if path.is_symlink():
            found[name] = os.readlink(path)  # noqa: PTH115
        elif path.is_file():
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        else:
            found[name] = ""
    return found


def whole(folder: Path) -> str:
    """What is wrong with a set of results; nothing if it is whole."""
    try:
        told = json.loads((folder / "manifest.json").read_text())
    except (OSError, ValueError) as error:
        return f"no manifest ({error})"
    wrong = [
        name
        for name, digest in told["files"].items()
        if hashlib.sha256((folder / name).read_bytes()).hexdigest() != digest
    ]
    litter = {path.name for path in folder.iterdir()} - SET
    return f"not as the manifest says: {wrong}; beside them: {litter}" if wrong or litter else ""


def judged(place: Place, folder: Path, before: dict[str, str], done: subprocess.CompletedProcess[str]) -> str:
    """What is wrong; nothing if all is as it should be."""
    said = done.stderr.strip()
    if "\n" in said or "Traceback" in said or "bug" in said:
        return f"said {said!r}"
    if place.expected == "right":
        return whole(folder / place.out) if done.returncode == 0 else f"exit {done.returncode}: {said}"
    if place.expected == "refused":
        changed = listing(folder) != before
        return (
            f"exit {done.returncode}: {said}"
            if done.returncode != 2
            else "it left something"
            if changed
            else ""
        )
    if done.returncode != 1 or "they are all in " not in said:
        return f"exit {done.returncode}: {said}"
    after = {name: digest for name, digest in listing(folder / "out").items() if name in SET and digest}
    old = {name.removeprefix("out/"): d for name, d in before.items() if name.startswith("out/") and d}
    kept = Path(said.rpartition("they are all in ")[2])
    return whole(kept) or ("" if after == old else "the old set has changed")


@contextmanager
def made(place: Place, home: Path, old: Path) -> Iterator[Path]:
    """The place, in a mount namespace of its own with whatever it mounts."""
    folder = home / f"{PLACES.index(place):02}"
    folder.mkdir(mode=0o755)
    subprocess.run(["cp", "-r", str(old), str(folder / "old")], check=True)
    yield folder


def tried(place: Place, home: Path, old: Path, recording: Path) -> str:
    """Make a place, run the command there, and say what is wrong."""
    with made(place, home, old) as folder:
        if place.before:
            subprocess.run(place.before, shell=True, check=True, cwd=folder)
        before = listing(folder)
        environment = {
            **os.environ,
            "PYTHONPATH": str(ROOT),
            "PYTHONDONTWRITEBYTECODE": "1",
            "LATE": place.late,
        }
        environment["QUICK"] = "1" if place.quick else ""
        for name, value in place.environment.items():
            environment.pop(name, None)
            if value:
                environment[name] = value if value.startswith("/") else str(folder / value)
        call = [sys.executable, "-c", PROGRAM, "simulate", str(RIG), str(recording), "--out", place.out]
        if place.user:
            call = ["setpriv", f"--reuid={place.user}", f"--regid={place.user}", "--clear-groups", *call]
        done = subprocess.run(call, cwd=folder, env=environment, capture_output=True, text=True, check=False)
        return judged(place, folder, before, done)


def in_namespace(name: str, home: Path, old: Path, recording: Path) -> str:
    """The same in a process with mounts of its own, which end with it."""
    call = [
        "unshare",
        "-m",
        sys.executable,
        "-m",
        "studies.places",
        "--one",
        name,
        *map(str, (home, old, recording)),
    ]
    done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else f"the study failed: {done.stderr.strip()[-300:]}"


def now(words: str) -> None:
    """Print at once: a place takes half a minute."""
    print(words, flush=True)


def main(arguments: Sequence[str], say: Callable[[str], None] = now) -> None:
    """Try all places, or those named."""
    if arguments[:1] == ["--one"]:
        name, *paths = arguments[1:]
        say(tried(next(place for place in PLACES if place.name == name), *map(Path, paths)))
        return
    chosen = [place for place in PLACES if not arguments or place.name in arguments]
    with tempfile.TemporaryDirectory(dir="/tmp", prefix="places-") as text:
        home = Path(text)
        home.chmod(0o755)
        recording, old = home / "run.csv", home / "old"
        lines = RIG.with_name("bench.csv").read_text().splitlines()
        recording.write_text("\n".join(lines[: ROWS + 1]) + "\n")
        call = [sys.executable, "-m", "optid.cli", "simulate", str(RIG), str(recording), "--out", str(old)]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "XDG_CACHE_HOME": str(home / "caches")}
        subprocess.run(call, check=True, capture_output=True, env=environment)
        os.environ["XDG_CACHE_HOME"] = environment["XDG_CACHE_HOME"]
        right = 0
        for place in chosen:
            wrong = in_namespace(place.name, home, old, recording)
            right += not wrong
            say(f"{place.name:50} {place.expected:10} {wrong or 'as it should be'}")
        subprocess.run(f"chattr -R -i {shlex.quote(text)} 2>/dev/null", shell=True, check=False)
        say(f"{right} of {len(chosen)} places as they should be")


if __name__ == "__main__":
    main(sys.argv[1:])
