"""Inverse dynamics: exact on a made-up motion, and the published numbers on the published recording."""

import numpy as np
import pytest

from studies.emps_inverse_dynamics import (
    DRIVE_GAIN,
    PUBLISHED,
    PUBLISHED_SEPARATE,
    RECORDINGS,
    decimated,
    inverse_dynamics,
    main,
    read,
)

RECORDING = RECORDINGS / "DATA_EMPS.mat"
needs_recording = pytest.mark.skipif(
    not RECORDING.is_file(),
    reason="needs DATA_EMPS.mat of the EMPS benchmark, which is no part of the project",
)


def motion(forward=1.0):
    """A smooth motion with the force that the equation demands; `forward` scales F_v for v > 0."""
    t = np.arange(20000) * 1e-3
    w = 2 * np.pi * np.array([0.31, 0.87])
    q = 0.1 * np.sin(w[0] * t) + 0.02 * np.sin(w[1] * t)
    v = 0.1 * w[0] * np.cos(w[0] * t) + 0.02 * w[1] * np.cos(w[1] * t)
    acceleration = -0.1 * w[0] ** 2 * np.sin(w[0] * t) - 0.02 * w[1] ** 2 * np.sin(w[1] * t)
    viscous = 200.0 * v * np.where(v > 0, forward, 1.0)
    return t, q, (90.0 * acceleration + viscous + 20.0 * np.sign(v) - 3.0) / DRIVE_GAIN


def test_a_known_motion_gives_its_parameters_back():
    found = inverse_dynamics(*motion())
    assert found.table["value"].to_numpy() == pytest.approx([90.0, 200.0, 20.0, -3.0], rel=5e-3)
    assert found.relative_error < 0.01
    assert list(found.table["unit"]) == ["kg", "N s/m", "N", "N"]


def test_separate_directions_are_told_apart():
    found = inverse_dynamics(*motion(forward=0.5), separate=True).table["value"]
    assert found["Fv+"] == pytest.approx(100.0, rel=1e-2)
    assert found["Fv-"] == pytest.approx(200.0, rel=1e-2)
    assert found["Fc+"] - found["Fc-"] == pytest.approx(-6.0, abs=0.1)  # the offset counts against it


@pytest.mark.parametrize("n", [1000, 1001, 1009])
def test_decimation_keeps_the_last_sample(n):
    line = np.linspace(0.0, 1.0, n)
    kept = decimated(line, 10)
    assert len(kept) == -(-n // 10)
    ripple = 10 ** (-0.1 / 20)  # a Chebyshev filter of even order passes a constant 0.05 dB low, each way
    inner = slice(10, -10)  # away from the filter's ends
    assert kept[inner] / ripple == pytest.approx(line[::-1][::10][::-1][inner], abs=1e-4)


@needs_recording
@pytest.mark.parametrize(
    ("separate", "published", "error"), [(False, PUBLISHED, 4.08), (True, PUBLISHED_SEPARATE, 3.11)]
)
def test_published_values_are_reproduced(separate, published, error):
    found = inverse_dynamics(*read(RECORDING), separate=separate)
    for name, value in published.items():
        assert found.table["value"][name] == pytest.approx(value, rel=1e-4)
    assert 100 * found.relative_error == pytest.approx(error, abs=0.01)


def test_absent_recording_is_said_clearly(tmp_path, capsys):
    assert main([str(tmp_path)]) == 1
    assert "fetch the EMPS benchmark" in capsys.readouterr().out
