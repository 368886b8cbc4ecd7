"""The audit must find by itself what is known about the paper's printed models."""

from __future__ import annotations

import dataclasses
import math

import control
import numpy as np
import pytest

from optid.armax import Armax
from optid.armax.audit import audit
from optid.armax.batch import fit_batch
from optid.armax.loop import Gains, close_loop
from optid.errors import InputError
from studies.table2 import PAPER_GAINS, printed_table, published

# paper/notes.md: static gain, pole moduli, cancelled poles, and whether it is stable.
KNOWN = {
    (3, 1): (1.4826, [0.28, 0.21, 0.21], [(-0.280, -0.264)], True),
    (4, 1): (1.4447, [0.85, 0.85, 0.19, 0.19], [(-0.4055 + 0.7493j, -0.4048 + 0.7492j)], True),
    (5, 1): (1.4638, [1.025, 0.79, 0.19, 0.19, 0.09], [(1.0252, 1.0254), (0.7865, 0.7862)], False),
    (4, 10): (1.4332, [0.89, 0.73, 0.19, 0.19], [(0.8924, 0.8925), (-0.7254, -0.7251)], True),
}
EFFECTIVE = {(3, 1): 2, (4, 1): 2, (5, 1): 3, (4, 10): 2}


@pytest.mark.parametrize("which", list(KNOWN), ids=str)
def test_the_paper_s_models(which):
    gain, moduli, cancelled, stable = KNOWN[which]
    found = audit(published()[which], gains=PAPER_GAINS)
    assert found.static_gain == pytest.approx(gain, abs=5e-5)
    assert sorted(map(abs, found.poles), reverse=True) == pytest.approx(moduli, abs=0.006)
    pairs = sorted((c.pole for c in found.cancellations), key=abs)
    assert pairs == pytest.approx(sorted((p for p, _ in cancelled), key=abs), abs=6e-4)
    zeros = sorted((c.zero for c in found.cancellations), key=abs)
    assert zeros == pytest.approx(sorted((z for _, z in cancelled), key=abs), abs=6e-4)
    assert found.stable is stable
    assert found.effective_order == EFFECTIVE[which]
    assert found.only_static
    assert found.settles == 3
    assert 1.5 < found.first < 1.56
    assert not found.loop.stable
    said = {finding.name for finding in found.findings if finding.grave}
    assert {"cancellation", "effective_order", "only_static", "loop_unstable"} <= said
    assert ("unstable" in said) is not stable


@pytest.mark.parametrize("sample_time", [1 / 250e3, 1e-3, 0.1])
def test_the_paper_s_gains_fail_at_any_rate(sample_time):
    model = dataclasses.replace(published()[4, 1], sample_time=sample_time)
    loop = close_loop(model, PAPER_GAINS)
    assert not loop.stable
    assert loop.first_sample_kp == pytest.approx(16 * 1.5265)


def test_kp_alone_puts_a_pole_near_minus_24():
    poles = close_loop(published()[4, 1], Gains(kp=16.0)).poles
    assert min(p.real for p in poles) == pytest.approx(-24.5, abs=0.6)


def test_a_healthy_model_raises_no_alarm():
    model = control.tf([0.1, 0.05], [1, -1.5, 0.6], 0.01)
    found = audit(model, gains=Gains(kp=0.1, ki=0.1))
    assert found.stable and not found.only_static and not found.cancellations
    assert found.effective_order == 2
    assert found.static_gain == pytest.approx(1.5)
    assert found.time_constants[0] == pytest.approx(-1 / math.log(math.sqrt(0.6)))
    assert found.loop.stable
    assert not [f for f in found.findings if f.grave]


def test_largest_factor_is_the_gain_margin():
    model = published()[4, 1]
    factor = close_loop(model, Gains(kp=0.1, ki=0.2)).largest_factor
    for share, stable in ((0.9999, True), (1.0001, False)):
        assert close_loop(model, Gains(kp=0.1 * factor * share, ki=0.2 * factor * share)).stable is stable


def test_pid_polynomials_are_the_controller():
    gains, T = Gains(kp=2.0, ki=3.0, kd=0.5, derivative_filter=0.04), 0.01
    numerator, denominator = gains.polynomials(T)
    z = 0.3 + 0.8j
    expected = 2.0 + 3.0 * T * z / (z - 1) + 0.5 * (z - 1) / ((0.04 + T) * z - 0.04)
    assert np.polyval(numerator, z) / np.polyval(denominator, z) == pytest.approx(expected)


def test_an_integrator_is_told_from_instability(simulated):
    assert math.isinf(audit(([1.0], [1.0, -1.0]), None).static_gain)
    assert audit(([1.0], [1.0, -1.0])).findings[0].name == "integrating"
    system = Armax(a=(1.0, -1.6, 0.6), b=((1.0,),), nk=(1,), noise_variance=0.01)
    y, u = simulated(system, 1000, 0, switch=0.3)
    model = fit_batch([(y, u)], system.orders).model
    found = audit(model, y, u)
    slow = int(np.argmax(np.abs(found.poles)))
    assert abs(found.poles[slow] - 1.0) < 4 * found.pole_errors[slow] + 1e-12
    assert not [f for f in found.findings if f.name == "unstable"]
    assert found.residuals.white


def test_pole_errors_are_the_scatter(simulated):
    system = Armax(a=(1.0, -1.5, 0.7), b=((1.0,),), nk=(1,), noise_variance=1.0)
    moduli, errors = [], []
    for seed in range(60):
        y, u = simulated(system, 500, seed, switch=0.3)
        found = audit(fit_batch([(y, u)], system.orders).model)
        moduli.append(abs(found.poles[0]))
        errors.append(found.pole_errors[0])
    assert np.mean(errors) == pytest.approx(np.std(moduli), rel=0.35)


def test_continuous_and_improper_models_are_refused():
    with pytest.raises(InputError, match="continuous"):
        audit(control.tf([1], [1, 1]))
    with pytest.raises(InputError, match="more zeros than poles"):
        audit(([1.0, 0.0, 0.0], [1.0, 0.5]))


def test_the_printed_table_knows_what_does_not_agree():
    frame = printed_table()
    assert frame.loc[(4, 5, "error"), "over_sd_squared"] == pytest.approx(11.2, abs=0.1)
    others = [
        frame.loc[key, "over_sd_squared"]
        for key in [(3, 1, "error"), (4, 1, "error"), (5, 1, "error"), (4, 10, "error")]
    ]
    assert others == pytest.approx([3.98] * 4, abs=0.01)
    assert "repeats" in frame.loc[(4, 5, "error"), "remark"]
    assert len(published()) == 4
