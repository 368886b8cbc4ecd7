"""The three-parameter fit of the speed benchmark, and free simulation, side by side in one run on one machine.

    python studies/benchmark_fit.py [--full]

(a) Fits viscous and Coulomb friction and the discharge coefficient to 10 s of position at 1 kHz: optid, hand-written
C, CasADi and IPOPT as CasADi's own example has it, and SciPy's LSODA, restarted at every held command, in
`least_squares`. Without `--full` one simulation is timed for SciPy and multiplied by the number that a full run takes;
with it, SciPy runs, also without restarts.
(b) Simulates on one core, with the largest error of the position against Radau at rtol 1e-10.

Times are the fastest of several runs, for all alike; optid uses all cores and, in a row of its own, one.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.core import kernel, threads
from optid.core.jit import compiled_runs, object_code
from optid.core.llvm_codegen import source
from optid.core.readers import read_recording
from optid.core.simulation import TOLERANCE, simulate
from optid.core.threads import WORKERS
from optid.estimation.multiple_shooting import FitOptions, fit
from optid.rigs.rigfile import Rig, read_rig
from studies.peers import axis, fit_c, fit_casadi, fit_scipy
from studies.peers.record import NOISE, Record, benchmark_record

# That least_squares took in a full run on this record; the quick mode multiplies by it.
SCIPY_SIMULATIONS = 20
UNITS = {
    "supply_pressure": "Pa",
    "exhaust_pressure": "Pa",
    "atmospheric_pressure": "Pa",
    "supply_temperature": "K",
    "chamber_temperature": "K",
    "gas_constant": "J/(kg K)",
    "port_width": "m",
    "spool_travel": "m",
    "bore_diameter": "m",
    "rod_diameter": "m",
    "stroke": "m",
    "residual_length": "m",
    "payload_mass": "kg",
    "viscous_friction": "N s/m",
    "coulomb_friction": "N",
    "friction_width": "m/s",
    "stop_stiffness": "N/m**1.5",
    "stop_damping": "s/m",
    "length_floor": "m",
}
RIG = """name = "benchmark"
model = "servo-pneumatic"
[options]
friction = "smooth"
[parameters]
{parameters}sampling_skew = "0 s"
[fit]
viscous_friction = {{ bounds = ["5 N s/m", "2000 N s/m"] }}
coulomb_friction = {{ bounds = ["5 N", "2000 N"] }}
discharge_coefficient = {{ bounds = [0.05, 8.0] }}
[channels]
time = {{ column = "t", unit = "s" }}
command = {{ column = "u", unit = "V", full_scale = "5 V" }}
position = {{ column = "x", unit = "m", sd = "{noise!r} m" }}
"""


def rig_and_recording(record: Record) -> tuple[Rig, Any]:
    """The benchmark as a user would state it: a rig file and a CSV file, read back."""
    lines = [
        f'{name} = "{value!r} {UNITS[name]}"\n' if name in UNITS else f"{name} = {value!r}\n"
        for name, value in record.guess.items()
    ]
    with tempfile.TemporaryDirectory() as folder:
        path, data = Path(folder, "rig.toml"), Path(folder, "record.csv")
        path.write_text(RIG.format(parameters="".join(lines), noise=NOISE))
        t = np.arange(len(record.command)) * record.dt
        pd.DataFrame({"t": t.round(6), "u": record.command, "x": record.position}).to_csv(data, index=False)
        rig = read_rig(path)
        return rig, read_recording(data, rig)


def timed(work: Callable[[], Any], repeats: int = 9) -> tuple[float, Any]:
    """Seconds of the fastest of `repeats` runs, and the last result."""
    seconds, found = [], None
    for _ in range(repeats):
        began = time.perf_counter()
        found = work()
        seconds.append(time.perf_counter() - began)
    return min(seconds), found


def errors(values: Mapping[str, float]) -> str:
    """Errors of the fitted parameters against the truth, %."""
    return "".join(f"{100 * (values[name] / axis.TRUE[name] - 1):10.3f}" for name in axis.FREE)


def fits(record: Record, full: bool) -> None:
    """Part (a)."""
    rig, recording = rig_and_recording(record)
    fit(rig, [recording])
    rows = []
    for name, options, cores in (
        ("optid", FitOptions(), WORKERS),
        ("optid, process noise 0", FitOptions(process_noise=0.0), WORKERS),
        ("optid, one core", FitOptions(), 1),
    ):
        threads.WORKERS = cores
        seconds, found = timed(lambda options=options: fit(rig, [recording], options))
        rows.append((name, seconds, errors(found.values)))
    threads.WORKERS = WORKERS
    own = rows[0][1]
    print(f"fit of {len(record.command)} samples on {WORKERS} cores; {compiling(rig)}")
    arguments = (record.guess, record.start_state, record.share, record.position, record.dt)
    if fit_c.available():
        fit_c.fit(*arguments)
        seconds, in_c = timed(lambda: fit_c.fit(*arguments))
        rows.append(("hand-written C", seconds, errors(in_c.parameters)))
    own_equations = (rig, record.start_state, record.share, record.position, record.dt)
    seconds, in_casadi = timed(lambda: fit_casadi.fit(*own_equations), 1)
    label = f"CasADi and IPOPT, {in_casadi.iterations} iterations"
    rows.append((label, seconds, errors(in_casadi.parameters)))
    if full:
        for restart in (True, False):
            seconds, slow = timed(lambda restart=restart: fit_scipy.fit(*arguments, restart=restart), 1)
            label = f"SciPy, {'restarted' if restart else 'no restart'}, {slow.simulations} runs"
            rows.append((label, seconds, errors(slow.parameters)))
    else:
        seconds, _ = timed(lambda: lsoda(record), 1)
        label = f"SciPy, one run x {SCIPY_SIMULATIONS}"
        rows.append((label, seconds * SCIPY_SIMULATIONS, "   not fitted: --full does"))
    print(f"{'':32}{'seconds':>9}{'/ optid':>9}   error, %: K_f       F_r       C_d")
    for name, seconds, shown in rows:
        print(f"{name:32}{seconds:9.3f}{seconds / own:9.3f}   {shown}")


def compiling(rig: Rig) -> str:
    """What a model costs that was never compiled before: its equations, with slopes to three parameters."""
    free = tuple(rig.model.index(f.name) for f in rig.freed)

    seconds, _ = timed(lambda: object_code(source(rig.model, free)))
    return f"compiling a new model: {seconds:.2f} s"


def lsoda(record: Record) -> Any:
    """One simulation of the record as `fit_scipy` runs it."""
    atol = (1e-9, 1e-7, 1e-1, 1e-1)
    return axis.simulate(
        record.guess, record.start_state, record.share[:-1], record.dt, method="LSODA", rtol=1e-6, atol=atol
    )


def simulations(record: Record, short: int = 500) -> None:
    """Part (b): one run is one thread; many parameter sets share the cores."""
    rig, _ = rig_and_recording(record)
    model, n = rig.model, len(record.command)
    p = model.vector({**rig.parameters, **{name: axis.TRUE[name] for name in axis.FREE}})
    inputs, dt = record.share[:, None], np.full(n, record.dt)
    radau = axis.simulate(axis.TRUE, record.start_state, record.share[:short], record.dt)[:, 0]
    print(
        f"\nsimulation; errors of the position against Radau (rtol 1e-10) over the first {short * record.dt:g} s,"
    )
    print("and against C at a twentieth of a sample over the whole record")
    print(f"{'':32}{'s per s':>9}{'short, um':>11}{'whole, um':>11}")
    machine, start = compiled_runs(model), np.array([record.start_state])
    first, counts = np.zeros(1, dtype=np.int64), np.array([n - 1], dtype=np.int64)
    X, Y = np.empty((1, n, 4)), np.empty((1, n, len(model.outputs)))
    for tolerance in (TOLERANCE, 1e-6, 1e-5):
        fixed = (first, counts, start, p[None], dt, inputs, tolerance * model.scales, X, Y)
        machine.run(kernel.simulate, 0, 1, *fixed)
        seconds, _ = timed(lambda fixed=fixed: machine.run(kernel.simulate, 0, 1, *fixed))
        line(f"optid, tolerance {tolerance:g}", n * record.dt / seconds, X[0, :, 0].copy(), radau, record)
    seconds, _ = timed(lambda: simulate(model, p, record.start_state, dt, inputs))
    print(f"{'optid, simulate() as called':32}{n * record.dt / seconds:9.0f}")
    if fit_c.available():
        for steps in (2, 5):
            seconds, states = timed(
                lambda steps=steps: fit_c.simulate(
                    axis.TRUE, record.start_state, record.share[:-1], record.dt, steps
                )
            )
            line(f"C, {steps} RK4 steps a sample", n * record.dt / seconds, states[:, 0], radau, record)
    for count in (WORKERS, 8 * WORKERS):
        many = np.tile(p, (count, 1))
        seconds, _ = timed(lambda many=many: simulate(model, many, record.start_state, dt, inputs), 3)
        print(
            f"{f'optid, {count} parameter sets':32}{count * n * record.dt / seconds:9.0f}   on {WORKERS} cores"
        )


def line(name: str, speed: float, position: Any, radau: Any, record: Record) -> None:
    """One row: simulated seconds a second and the largest errors, micrometres."""
    short = 1e6 * np.abs(position[: len(radau)] - radau[: len(position)]).max()
    whole = 1e6 * np.abs(position - record.states[: len(position), 0]).max()
    print(f"{name:32}{speed:9.0f}{short:11.5f}{whole:11.5f}")


def main(arguments: list[str]) -> int:
    """Run both parts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--full", action="store_true", help="run SciPy's fits (two minutes)")
    full = parser.parse_args(arguments).full
    if not fit_c.available():
        print("skipped: the record is simulated in C, and gcc is not installed")
        return 1
    record = benchmark_record()
    fits(record, full)
    simulations(record)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
