"""A problem of one's own on optid's equations: move the axis 60 mm in 0.3 s with the least command, by `ca.Opti`.

    python studies/casadi_stroke.py

The plant's smooth friction is used, as an optimiser wants derivatives that change slowly. What IPOPT finds is then run
by optid's own simulation, with friction that sticks.
"""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np

import optid
from optid.core.simulation import simulate

DATA = Path(__file__).resolve().parents[1] / "data"
STROKE, TIME, STEPS = 0.06, 0.3, 30  # m, s
SUBSTEPS = 20  # of a step: smooth friction wants half a millisecond
ROOM = {"Pa": (0.5e5, 9e5), "m": (-0.12, 0.12), "m/s": (-3.0, 3.0)}  # within which the search stays


def smooth_rig(folder: Path) -> optid.Rig:
    """The bench with smooth friction."""
    text = (DATA / "bench.toml").read_text(encoding="utf-8")
    file = folder / "smooth.toml"
    file.write_text(
        text.replace("[parameters]", '[options]\nfriction = "smooth"\n\n[parameters]', 1), encoding="utf-8"
    )
    return optid.read_rig(file)


def solve(rig: optid.Rig, steps: int = STEPS) -> tuple[np.ndarray, np.ndarray]:
    """Command (share of full scale), (steps,), and positions (m) at the ends of the steps.

    Multiple shooting: the states at all steps are unknowns, the model's step ties each to the next.
    """
    f = rig.model.to_casadi(SUBSTEPS)
    p, scales = f.values(rig.parameters), rig.model.scales
    start = np.array(f.start(p)[0]).ravel()
    opti = ca.Opti()
    X, U = opti.variable(len(scales), steps + 1), opti.variable(1, steps)
    opti.subject_to(X[:, 0] == start / scales)
    for k in range(steps):
        opti.subject_to(X[:, k + 1] == f.step(X[:, k] * scales, U[:, k], p, TIME / steps) / scales)
    place, speed = (list(f.states).index(name) for name in ("position", "velocity"))
    opti.subject_to(X[place, steps] * scales[place] == STROKE)
    opti.subject_to(X[speed, steps] == 0)
    opti.subject_to(opti.bounded(-1, U, 1))
    for row, (unit, scale) in enumerate(zip(f.states.values(), scales, strict=True)):
        low, high = ROOM[unit]
        opti.subject_to(opti.bounded(low / scale, X[row, :], high / scale))
    opti.minimize(ca.sumsqr(U) + 0.1 * ca.sumsqr(ca.diff(U.T)))
    guess = np.tile(start / scales, (steps + 1, 1)).T
    guess[place] = np.linspace(0.0, STROKE / scales[place], steps + 1)
    opti.set_initial(X, guess)
    opti.set_initial(U, 0.1)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "max_iter": 500})
    found = opti.solve()
    return np.atleast_1d(found.value(U)).ravel(), scales[place] * np.asarray(found.value(X))[place]


def replay(rig: optid.Rig, command: np.ndarray) -> float:
    """Where the same command takes a rig, m."""
    model = rig.model
    p = model.vector(rig.parameters)
    start = np.array(model.start(p)[0]).ravel()
    dt = np.full(len(command) + 1, TIME / len(command))
    inputs = np.append(command, command[-1])[:, None]
    return float(simulate(model, p, start, dt, inputs).states[0, -1, 0])


def main() -> None:
    """Solve and replay."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        rig = smooth_rig(Path(folder))
        command, position = solve(rig)
        print(
            f"largest command {np.abs(command).max():.3f} of full scale, end at {1e3 * position[-1]:.3f} mm"
        )
        print(f"optid's simulation of it: {1e3 * replay(rig, command):.3f} mm")
        print(
            f"with friction that sticks: {1e3 * replay(optid.read_rig(DATA / 'bench.toml'), command):.3f} mm"
        )


if __name__ == "__main__":
    main()
