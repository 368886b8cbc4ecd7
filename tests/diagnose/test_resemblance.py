"""Laws fitted to the unknown signal at a sensor, beside parameters that it has unbent, on the trolley."""

from dataclasses import replace

import numpy as np
import pytest

from optid.diagnose.candidate import Data, fit_base
from optid.diagnose.resemblance import resembling
from optid.effects.generic.hysteresis import Hysteresis
from optid.effects.generic.offset import Offset
from optid.effects.library import admitted
from tests.diagnose.trolley import RATE, SD, TRUTH, recording, rig

SLOPE, SETTLING = -0.008, 4.0  # m/s, s


def drifting(seed):
    """A recording whose position wanders by 30 mm, sixty times its noise."""
    plain = recording(seed, f"run{seed}.csv")
    position = plain["position"]
    time = np.arange(len(position.values)) / RATE
    away = SLOPE * SETTLING * (1.0 - np.exp(-time / SETTLING))
    channels = {**plain.channels, "position": replace(position, values=position.values + away)}
    return replace(plain, channels=channels)


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    train = tuple(drifting(seed) for seed in (1, 2))
    data = Data(train, train[:1], {"position": SD}, np.random.default_rng(0))
    return fit_base(rig(tmp_path_factory.mktemp("drift")), data, lambda share, words: None), data


def test_a_drift_is_seen_in_the_unknown_signal_at_its_sensor(bent):
    base, data = bent
    plain = base.rig.model
    ((effect, question, p),) = resembling(base, admitted(plain), data, plain)
    assert effect.name == "sensor_drift"
    values = dict(zip((q.name for q in question.model.parameters), p, strict=True))
    assert {name: values[name] for name in TRUTH} == pytest.approx(TRUTH, rel=0.01)

    def wandered(rate, settling):
        """From when the signal has caught up, a second from the start, to the end."""
        return rate * settling * (np.exp(-1.0 / settling) - np.exp(-12.0 / settling))

    seen = wandered(values["sensor_drift.rate"], values["sensor_drift.settling_time"])
    assert seen == pytest.approx(wandered(SLOPE, SETTLING), rel=0.1)


def test_effects_elsewhere_and_laws_with_a_memory_are_left_out(bent):
    base, data = bent
    effects = [Hysteresis("sensor.position", 0.1), Offset("drive.command", 1.0)]
    assert resembling(base, effects, data, base.rig.model) == []


def test_no_time_no_resemblance(bent):
    base, data = bent
    assert resembling(base, admitted(base.rig.model), replace(data, until=0.0), base.rig.model) == []
