"""Simulate two recordings of the winch with other numbers than its rig file has: winch.csv and winch_holdout.csv."""

import numpy as np
import pandas as pd

import optid

TRUE = {"mass": 6.2, "viscous_friction": 31.0, "spring_rate": 240.0, "coulomb_friction": 5.5}

rig = optid.read_rig("winch.toml")
functions = rig.model.to_casadi(substeps=100)
p = functions.values({**rig.parameters, **TRUE})
rng = np.random.default_rng(7)
for name in ("winch", "winch_holdout"):
    u = np.repeat(rng.uniform(-8.0, 8.0, 40), 40)
    x, position = functions.start(p)[0], []
    for volts in u:
        position.append(float(functions.outputs(x, volts, p)))
        x = functions.step(x, volts, p, 1 / 200)
    noisy = 1e3 * np.array(position) + 0.02 * rng.standard_normal(len(u))
    pd.DataFrame({"u": u, "x": noisy.round(4)}).to_csv(f"{name}.csv", index=False)
print("winch.csv and winch_holdout.csv written")
