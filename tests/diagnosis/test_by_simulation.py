"""Tanks written down anew and solved by SciPy, with more missing than one effect, and plants not to be judged so."""

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from optid.core.recording import Channel, Recording
from optid.diagnosis.by_simulation import by_simulation, forgets
from optid.diagnosis.candidate import Data, fit_base
from optid.diagnosis.diagnosis import diagnose
from optid.diagnosis.finding import Verdict
from optid.rigs.rigfile import read_rig
from tests.diagnosis.trolley import recording, rig

TANKS = Path(__file__).parents[2] / "data" / "cascaded_tanks.toml"
STEP, COUNT, SD = 4.0, 600, 0.01  # s, samples, V


def tanks(seed, rim=1e3, stirred=0.0, most=5.0):
    """A record; the upper tank spills over a sharp weir at `rim`, half of it is caught, and the pump is unsteady."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(0.5, most, COUNT // 20 + 1), 20)[:COUNT]
    pumped = u + stirred * np.repeat(rng.standard_normal(COUNT // 5 + 1), 5)[:COUNT]

    def rates(t, h):
        root = np.sqrt(np.maximum(h, 0.0))
        spilled = 0.5 * max(h[0] - rim, 0.0) ** 1.5
        push = 0.05 * max(pumped[min(int(t / STEP), COUNT - 1)], 0.0)
        return [push - 0.05 * root[0] - spilled, 0.05 * root[0] + 0.5 * spilled - 0.055 * root[1]]

    times = STEP * np.arange(COUNT)
    level = solve_ivp(rates, (0.0, times[-1]), [4.0, 3.0], t_eval=times, max_step=STEP / 2, rtol=1e-7).y[1]
    assert level.max() < 10.0  # V: the ceiling of the plant's sensor
    shown = level + SD * rng.standard_normal(COUNT)
    channels = {"command": Channel("command", "u", "V", u), "level": Channel("level", "y", "V", shown)}
    return Recording(f"tanks{seed}", times, channels)


def based(made, read, noise):
    data = Data((made[0],), (made[1],), noise, np.random.default_rng(0))
    return fit_base(read, data, lambda share, words: None), data


def test_an_overflow_beside_an_unsteady_pump_is_named_by_simulation():
    train, held = tanks(1, rim=5.0, stirred=0.3), tanks(2, rim=5.0, stirred=0.3)
    found = diagnose(read_rig(TANKS), [train], [held], generator=np.random.default_rng(0))
    assert found.data.misfit["level"] > 10 * SD
    assert not found.best.answer.question.groups  # no process noise
    assert found.verdict is Verdict.MISSING_PHYSICS
    assert found.findings[0].effect.name == "overflow"
    assert all(end - begin > 9 * STEP for _, begin, end in found.findings[0].region.intervals[:-1])
    before, after = (one.judged.scores["level"].rmse for one in (found.base, found.best))
    assert after < 0.6 * before


@pytest.mark.parametrize("stirred", [0.0, 0.3])
def test_an_unsteady_pump_alone_is_given_no_name(stirred):
    found = diagnose(
        read_rig(TANKS), [tanks(3, stirred=stirred, most=3.2)], [tanks(4, stirred=stirred, most=3.2)],
        generator=np.random.default_rng(0),
    )  # fmt: skip
    assert not found.best.effects
    assert (found.data.misfit is None) == (stirred == 0.0)


def test_tanks_forget_their_start_and_a_trolley_does_not(tmp_path):
    base, data = based([tanks(1, rim=7.0), tanks(2, rim=7.0)], read_rig(TANKS), {"level": SD})
    assert forgets(base)
    assert by_simulation(base, data) is not None
    worn = [recording(seed, f"run{seed}.csv", lambda u: np.clip(u, -0.4, 0.4)) for seed in (1, 2)]
    base, data = based(worn, rig(tmp_path), {"position": 1e-6})
    assert not forgets(base)
    assert by_simulation(base, data) is None
