"""What the controller promises, checked against formulas written out here."""

import math
from dataclasses import replace

import numpy as np
import pytest

from optid.errors import InputError
from optid.pid.controller import AntiWindup, Controller, Gains, Notch, Settings

T = 1e-3


def test_linear_law_is_the_textbook_one():
    gains = Gains(20.0, 30.0, 0.5, 5e-3, 0.7, 0.2)
    controller = Controller(gains, Settings(T))
    rng = np.random.default_rng(0)
    r, y = rng.normal(0, 0.1, 50), rng.normal(0, 0.1, 50)
    controller.reset(0.0, 0.0)
    integral, lagged, before = 0.0, 0.0, 0.0
    for n in range(50):
        integral += gains.ki * T * (r[n] - y[n])
        x = gains.derivative_weight * r[n] - y[n]
        # Backward difference of x / (Tf s + 1) times s.
        lagged = (gains.derivative_filter * lagged + (x - before)) / (gains.derivative_filter + T)
        before = x
        expected = gains.kp * (gains.setpoint_weight * r[n] - y[n]) + integral + gains.kd * lagged
        assert controller.step(r[n], y[n]) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_limits_rate_and_resolution_hold_always():
    settings = Settings(T, -4.0, 3.0, rate=500.0, resolution=0.01)
    controller, rng = Controller(Gains(300.0, 3000.0, 3.0, 1e-3), settings), np.random.default_rng(1)
    last = controller.command
    for r, y in rng.normal(0, 0.2, (2000, 2)):
        u = controller.step(r, y)
        assert -4.0 <= u <= 3.0
        assert abs(u - last) <= 0.5 + 1e-9
        assert abs(u / 0.01 - round(u / 0.01)) < 1e-6
        last = u


@pytest.mark.parametrize("kind", [AntiWindup.CLAMPING, AntiWindup.BACK_CALCULATION])
def test_anti_windup_leaves_the_limit_at_once(kind):
    def samples_to_leave(anti_windup):
        tracking = 0.01 if anti_windup is AntiWindup.BACK_CALCULATION else 0.0
        controller = Controller(
            Gains(10.0, 100.0), Settings(T, -1, 1, anti_windup=anti_windup, tracking_time=tracking)
        )
        for _ in range(2000):
            controller.step(1.0, 0.0)  # far beyond the limit for two seconds
        for n in range(20000):
            if controller.step(-0.05, 0.0) < 1.0:
                return n
        return math.inf

    assert samples_to_leave(kind) < 200 < samples_to_leave(AntiWindup.NONE)


@pytest.mark.parametrize("dead", [(0.0, 0.0, 0.0), (-0.2, 0.3, 0.05)])
@pytest.mark.parametrize("command", [-2.0, -0.01, 0.0, 0.02, 1.7])
def test_start_and_change_are_bumpless(dead, command):
    controller = Controller(Gains(50.0, 60.0, 1.0, 2e-3), Settings(T, -5, 5, math.inf, *dead))
    controller.reset(0.1, 0.04, command)
    assert controller.step(0.1, 0.04) == pytest.approx(command, abs=1e-12)
    rng = np.random.default_rng(2)
    for y in 0.04 + np.cumsum(rng.normal(0, 1e-5, 30)):
        last = controller.step(0.1, y)
    before = controller.state
    controller.change(Gains(20.0, 500.0, 0.2, 2e-3, 0.5))
    # The same sample again, with nothing integrated: the command stands.
    controller.step(0.1, y)
    grown = 500.0 * T * (0.1 - y)
    edge = abs(dead[1] if last > 0 else dead[0]) / dead[2] if dead[2] else 0.0
    assert abs(controller.command - last) <= (1 + edge) * abs(grown) + 0.2 * abs(before[1]) + 1e-9


def test_a_missing_sample_is_the_last_one_again():
    one, two = (Controller(Gains(50.0, 60.0, 1.0), Settings(T)) for _ in range(2))
    for controller in (one, two):
        controller.step(0.1, 0.02)
    assert one.step(math.nan, math.nan) == two.step(0.1, 0.02)


@pytest.mark.parametrize(
    ("bad", "field"),
    [
        ({"low": 5, "high": -5}, "limits"),
        ({"rate": 0.0}, "rate"),
        ({"rate": -1.0}, "rate"),
        ({"sample_time": 0.0}, "sample_time"),
        ({"sample_time": math.nan}, "sample_time"),
        ({"low": -5, "high": 5, "resolution": 20.0}, "resolution"),
        ({"resolution": -1.0}, "resolution"),
        ({"deadband_low": 0.1}, "deadband"),
        ({"deadband_high": 0.1}, "deadband_onset"),
        ({"resolution": 0.1, "rate": 1.0}, "rate"),
        ({"anti_windup": AntiWindup.BACK_CALCULATION}, "tracking_time"),
    ],
)
def test_contradictions_are_refused(bad, field):
    with pytest.raises(InputError) as error:
        Settings(**{"sample_time": T, **bad})
    assert error.value.field == field


def test_memory_is_kept_and_restored():
    controller = Controller(Gains(50.0, 60.0, 1.0, 1e-3), Settings(T, -5, 5))
    controller.step(0.05, 0.01)
    kept = controller.state
    first = controller.step(0.05, 0.012)
    controller.restore(kept)
    assert controller.step(0.05, 0.012) == first
    with pytest.raises(InputError):
        controller.restore(np.full(5, np.nan))


def test_a_notch_takes_out_its_frequency_alone():
    notch = Notch(150.0, 60.0, 0.1)
    b0, b1, b2, a1, a2 = notch.coefficients(1e-3)

    def gain(frequency):
        z = np.exp(-1j * frequency * 1e-3)
        return abs((b0 + b1 * z + b2 * z * z) / (1 + a1 * z + a2 * z * z))

    assert gain(150.0) == pytest.approx(0.1, rel=1e-9)
    assert gain(1e-6) == pytest.approx(1.0, abs=1e-9) and gain(math.pi * 1e3) == pytest.approx(1.0, abs=1e-9)
    # As wide as it says: where the gain of a full notch is 1 / sqrt 2.
    full = Notch(150.0, 60.0)
    b0, b1, b2, a1, a2 = full.coefficients(1e-3)
    edges = [-30.0 + math.hypot(30.0, 150.0), 30.0 + math.hypot(30.0, 150.0)]
    assert [gain(edge) for edge in edges] == pytest.approx([math.sqrt(0.5)] * 2, rel=5e-3)
    for bad in ({"frequency": 4e3}, {"width": 0.0}, {"depth": 1.5}):
        with pytest.raises(InputError, match="notch"):
            Settings(1e-3, notch=replace(notch, **bad))


def test_a_start_with_a_notch_gives_no_bump():
    controller = Controller(
        Gains(20.0, 50.0, 0.3, 2e-3), Settings(1e-3, -5, 5, notch=Notch(150.0, 60.0, 0.2))
    )
    controller.reset(0.02, 0.02, 1.5)
    assert [controller.step(0.02, 0.02) for _ in range(50)] == pytest.approx([1.5] * 50, abs=1e-12)


def test_what_is_fed_forward_goes_by_the_set_point():
    """On a ramp friction is overcome in its direction; while the ramp bends, mass is; noise on the sensor adds none."""
    settings = Settings(1e-3, acceleration=0.5, friction=0.4, friction_speed=0.01)
    controller = Controller(Gains(1e-9, 0.0, 0.0, 0.0, 1.0), settings)
    path = np.r_[0.0, 0.05 * 1e-3 * np.arange(1, 51), np.full(20, 0.05 * 50e-3)]
    path[51:] -= 0.05 * 1e-3 * np.arange(1, 21)  # and back
    out = [controller.step(float(r), 0.0) for r in path]
    assert out[20:50] == pytest.approx([0.4] * 30, abs=1e-6)
    assert out[55:] == pytest.approx([-0.4] * (len(out) - 55), abs=1e-6)
    assert out[1] == pytest.approx(0.4 + 0.5 * 0.05 / 1e-3, rel=1e-6)
    with pytest.raises(InputError, match="friction_speed"):
        Settings(1e-3, friction=0.4)
