"""A rig's model as an FMU (FMI 3.0, model exchange), for Simulink, Modelica tools and FMPy.

CasADi writes the model description and the C code; FMPy has the standard's headers, and a C compiler builds the
binary for the machine at hand. CasADi calls its export experimental, so the description is corrected here where FMPy's
check finds it wrong: names that are the exporter's own, and states that had no start value.
"""

from __future__ import annotations

import contextlib
import re
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import casadi as ca
import numpy as np

from optid.api.inputs import rig_of
from optid.core.model import CLOCK, INTERVAL, Model
from optid.errors import InputError, JobError
from optid.rigs.rigfile import Rig

PLATFORMS = {"linux": ("x86_64-linux", ".so"), "darwin": ("x86_64-darwin", ".dylib")}


def export_fmu(rig: str | Path | Rig, path: str | Path, *, start: Mapping[str, float] | None = None) -> Path:
    """Write a rig's model with its parameters as an FMU.

    Inputs and outputs are named by their roles, states "state_NAME", parameters by their own names; all in SI units, a
    command with a full scale as a share of it.

    Parameters
    ----------
    rig : str | Path | Rig
        a rig file, or what `read_rig` made of one.
    path : str | Path
        of the FMU.
    start : Mapping[str, float] | None
        SI values of states at the start; where a record would start when absent.

    Returns
    -------
    Path
        The path.

    Raises
    ------
    InputError
        the model has inputs that an FMU cannot have (past samples, the time between them), or an unknown
        state.
    JobError
        FMPy or a C compiler is missing, or the compiler fails.
    """
    understood, target = rig_of(rig), Path(path).resolve()
    model = understood.model
    strange = [port.role for port in model.inputs if port.ago or port.role in (CLOCK, INTERVAL)]
    if strange or model.halves is not None:
        raise InputError(
            f"the model uses {', '.join(strange) or 'delayed commands'}",
            where=understood.path,
            expected="a model that uses only the present command",
            hint="leave out effects that delay the command or count time",
        )
    values = model.vector(understood.parameters)
    begin = _start(model, values, start or {})
    name = re.sub(r"\W", "_", understood.name)
    with tempfile.TemporaryDirectory() as place:
        with contextlib.chdir(place):
            _builder(model, name, values, begin).export_fmu({"no_warning": True, "with_serialization": False})
        folder = Path(place)
        description = _mended(folder / "modelDescription.xml", begin, model)
        binary = _compiled(folder, name)
        _pack(target, folder, name, description, binary)
    return target


def _start(model: Model, values: np.ndarray, stated: Mapping[str, float]) -> dict[str, float]:
    names = [state.name for state in model.states]
    unknown = [name for name in stated if name not in names]
    if unknown:
        raise InputError(f'no state "{unknown[0]}"', field="start", expected=", ".join(names))
    mean = np.array(model.start(values)[0]).ravel()
    return {**dict(zip(names, mean.tolist(), strict=True)), **stated}


def _builder(model: Model, name: str, values: np.ndarray, begin: Mapping[str, float]) -> ca.DaeBuilder:
    dae = ca.DaeBuilder(name, "", {})
    p = [
        dae.add(q.name.replace(".", "_"), "parameter", "tunable", {"start": float(v)})
        for q, v in zip(model.parameters, values, strict=True)
    ]
    u = [dae.add(port.role, "input", "continuous", {"start": 0.0}) for port in model.inputs]
    x = [dae.add(f"state_{state.name}", {"start": begin[state.name]}) for state in model.states]
    given = (ca.vertcat(*x), ca.vertcat(*u), ca.vertcat(*p))
    for state, rate in zip(x, ca.vertsplit(model.rates(*given)), strict=True):
        dae.eq(dae.der(state), rate)
    for port, value in zip(model.outputs, ca.vertsplit(model.sensors(*given)), strict=True):
        dae.eq(dae.add(port.role, "output", {}), value)
    return dae


def _mended(file: Path, begin: Mapping[str, float], model: Model) -> bytes:
    """The description as the standard requires it, with units in the variables' descriptions."""
    tree = ElementTree.parse(file)
    root = tree.getroot()
    root.set("variableNamingConvention", "flat")
    root.set("generationTool", "optid with CasADi")
    variables = root.find("ModelVariables")
    assert variables is not None
    units = {
        **{port.role: port.unit for port in (*model.inputs, *model.outputs)},
        **{q.name.replace(".", "_"): q.unit for q in model.parameters},
        **{f"state_{state.name}": state.unit for state in model.states},
    }
    for variable in list(variables):
        name = variable.get("name", "")
        if name.startswith("__"):
            variables.remove(variable)
        elif name in units:
            variable.set("description", f"in {units[name]}")
        if name.startswith("state_"):
            variable.set("initial", "exact")
            variable.set("start", repr(begin[name.removeprefix("state_")]))
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True))


def _compiled(folder: Path, name: str) -> Path:
    try:
        import fmpy
    except ImportError:
        raise JobError('an FMU needs the headers that FMPy brings: pip install "optid[fmu]"') from None
    compiler = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
    if compiler is None:
        raise JobError("an FMU needs a C compiler: none of cc, gcc, clang is on the path")
    headers = Path(fmpy.__file__).parent / "c-code"
    binary = folder / f"{name}{_platform()[1]}"
    call = [
        compiler,
        "-O2",
        "-shared",
        "-fPIC",
        f"-I{headers}",
        f"{name}.c",
        f"{name}_wrap.c",
        "-o",
        str(binary),
        "-lm",
    ]
    made = subprocess.run(call, cwd=folder, capture_output=True, text=True, check=False)
    if made.returncode:
        raise JobError(f"the compiler failed: {made.stderr.strip()[:300]}")
    return binary


def _platform() -> tuple[str, str]:
    if sys.platform not in PLATFORMS:
        raise JobError(f"an FMU cannot be made on {sys.platform}, only on Linux and macOS")
    return PLATFORMS[sys.platform]


def _pack(target: Path, folder: Path, name: str, description: bytes, binary: Path) -> None:
    try:
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("modelDescription.xml", description)
            archive.write(binary, f"binaries/{_platform()[0]}/{binary.name}")
            for file in (f"{name}.c", f"{name}.h", f"{name}_wrap.c", "buildDescription.xml"):
                archive.write(folder / file, f"sources/{file}")
    except OSError as error:
        raise JobError(f"the FMU could not be written: {error}") from error
