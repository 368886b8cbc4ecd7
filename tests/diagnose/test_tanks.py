"""The cascaded tanks benchmark, a real recording with a sample every four seconds: its overflow is named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from optid.core.readers import read_recording
from optid.diagnose.diagnosis import Verdict, diagnose
from optid.rigs.rigfile import read_rig

RIG = Path(__file__).parents[2] / "data" / "cascaded_tanks.toml"


def test_the_overflow_of_the_real_tanks_is_named(shared):
    path = shared / "recordings" / "cascaded_tanks" / "dataBenchmark.csv"
    if not path.is_file():
        pytest.skip(f"{path.name} is not there")
    rig = read_rig(RIG)
    other = {"command": "uVal", "level": "yVal"}
    channels = {role: replace(c, column=other.get(role, c.column)) for role, c in rig.channels.items()}
    train, held = read_recording(path, rig), read_recording(path, replace(rig, channels=channels))
    found = diagnose(rig, [train], [held], generator=np.random.default_rng(0))
    assert found.verdict is Verdict.MISSING_PHYSICS
    assert found.findings[0].effect.name == "overflow"
    assert found.base.judged.horizon == 200.0  # s: fifty samples, half a second would hold none
    before, after = (one.judged.scores["level"].rmse for one in (found.base, found.best))
    assert after < 0.85 * before
