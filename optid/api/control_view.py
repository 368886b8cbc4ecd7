"""Models from and to python-control."""

from __future__ import annotations

from typing import Any

from optid.armax.files import ArmaxFile, SavedModel
from optid.armax.model import from_transfer_function
from optid.errors import InputError


def from_control(
    system: Any,
    *,
    input: str = "command",
    output: str = "position",
    input_unit: str = "V",
    output_unit: str = "m",
    noise: float = 0.0,
) -> ArmaxFile:
    """A discrete system of python-control as a model that `tune` takes.

    Parameters
    ----------
    system : Any
        one input, one output, with a sample time.
    input : str
        role of its input; `output` likewise.
    output : str
        role of its output.
    input_unit : str
        SI unit of its input; `output_unit` likewise.
    output_unit : str
        SI unit of its output.
    noise : float
        standard deviation of the model's error, output's unit.

    Returns
    -------
    ArmaxFile
        the model, as `tune` takes it.

    Raises
    ------
    InputError
        a continuous or improper system, one without a sample time, or with several signals.
    """
    import control

    if getattr(system, "ninputs", 1) != 1 or getattr(system, "noutputs", 1) != 1:
        raise InputError("several inputs or outputs", field="system", expected="one of each")
    if not system.dt or system.dt is True:
        raise InputError(f"dt = {system.dt}", field="system", expected="a discrete system with a sample time")
    model = from_transfer_function(control.tf(system))
    if noise:
        from dataclasses import replace

        model = replace(model, noise_variance=noise**2)
    words = f"Taken from the system {system.name}."
    return ArmaxFile(input, output, model.orders.na, (SavedModel(model),), words, input_unit, output_unit)
