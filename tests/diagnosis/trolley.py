"""A trolley pushed through drag, a plant of the user's own with sites, and recordings of it in closed form.

The recordings come from the closed form of motion under a held push, not from optid; what is concealed is done to
the command before it pushes.
"""

from pathlib import Path

import numpy as np

from optid.core.parameter import Parameter
from optid.core.recording import Channel, Recording
from optid.diagnosis.problem import DiagnosisProblem
from optid.rigs.rigfile import read_rig

GAIN = Parameter("gain", "m/s**2", 2.0, "push at full command", "a test", bounds=(0.0, 100.0))
DRAG = Parameter("drag", "1/s", 1.0, "drag by mass", "a test", bounds=(0.0, 100.0))
TRUTH = {"gain": 3.0, "drag": 2.0}
SD = 5e-4  # m
RATE = 100.0  # 1/s


def trolley(s):
    """x' = v, v' = gain u - drag v."""
    x, v = s.state("position", "m", 0.1, spread=0.1), s.state("velocity", "m/s", 1.0, spread=0.1)
    u = s.site("drive.command", s.input("command", "1"), size=1.0)
    s.rate(x, v)
    s.rate(v, s.param(GAIN) * u - s.site("drag.force", s.param(DRAG) * v, v=v))
    s.output("position", "m", s.site("sensor.position", x))


def rig(folder):
    """The trolley's rig file, read."""
    path = folder / "trolley.toml"
    (folder / "plant.py").write_bytes(Path(__file__).read_bytes())  # a plant belongs beside its rig file
    path.write_text(f"""
model = "plant.py:trolley"
[parameters]
gain = "2 m/s**2"
drag = "1 1/s"
[fit]
gain = {{ bounds = ["0.1 m/s**2", "50 m/s**2"] }}
drag = {{ bounds = ["0.01 1/s", "50 1/s"] }}
[channels]
time = {{ column = "t", unit = "s" }}
command = {{ column = "u", unit = "1" }}
position = {{ column = "x", unit = "m", sd = "{SD} m" }}
""")
    return read_rig(path)


def recording(seed, name, concealed=lambda u: u, seconds=12.0, beside=lambda t, x, v: 0.0):
    """A drive with random steps of 0.3 s; `concealed` is what happens to the command before it pushes.

    What is `beside` the drive, m/s**2, is held for a sample: at its middle, at position and speed before it.
    """
    rng = np.random.default_rng(seed)
    n = round(seconds * RATE)
    u = np.repeat(rng.uniform(-1.0, 1.0, n // 30 + 1), 30)[:n]
    x, v, out, decay = 0.0, 0.0, [], np.exp(-TRUTH["drag"] / RATE)
    for k, push in enumerate(TRUTH["gain"] * concealed(u)):
        out.append(x)
        final = (push + beside((k + 0.5) / RATE, x, v)) / TRUTH["drag"]
        x, v = x + final / RATE + (v - final) * (1 - decay) / TRUTH["drag"], final + (v - final) * decay
    measured = np.array(out) + SD * rng.standard_normal(n)
    channels = {
        "command": Channel("command", "u", "1", u),
        "position": Channel("position", "x", "m", measured, sd=SD),
    }
    return Recording(name, np.arange(n) / RATE, channels)


def problem_of(folder, train, **how):
    """A diagnosis problem of recordings of the trolley."""
    return DiagnosisProblem(rig(folder), tuple(train), {"position": SD}, **how)
