"""A job of a fleet: one command of optid on one rig and its recordings, with limits. Only plain data."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from optid.core.paths import digest_of
from optid.errors import InputError, nearest
from optid.rigs.programs import programs

Option = str | int | float | bool | list[str] | list[int] | list[float]

COMMANDS = ("check", "simulate", "fit", "diagnose", "identify", "tune", "test")
MEMORY = 2 * 2**30  # bytes: a diagnosis of four recordings of 8 s at 1 kHz takes a fifth of it
TIME_LIMIT = 1800.0  # s of the process's own time: twice what a diagnosis allows its search
# Times the time limit by the clock, when no deadline is stated: a loaded machine is slow, not dead.
PATIENCE = 4.0
_NAME = re.compile(r"[^A-Za-z0-9._+-]+")


@dataclass(frozen=True)
class Limits:
    """What a job's process may take before it is killed.

    Attributes
    ----------
    threads : int
        that compute.
    memory : int
        bytes, resident, of the process and all it starts.
    time_limit : float
        s of the process's own time, so that load does not change an outcome.
    deadline : float
        s by the clock.
    retries : int
        times that a job is begun again after a crash; what runs out of memory or time would do so again.
    """

    threads: int = 1
    memory: int = MEMORY
    time_limit: float = TIME_LIMIT
    deadline: float = PATIENCE * TIME_LIMIT
    retries: int = 1


@dataclass(frozen=True)
class Job:
    """One row of a fleet.

    Attributes
    ----------
    name : str
        of the row and of its folder.
    command : str
        one of `COMMANDS`.
    rig : str
        path of the rig file; a relative path, of any file, starts at the current folder, and is kept whole.
    train : tuple[str, ...]
        paths of the recordings; of the model's JSON file for "tune".
    holdout : tuple[str, ...]
        paths of the recordings held out.
    tags : Mapping[str, str]
        what else is known of the row: line, valve type, `date`.
    options : Mapping[str, Option]
        of the command, by their names on its command line: a flag is true or false, a list repeats its option.
    limits : Limits
        of its process.
    """

    name: str
    command: str
    rig: str
    train: tuple[str, ...]
    holdout: tuple[str, ...] = ()
    tags: Mapping[str, str] = field(default_factory=dict)
    options: Mapping[str, Option] = field(default_factory=dict)
    limits: Limits = field(default_factory=Limits)

    def __post_init__(self) -> None:
        """Refuse what no process could be started for; complete the paths.

        Raises
        ------
        InputError
            an unknown command, or a name that is none for a folder.
        """
        if self.command not in COMMANDS:
            raise InputError(
                f'unknown job "{self.command}"',
                where=self.name,
                field="job",
                hint=nearest(self.command, COMMANDS),
            )
        if self.name != folder_name(self.name):
            raise InputError(
                f'"{self.name}" cannot name a folder', field="name", expected="A-Z a-z 0-9 . _ + -"
            )
        for name in ("rig", "train", "holdout"):  # its process runs in a folder of its own
            given = getattr(self, name)
            whole = [str(Path(one).absolute()) for one in ([given] if isinstance(given, str) else given)]
            object.__setattr__(self, name, whole[0] if isinstance(given, str) else tuple(whole))

    def document(self) -> dict[str, Any]:
        """The job as plain data, as it is sent to a worker.

        Returns
        -------
        dict[str, Any]
            the attributes; `of` makes a job of it again.
        """
        return asdict(self)

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Job:
        """A job from its plain data.

        Parameters
        ----------
        document : Mapping[str, Any]
            as `document` returned it.

        Returns
        -------
        Job
            equal to the one that was written.
        """
        limits = Limits(**document["limits"])
        train, holdout = tuple(document["train"]), tuple(document["holdout"])
        return cls(**{**document, "limits": limits, "train": train, "holdout": holdout})

    def arguments(self, out: Path) -> list[str]:
        """The arguments of `optid` on the command line that does this job.

        Parameters
        ----------
        out : Path
            folder for its results.

        Returns
        -------
        list[str]
            one argument each.
        """
        if self.command == "identify":
            call = ["identify", *self.train, "--rig", self.rig]
        elif self.command == "tune":
            call = ["tune", *self.train, "--rig", self.rig]
        elif self.command == "test":
            call = ["fleet", "test", self.rig, *self.train]
        else:
            call = [self.command, self.rig, *self.train]
        for one in self.holdout:
            call += ["--holdout", one]
        call += [word for name, value in self.options.items() for word in _option(name, value)]
        return [*call, "--out", str(out), "--threads", str(self.limits.threads), "--progress", "none"]


def folder_name(text: str) -> str:
    """A text as the name of a folder: what no file system minds, at most 120 characters."""
    return _NAME.sub("-", text).strip("-.")[:120]


def _option(name: str, value: Option) -> list[str]:
    word = f"--{name.replace('_', '-')}"
    if isinstance(value, bool):
        return [word] if value else []
    if isinstance(value, list):
        return [part for one in value for part in (word, str(one))]
    return [f"{word}={value}"]


def inputs_of(job: Job) -> dict[str, str | None]:
    """SHA-256 of all files that a job reads, by path; ``None`` for one that cannot be read."""
    paths = [Path(job.rig), *programs(Path(job.rig)), *map(Path, (*job.train, *job.holdout))]
    for name in ("validate", "effects"):
        value = job.options.get(name, [])
        paths += [Path(str(one)) for one in (value if isinstance(value, list) else [value])]
    return {str(path): digest_of(path) for path in dict.fromkeys(paths)}


def key_of(job: Job, inputs: Mapping[str, str | None], version: str) -> str:
    """What a row's answer depends on: its command, rig, recordings, options, tags and the version, as one hash.

    The limits are not in it: they decide whether there is an answer, not which.
    """
    content = {name: value for name, value in job.document().items() if name != "limits"}
    text = json.dumps({"job": content, "inputs": dict(inputs), "version": version}, sort_keys=True)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()
