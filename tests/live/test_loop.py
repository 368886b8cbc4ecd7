"""The numbers of a session, in lockstep: reproducible, readable by every command, and right where that is known."""

import math

import numpy as np
import pandas as pd
import pytest

from optid.armax.identifier import Identifier
from optid.armax.structure import Orders
from optid.core.readers import read_recording
from optid.live.driver import open_driver
from optid.live.loop import Choices, Loop
from optid.live.messages import Sample
from optid.live.one_step_prediction import predict_next
from optid.live.oscillation_detector import OscillationDetector
from optid.live.reference import Reference, read_profile, tour
from optid.live.settings import live_settings, wiring_of
from optid.pid.controller import Gains
from optid.quality.quality import quality
from optid.rigs.rigfile import read_rig


def test_the_log_is_a_recording_that_every_command_reads(bench, run_live):
    end, _, path = run_live(bench, seconds=3.0)
    assert (end.samples, end.missed, end.safe) == (3000, 0, True)
    record = read_recording(path, bench)
    assert len(record) == 3000
    assert set(record.channels) == {"command", "position", "reference"}
    assert np.max(record["reference"].values) == pytest.approx(0.5 * 0.117)
    assert np.nanmax(np.abs(record["position"].values)) > 0.03  # it did follow
    assert not [remark for remark in quality(record, bench.model) if remark.severity == "error"]


def test_the_same_seed_gives_the_same_session(bench, run_live):
    choices = Choices(Gains(30.0, 20.0), dither=0.05, seed=3)
    first, second = (run_live(bench, seconds=1.0, choices=choices, seed=4)[2].read_text() for _ in range(2))
    other = run_live(bench, seconds=1.0, choices=choices, seed=5)[2].read_text()
    assert first == second != other


def test_one_step_predictions_are_the_identifiers_own(bench, run_live):
    _, loop, path = run_live(bench, seconds=2.0, choices=Choices(Gains(30.0), dither=0.1))
    log = pd.read_csv(path)
    y, u = log["x"].to_numpy() * 1e-3, log["u"].to_numpy()
    again = Identifier(Orders(4, (4,), 4, (1,)), 1e-3, scales=(0.234 / 4, 2.5))
    innovations = np.array([again.step(y[n], u[n]) for n in range(len(y))])
    logged = y - log["x_predicted"].to_numpy() * 1e-3
    assert np.max(np.abs(innovations[200:] - logged[200:])) < 1e-7  # the log's digits
    np.testing.assert_allclose(loop.identifier.theta, again.theta, rtol=1e-3, atol=1e-3)


def test_one_ahead_knows_the_innovation_before_the_sample():
    rng = np.random.default_rng(1)
    for na, nb, nc, nk in ((1, 1, 0, 1), (2, 3, 1, 2), (4, 4, 4, 1), (0, 2, 2, 3)):
        learner = Identifier(Orders(na, (nb,), nc, (nk,)), scales=(2.0, 3.0))
        for y, u in rng.standard_normal((300, 2)):
            expected = predict_next(learner.state)
            assert learner.step(y, u) == pytest.approx(y - expected, abs=1e-9)


def test_a_rig_that_is_the_model_never_parts(bench, run_live, tmp_path):
    same = tmp_path / "same.toml"
    same.write_text(f'{bench.source}\n[live.simulated]\nrig = "{bench.path}"\n', encoding="utf-8")
    _, loop, path = run_live(read_rig(same), seconds=16.0, choices=Choices(Gains(30.0)))
    assert loop.parallel.monitor.verdict.fit_percent > 99
    assert not loop.parallel.monitor.verdict.disagree
    log = pd.read_csv(path)
    late = log[log["t"] > 1.0]
    error = late["x"] - late["x_simulated"]
    assert math.sqrt((error**2).mean()) < 1.0  # mm: a loop of its own, on the same reference


def test_another_reference_is_followed_from_the_next_sample_on(bench):
    settings, wiring = live_settings(bench), wiring_of(bench)
    loop = Loop(bench, settings, wiring, Reference((0.0,), (0.01,)), Choices(Gains(20.0)))
    answered = [loop.step(Sample(n, n * 1e-3, 0.0, 0.0, [0.0])).reference for n in range(2)]
    loop.demand(read_profile("0:0 mm, 0.002:30 mm", settings.limits, "m"))
    answered += [loop.step(Sample(n, n * 1e-3, 0.0, 0.0, [0.0])).reference for n in range(2, 6)]
    assert answered == [0.01, 0.01, 0.0, 0.0, 0.03, 0.03]


def test_new_gains_come_without_a_jump(bench, run_live):
    _, loop, _ = run_live(
        bench, seconds=1.0, choices=Choices(Gains(20.0, 30.0)), reference=Reference((0.0,), (0.02,))
    )
    before = loop.controller.command
    loop.change(Gains(60.0, 90.0, 0.1, 1e-3))
    r, y = 0.02, loop.measured
    assert loop.controller.step(r, y) == pytest.approx(before, abs=0.05)


def answers(loop, accepted, samples, first=0):
    """Commands of a loop whose axis stands at 0; `accepted` says what the guard puts in the place of each."""
    found, standing = [], 0.0
    for n in range(first, first + samples):
        found.append(loop.step(Sample(n, n * 1e-3, standing, standing, [0.0])).command)
        standing = accepted(n, found[-1])
    return found


def test_after_a_missed_deadline_the_error_is_answered_again(bench):
    settings, wiring = live_settings(bench), wiring_of(bench)
    loop = Loop(bench, settings, wiring, Reference((0.0,), (0.05,)), Choices(Gains(25.0, 20.0)))
    commands = answers(loop, lambda n, wish: 0.0 if n == 50 else wish, 60)
    assert commands[50] == pytest.approx(25 * 0.05 + 20 * 0.05 * 0.05, abs=0.01)
    assert commands[59] == pytest.approx(commands[50] + 9 * 1e-3, rel=1e-2)  # V; the integral goes on


def test_the_integral_rests_while_the_guard_holds_the_command_back(bench):
    settings, wiring = live_settings(bench), wiring_of(bench)
    loop = Loop(bench, settings, wiring, Reference((0.0,), (0.05,)), Choices(Gains(25.0, 20.0)))
    held = answers(loop, lambda n, wish: 0.1, 1000)
    assert held[-1] <= 0.1 + settings.limits.rate * 1e-3 + 1e-9
    free = answers(loop, lambda n, wish: wish, 10, first=1000)
    assert free[-1] == pytest.approx(25 * 0.05 + 10 * 1e-3, rel=1e-2)


def test_gains_that_make_the_loop_oscillate_are_taken_back(bench):
    settings, wiring = live_settings(bench), wiring_of(bench)
    loop = Loop(bench, settings, wiring, tour(settings.limits), Choices(Gains(20.0)))
    order = {"wiring": wiring, "settings": settings, "recording": None, "seed": 0}
    driver, command = open_driver("simulated", bench, order), 0.0

    def run(first, last):
        nonlocal command
        for n in range(first, last):
            reply = loop.step(Sample(n, n * 1e-3, command, command, driver.read(n * 1e-3)))
            command = driver.write(reply.command, n * 1e-3)

    run(0, 2500)
    loop.change(Gains(30.0))
    run(2500, 5000)
    assert loop.controller.gains == Gains(30.0)  # nothing wrong with these
    loop.change(Gains(900.0))
    run(5000, 9000)
    assert loop.controller.gains == loop.taken_back == Gains(30.0)


def test_turns_of_the_command_are_counted_and_forgotten():
    detector = OscillationDetector(1e-3, 10.0)
    assert not any(
        detector.add(5.0 * np.exp(-3e-3 * k) * np.cos(0.02 * k)) for k in range(3000)
    )  # a step response
    assert not any(detector.add(0.5 * (-1) ** k) for k in range(3000))  # noise within a share of the range
    answers = [detector.add(3.0 * np.sin(2 * np.pi * 8 * 1e-3 * k)) for k in range(3000)]
    assert 500 < answers.index(True) < 1500  # sixteen turns a second
    assert answers[-1]
    assert not detector.add(0.0) or not all(detector.add(0.0) for _ in range(2000))
    detector.forget()
    assert not detector.add(0.0)
