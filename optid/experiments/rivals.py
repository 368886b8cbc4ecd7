"""The effects that an experiment must distinguish: named in the call, or left open by a diagnosis."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

from optid.core.document import read_document
from optid.core.paths import is_folder
from optid.effects.effect import Effect
from optid.effects.library import admitted
from optid.errors import InputError, nearest
from optid.rigs.rigfile import Rig

SCHEMA = "optid.diagnosis/1"
# Effects taken from those that a diagnosis could not test: no experiment of some seconds serves more.
MOST = 6


def named(
    names: Sequence[str], rig: Rig, own: Iterable[Effect] = (), where: str = "--rivals"
) -> tuple[Effect, ...]:
    """The effects of these names, in their order.

    Args:
        names: as in a diagnosis.
        rig: must admit them, and have none of them yet.
        own: the user's effects, in addition to the catalogue.
        where: source of the names, for messages.

    Raises:
        InputError: no name, one given twice, one that the rig has already or does not admit.
    """
    possible = {effect.name: effect for effect in admitted(rig.model, own)}
    if not names or not all(names):
        raise InputError("an empty name", where=where, expected='names of effects, "valve_lag,input_delay"')
    for name in names:
        if name in rig.model.effects:
            raise InputError(
                f'the rig file already contains "{name}"',
                where=where,
                expected=f"a rig file without [effects.{name}]",
                hint=f"it was read from {rig.path}",
            )
        if name not in possible:
            raise InputError(
                f'this plant takes no effect "{name}"', where=where, hint=nearest(name, possible)
            )
        if names.count(name) > 1:
            raise InputError(f'"{name}" is given twice', where=where, expected="every effect once")
    return tuple(possible[name] for name in names)


def from_diagnosis(path: Path) -> tuple[str, ...]:
    """Names of the effects that a diagnosis left open.

    The effects found and those that explain the recordings equally well; if none is indistinguishable, the effects
    found and those that its recordings could not show, `MOST` in all.

    Args:
        path: a diagnosis.json, or the folder that holds one.

    Raises:
        InputError: no such file, not one of `optid diagnose`, or it left nothing open.
    """
    path = path / "diagnosis.json" if is_folder(path) else path
    content = read_document(path, SCHEMA, "a diagnosis.json or its folder")
    try:
        findings = [f for f in content["findings"] if f["effect"] is not None]
        rivals = [[f["effect"], *f["indistinguishable_from"]] for f in findings]
        untested = [entry["effect"] for entry in content["not_testable"]]
        if not all(isinstance(name, str) for name in [*untested, *(name for row in rivals for name in row)]):
            raise TypeError("a name of an effect is not a text")
    except (KeyError, TypeError) as error:
        raise InputError(
            f"this is not a complete diagnosis of optid ({error})",
            where=path,
            field="findings",
            expected="a diagnosis.json",
        ) from None
    names = [name for row in rivals for name in row]
    if not any(len(row) > 1 for row in rivals):
        names = [*names, *untested][:MOST]
    if not names:
        raise InputError(
            "this diagnosis left nothing open: it has no finding, and every effect was testable",
            where=path,
            hint="name effects with --rivals",
        )
    return tuple(dict.fromkeys(names))
