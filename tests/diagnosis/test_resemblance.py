"""Laws fitted to the unknown signal at a sensor, beside parameters that it has unbent, on the trolley."""

from dataclasses import replace

import numpy as np
import pytest

from optid.diagnosis import resemblance
from optid.diagnosis.candidate import Data, fit_base
from optid.diagnosis.disturbance import locate_at
from optid.diagnosis.forms import curves
from optid.diagnosis.resemblance import resembling
from optid.effects.curve import HEIGHTS
from optid.effects.generic.hysteresis import Hysteresis
from optid.effects.generic.offset import Offset
from optid.effects.library import admitted
from tests.diagnosis.trolley import RATE, SD, TRUTH, recording, rig

SLOPE, SETTLING = -0.008, 4.0  # m/s, s
BENT, PERIOD = 5e-3, 0.8  # m


def drifting(seed):
    """A recording whose position wanders by 30 mm, sixty times its noise."""
    plain = recording(seed, f"run{seed}.csv")
    position = plain["position"]
    time = np.arange(len(position.values)) / RATE
    away = SLOPE * SETTLING * (1.0 - np.exp(-time / SETTLING))
    channels = {**plain.channels, "position": replace(position, values=position.values + away)}
    return replace(plain, channels=channels)


def uneven(seed):
    """A recording whose position is read by a scale with a wave."""
    plain = recording(seed, f"run{seed}.csv")
    position = plain["position"]
    values = position.values + BENT * np.sin(2.0 * np.pi * position.values / PERIOD)
    return replace(plain, channels={**plain.channels, "position": replace(position, values=values)})


def fitted_to(train, folder):
    data = Data(train, train[:1], {"position": SD}, np.random.default_rng(0))
    return fit_base(rig(folder), data, lambda share, words: None), data


@pytest.fixture(scope="module")
def bent(tmp_path_factory):
    return fitted_to(tuple(drifting(seed) for seed in (1, 2)), tmp_path_factory.mktemp("drift"))


@pytest.fixture(scope="module")
def scale(tmp_path_factory):
    """A base model of recordings by an uneven scale, its data, and the unknown signal at the sensor."""
    base, data = fitted_to(tuple(uneven(seed) for seed in (1, 2)), tmp_path_factory.mktemp("uneven"))
    return base, data, {"sensor.position": locate_at(base, data, "sensor.position")}


def over_position(base, signals):
    """The curve over the position at the sensor."""
    (form,) = (one for one in curves(base, signals["sensor.position"]) if one.name.endswith("@position"))
    return form


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


def test_a_curve_is_drawn_through_the_unknown_signal_it_follows(scale, monkeypatch):
    base, data, signals = scale
    monkeypatch.setattr(resemblance, "locate_at", None)  # it is not estimated again
    form = over_position(base, signals)
    ((effect, question, p),) = resembling(base, [form], data, base.rig.model, signals)
    values = dict(zip((q.name for q in question.model.parameters), p, strict=True))
    assert effect is form and {name: values[name] for name in TRUTH} == pytest.approx(TRUTH, rel=0.01)
    own = {name.removeprefix(f"{form.name}."): value for name, value in values.items()}
    heights = own["size"] * np.array([own[f"height_{k + 1}"] for k in range(HEIGHTS)])
    middles = np.linspace(own["low"], own["high"], HEIGHTS - 2)  # of all B-splines but the outermost
    expected = BENT * np.sin(2.0 * np.pi * middles / PERIOD)
    assert np.abs(heights).max() < 3.0 * BENT  # though nothing tells its mean
    assert np.corrcoef(heights[1:-1], expected)[0, 1] > 0.9


def test_only_sites_with_a_signal_are_tried_where_signals_are_given(scale):
    base, data, signals = scale
    assert resembling(base, [over_position(base, signals)], data, base.rig.model, {}) == []
