"""Parameters with a value per recording or per group of recordings: a payload, a load, a gain.

`[fit]` says `per = "recording"`, or the name of a tag that `[recordings]` gives to each file. The model then has such
a parameter once for each group, and an input that tells a recording's group; nothing else of a fit or a diagnosis
differs. A recording of an unknown group has the groups' mean.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.declarations import GROUP, group_role, member
from optid.core.model import Model, Port
from optid.core.recording import Channel, Recording
from optid.errors import RigError
from optid.rigs.rigfile import Freed, Rig, rebuilt

EACH = "recording"  # value of `per` where every recording is a group


def for_recordings(rig: Rig, recordings: Sequence[Recording]) -> Rig:
    """The rig with the own parameters of these recordings; the rig itself where there are none.

    Parameters
    ----------
    rig : Rig
        as read.
    recordings : Sequence[Recording]
        to fit to, or to simulate.

    Raises
    ------
    RigError
        a recording has no value of a tag on which a parameter depends.
    """
    per = _per(rig)
    if not per or rig.groups:
        return rig
    files = [one.name for one in recordings]
    labels = {
        name: tuple(dict.fromkeys(_label(rig, way, file, name) for file in files))
        for name, way in per.items()
    }
    parameters = {name: value for name, value in rig.parameters.items() if name not in per}
    for name, way in per.items():
        for file in files:
            own = rig.recordings.get(file, {}).get(name, rig.parameters.get(name))
            if own is not None:
                parameters[member(name, _label(rig, way, file, name))] = float(own)
    freed: list[Freed] = []
    for f in rig.freed:
        freed += [replace(f, name=member(f.name, label)) for label in labels.get(f.name, ())] or [f]
    return rebuilt(replace(rig, parameters=parameters, freed=tuple(freed), groups=labels, plain=rig))


def told(rig: Rig, recording: Recording) -> Recording:
    """The recording with inputs that say to which groups it belongs."""
    if rig.plain is None:
        return recording
    per = _per(rig.plain)
    own = {_own_label(rig.plain, way, recording.name) for way in per.values()}
    channels = dict(recording.channels)
    for label in dict.fromkeys(label for labels in rig.groups.values() for label in labels):
        role, count = group_role(label), len(recording.time)
        channels[role] = Channel(role, "", "1", np.full(count, float(label in own)), held=True)
    return replace(recording, channels=channels)


def stated(rig: Rig, values: Mapping[str, float], files: Sequence[str]) -> dict[str, dict[str, float]]:
    """The values of `[recordings]` for each of these files: name -> SI value."""
    per = _per(rig.plain) if rig.plain else {}
    found: dict[str, dict[str, float]] = {}
    for file in files:
        for name, way in per.items():
            key = member(name, _own_label(rig.plain, way, file) if rig.plain else "")
            if key in values:
                found.setdefault(file, {})[name] = values[key]
    return found


def measured_inputs(model: Model) -> tuple[Port, ...]:
    """The inputs that come from a file, without those that only mark groups."""
    return tuple(port for port in model.recorded if not port.role.startswith(GROUP))


def _per(rig: Rig) -> dict[str, str]:
    """Name of a parameter -> its `per`."""
    known = {q.name for q in rig.model.parameters}
    own = {key for entry in rig.recordings.values() for key in entry if key in known}
    return dict.fromkeys(sorted(own), EACH) | {f.name: f.per for f in rig.freed if f.per}


def _own_label(rig: Rig, way: str, file: str) -> str:
    """The group of a file for one `per`, or nothing."""
    if way == EACH:
        return Path(file).stem.replace(".", "_")
    tag: Any = rig.recordings.get(file, {}).get(way, "")
    return f"{way} {tag}" if tag != "" else ""


def _label(rig: Rig, way: str, file: str, name: str) -> str:
    label = _own_label(rig, way, file)
    if not label:
        raise RigError(
            f'"{file}" has no tag "{way}", on which {name} depends',
            where=rig.path,
            field="recordings",
            expected=f'"{file}" = {{ {way} = "..." }}',
        )
    return label
