"""Conditions on the parameters of a plant: rig files that break one describe nothing that can be built."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from optid.core.model import Constraint, Model
from optid.errors import RigError


def broken(model: Model, parameters: Mapping[str, float]) -> tuple[Constraint, ...]:
    """The constraints that do not hold.

    Args:
        model: the plant's.
        parameters: SI values by name; defaults for the others.
    """
    if not model.constraints:
        return ()
    p = model.vector(parameters)
    return tuple(constraint for constraint in model.constraints if not constraint.holds(p))


def refuse_contradictions(
    model: Model, parameters: Mapping[str, float], path: Path, table: str = "parameters"
) -> None:
    """Refuse values that contradict each other; `table` of the rig file states the last of them.

    Raises:
        RigError: names the parameters with their values, and the condition.
    """
    for constraint in broken(model, parameters):
        p = model.vector(parameters)
        units = {q.name: "" if q.unit == "1" else f" {q.unit}" for q in model.parameters}
        found = ", ".join(
            f"{name} = {p[model.index(name)]:.6g}{units[name]}" for name in constraint.parameters
        )
        stated = next((name for name in constraint.parameters if name in parameters), "")
        field = f"parameters.{stated}".rstrip(".") if table == "parameters" else table
        raise RigError(
            f"{found} cannot be",
            where=path,
            field=field,
            expected=constraint.words,
        )
