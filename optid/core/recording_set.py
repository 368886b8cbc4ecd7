"""Several recordings of one rig, none of them given twice, each with its own name."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from optid.core.recording import Recording
from optid.errors import RecordingError, nearest


@dataclass(frozen=True, eq=False)
class Experiments:
    """Recordings of one rig, with unique names.

    Build it with `Experiments.of`, which gives two files of the same name names of their own.
    """

    recordings: tuple[Recording, ...]

    @classmethod
    def of(cls, recordings: Iterable[Recording]) -> Experiments:
        """Collect recordings: equal file names get their folder in front, and a number if that does not help.

        Raises
        ------
        RecordingError
            the same samples twice (same columns of the same bytes, overlapping times).
        """
        given = tuple(recordings)
        for i, recording in enumerate(given):
            for other in given[:i]:
                if _same_samples(recording, other):
                    raise RecordingError(
                        "these samples are given twice and would count twice", where=recording.name
                    )
        names = _told_apart(given)
        return cls(tuple(dataclasses.replace(r, name=n) for r, n in zip(given, names, strict=True)))

    def __len__(self) -> int:
        return len(self.recordings)

    def __iter__(self) -> Iterator[Recording]:
        return iter(self.recordings)

    def __getitem__(self, name: str) -> Recording:
        for recording in self.recordings:
            if recording.name == name:
                return recording
        raise RecordingError(f'no recording "{name}"', hint=nearest(name, (r.name for r in self)))


def _same_samples(a: Recording, b: Recording) -> bool:
    """The same columns of the same bytes over times that overlap."""
    if a.provenance is None or b.provenance is None or a.provenance.sha256 != b.provenance.sha256:
        return False
    overlap = a.time[0] <= b.time[-1] and b.time[0] <= a.time[-1]
    return bool(overlap) and dict(a.provenance.columns) == dict(b.provenance.columns)


def _told_apart(recordings: tuple[Recording, ...]) -> list[str]:
    names = [recording.name for recording in recordings]
    count = Counter(names)
    for i, recording in enumerate(recordings):
        if count[names[i]] > 1 and recording.provenance is not None:
            names[i] = f"{recording.provenance.path.resolve().parent.name}/{names[i]}"
    used: Counter[str] = Counter()
    for i, name in enumerate(names):
        used[name] += 1
        if used[name] > 1:
            names[i] = f"{name} ({used[name]})"
    return names
