"""A cart pushed through drag, whose motion under a held push is known in closed form: rigs and recordings of it.

The rig files name `cart.py:cart` as a user's own plant; the recordings come from the closed form, not from optid.
"""

from pathlib import Path

import numpy as np

from optid.core.parameter import Parameter
from optid.core.recording import Channel, Recording
from optid.estimation.fisher_scoring import likelihood_problem
from optid.estimation.likelihood import WHOLE
from optid.estimation.problem import build_problem
from optid.rigs.rigfile import read_rig

GAIN = Parameter("gain", "m/s**2", 2.0, "push at full command", "a test", bounds=(0.0, 100.0))
DRAG = Parameter("drag", "1/s", 1.0, "drag by mass", "a test", bounds=(0.0, 100.0))
SHARE = Parameter("share", "1", 1.0, "of the gain that arrives", "a test", 1.0, (0.1, 10.0))
TRUTH = {"gain": 3.0, "drag": 2.0}
SD = 1e-3  # m
RATE = 200.0  # 1/s
FREE = 'gain = { bounds = ["0.1 m/s**2", "50 m/s**2"] }\ndrag = { bounds = ["0.01 1/s", "50 1/s"] }'


def cart(s):
    """x' = v, v' = share gain u - drag v."""
    x, v = s.state("position", "m", 0.1, spread=0.1), s.state("velocity", "m/s", 1.0)
    s.rate(x, v)
    s.rate(v, s.param(SHARE) * s.param(GAIN) * s.input("command", "1") - s.param(DRAG) * v)
    s.output("position", "m", x)


def rig(folder, free=FREE, gain=2.0, drag=1.0):
    """The cart's rig file, read."""
    path = folder / "cart.toml"
    (folder / "plant.py").write_bytes(Path(__file__).read_bytes())  # a plant belongs beside its rig file
    path.write_text(f"""
model = "plant.py:cart"
[parameters]
gain = "{gain} m/s**2"
drag = "{drag} 1/s"
[fit]
{free}
[channels]
time = {{ column = "t", unit = "s" }}
command = {{ column = "u", unit = "1" }}
position = {{ column = "x", unit = "m", sd = "{SD} m" }}
""")
    return read_rig(path)


def moved(u, dt, x=0.0, v=0.0, gain=TRUTH["gain"], drag=TRUTH["drag"]):
    """Positions at the samples under held commands `u`, in closed form, (samples,)."""
    out, decay = [], np.exp(-drag * dt)
    for push in gain * np.asarray(u):
        out.append(x)
        final = push / drag
        x, v = x + final * dt + (v - final) * (1 - decay) / drag, final + (v - final) * decay
    return np.array(out)


def recording(rng, seconds=8.0, name="cart.csv", sd=SD):
    """A drive with random steps of half a second, white noise on the position."""
    n = round(seconds * RATE)
    u = np.repeat(rng.uniform(-1.0, 1.0, n // 100 + 1), 100)[:n]
    x = moved(u, 1 / RATE) + sd * rng.standard_normal(n)
    return record(u, x, name)


def record(u, x, name="cart.csv"):
    """Samples as a recording."""
    channels = {
        "command": Channel("command", "u", "1", np.asarray(u, dtype=float)),
        "position": Channel("position", "x", "m", np.asarray(x, dtype=float), sd=SD),
    }
    return Recording(name, np.arange(len(u)) / RATE, channels)


def question(folder):
    """The likelihood problem of two recordings, and the parameters that the rig file states."""
    own = rig(folder)
    problem = build_problem(own.model, [recording(np.random.default_rng(seed)) for seed in (1, 2)], WHOLE)
    return likelihood_problem(own, problem), own.model.vector(own.parameters)
