"""The baselines do what they say: the equation residual is small, its terms are found, the network is the force."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from optid.core.readers import read_recording
from optid.effects.library import admitted
from optid.errors import NotIdentifiable
from optid.rigs.rigfile import read_rig
from studies.baselines import armax, exhaustive, neural, sparse
from studies.baselines.equation import Motion, flow, motion_of
from studies.baselines.neural import Network, NeuralForce, learned
from studies.baselines.sparse import selected
from studies.baselines.task import Said, Task, asked, deliver, finding
from studies.independent_rig import Controller, Sensors
from studies.trial.case import Case, Hidden
from studies.trial.record import record, write

BASE = {"viscous": 78.0, "coulomb": 83.0, "discharge": 0.8, "residual_length": 0.012}  # those of the rig file
RECORDINGS = ("steps", "multisine", "ramps")


@pytest.fixture(scope="module")
def pushed(tmp_path_factory):
    """A rig with a constant force of 20 N, with pressures."""
    force = Hidden("constant_force", "force", "large", {"force": 20.0})
    case = Case("case-1", "single", 5, BASE, (force,), True, "usual", Sensors(), Controller(), 0.1)
    folder = tmp_path_factory.mktemp("pushed")
    write(record(case, 3.0), folder)
    return folder


@pytest.fixture(scope="module")
def task(pushed):
    recordings = [str(pushed / f"{name}.csv") for name in RECORDINGS]
    arguments = [
        str(pushed / "rig.toml"),
        *recordings,
        "--holdout",
        str(pushed / "mixed.csv"),
        "--out",
        str(pushed / "out"),
    ]
    return asked(arguments)


def known(rig):
    return dict(zip([q.name for q in rig.model.parameters], rig.model.vector(rig.parameters), strict=True))


def test_the_task_is_read_as_diagnose_reads_it(task, pushed):
    assert isinstance(task, Task)
    assert [r.name for r in task.train] == [f"{name}.csv" for name in RECORDINGS]
    assert task.out == pushed / "out"


def test_what_eq_11_lacks_is_the_force_that_was_added(task):
    missing = [motion_of(recording, known(task.rig)) for recording in task.train]
    force = np.concatenate([m.force[m.slides] for m in missing])
    assert np.median(force) == pytest.approx(20.0, abs=3.0)


def test_without_sensors_the_pressures_follow_the_equations(task):
    recording = task.train[1]
    measured = motion_of(recording, known(task.rig))
    channels = {k: v for k, v in recording.channels.items() if not k.startswith("pressure")}

    class Blind:
        time, interval = recording.time, recording.interval

        def __contains__(self, role):
            return role in channels

        def __getitem__(self, role):
            return channels[role]

    followed = motion_of(Blind(), known(task.rig))
    late = slice(500, None)
    off = np.sqrt(np.mean((followed.P_a[late] - measured.P_a[late]) ** 2))
    assert off < 0.3e5


def test_the_flow_goes_down_the_pressure_and_chokes():
    heat = 287.0 * 293.0
    assert flow(1e-5, 7e5, 1e5, heat) == flow(1e-5, 7e5, 3e5, heat) > 0
    assert flow(1e-5, 1e5, 5e5, heat) < 0
    assert flow(1e-5, 5e5, 5e5, heat) == 0


@pytest.mark.parametrize(
    ("law", "name"),
    [
        (lambda m: 20.0 + 0 * m.v, "constant_force"),
        (lambda m: -300.0 * m.x, "spring_load"),
        (lambda m: -30.0 * np.sign(m.v) * np.exp(-np.abs(m.v) / 0.02), "stribeck_friction"),
        (lambda m: -15.0 * np.sign(m.v) - 8.0 * m.v, None),  # what a refit of the base takes
    ],
)
def test_sparse_regression_names_a_term_of_eq_11(law, name, monkeypatch):
    """On clean signals: what smoothing makes of stops and starts is not what is tested here."""
    rng = np.random.default_rng(0)
    t = np.arange(8000) * 1e-3
    x = 0.05 * np.sin(2.1 * t) + 0.03 * np.sin(5.3 * t + 1.0)
    v, a = np.gradient(x, t), np.gradient(np.gradient(x, t), t)
    still = np.zeros_like(t)
    motion = Motion(t, x, v, a, still, still, still, still, np.abs(v) > 2e-3)
    motion = replace(motion, force=law(motion) + rng.normal(scale=2.0, size=len(t)))
    monkeypatch.setattr(sparse, "motion_of", lambda recording, values: motion)
    assert sparse.named(SimpleNamespace(train=(None,)), SimpleNamespace(values={})) == name


def test_idle_terms_are_dropped_and_kept_ones_stay():
    rng = np.random.default_rng(0)
    X = rng.normal(size=(400, 5))
    y = 3.0 * X[:, 2] + 0.1 * rng.normal(size=400)
    chosen, theta = selected(y, X, [0])
    assert chosen == [0, 2]
    assert theta[1] == pytest.approx(3.0, abs=0.05)


def test_the_network_learns_and_stands_in_the_model_as_it_is():
    rng = np.random.default_rng(0)
    inputs = rng.uniform(-1, 1, (400, 3))
    force = 40.0 * inputs[:, 0] - 25.0
    network = learned(inputs, force, 0.3, rng)
    assert np.std(network(inputs) - force) < 0.2 * np.std(force)
    x, v, P = 0.03, -0.2, 0.7e5
    near = {"x": x, "v": v, "P_a": 4e5 + P, "P_b": 4e5}
    total = NeuralForce(network).apply("force.friction", 5.0, near, None)
    assert float(total) == pytest.approx(5.0 - float(network(np.array([[x / 0.1, v / 0.3, P / 1e5]]))[0]))
    assert abs(Network(np.zeros((8, 5)))(inputs)).max() == 0.0


@pytest.mark.parametrize(
    ("errors", "best"), [((2.0, 3.0, 1.0, 4.0, 5.0), 1.0), ((1.0, 2.0, 3.0, 4.0, 5.0), None)]
)
def test_a_recording_that_it_has_not_learned_from_chooses_the_network_or_none(
    task, monkeypatch, errors, best
):
    left, judged = iter(errors), []

    def rmse(rig, recording, base):
        judged.append(recording.name)
        return next(left)

    monkeypatch.setattr(neural, "window_rmse", rmse)
    monkeypatch.setattr(neural, "learned", lambda inputs, force, decay, rng: Network(np.full((1, 5), decay)))
    rig = neural.chosen(task, SimpleNamespace(values=known(task.rig)))
    assert judged == ["ramps.csv"] * 5
    assert [effect.network.weights[0, 0] for effect in rig.effects] == ([] if best is None else [best])


def test_the_networks_slopes_are_those_of_differences():
    rng = np.random.default_rng(1)
    weights, inputs = rng.normal(size=(8, 5)), rng.normal(size=(6, 3))
    slopes = Network(weights).slopes(inputs)
    for k in (0, 8, 23, 39):
        nudge = np.zeros(40)
        nudge[k] = 1e-6
        up, down = (Network(weights + sign * nudge.reshape(8, 5))(inputs) for sign in (1, -1))
        assert slopes[:, k] == pytest.approx((up - down) / 2e-6, rel=1e-5, abs=1e-5)


def test_the_black_box_is_judged_on_windows_it_does_not_see(task, monkeypatch):
    monkeypatch.setattr(armax, "ORDERS", (3,))
    monkeypatch.setattr(armax, "asked", lambda: task)
    armax.main()
    said = json.loads((task.out / "diagnosis.json").read_text())
    assert said["findings"] == []
    spread = float(np.nanstd(task.holdout["position"].values))
    assert 0.1e-3 < said["improved"]["holdout"]["position"]["rmse"] < spread


def test_an_answer_has_the_contracts_form(task):
    deliver(task, Said("missing-physics", (finding("valve_lag", "valve"),), {}, 2e-4, 1e-4))
    said = json.loads((task.out / "diagnosis.json").read_text())
    assert said["schema"] == "optid.diagnosis/1"
    assert said["findings"][0]["effect"] == "valve_lag"
    assert said["baseline"]["holdout"]["position"]["rmse"] == 2e-4


def test_the_rig_file_of_a_case_reads(pushed):
    rig = read_rig(pushed / "rig.toml")
    assert {f.name for f in rig.freed} >= {"viscous_friction", "coulomb_friction", "discharge_coefficient"}
    assert len(read_recording(pushed / "mixed.csv", rig)) == 3000


def test_brute_force_fits_slower_recordings_and_is_judged_by_what_was_recorded(task):
    slower = exhaustive.slower(task)
    assert [len(after) for after in slower.train] == [len(before) // 4 for before in task.train]
    assert slower.holdout is task.holdout


def test_brute_force_begins_where_the_base_model_was_fitted(task, monkeypatch):
    began = []

    def fit(rig, recordings, options):
        began.append(rig.parameters["viscous_friction"])
        return SimpleNamespace(values={"viscous_friction": 77.0}, parameters=())

    monkeypatch.setattr(exhaustive, "asked", lambda: task)
    monkeypatch.setattr(exhaustive, "fit", fit)
    monkeypatch.setattr(exhaustive, "bic", lambda *_: 1.0)
    monkeypatch.setattr(exhaustive, "window_rmse", lambda *_: 1e-4)
    exhaustive.main()
    assert began[0] == task.rig.parameters["viscous_friction"]
    assert set(began[1:]) == {77.0}
    assert json.loads((task.out / "diagnosis.json").read_text())["verdict"] == "consistent"


def test_brute_force_refits_the_strength_alone_where_the_form_does_not_show(task, monkeypatch):
    effect = next(one for one in admitted(task.rig.model) if one.name == "valve_deadband")
    base = {one.name for one in task.rig.freed}
    asked = []

    def fit(rig, recordings, options):
        asked.append({one.name for one in rig.freed} - base)
        if len(asked) == 1:
            raise NotIdentifiable("its form does not show")
        return "found"

    monkeypatch.setattr(exhaustive, "fit", fit)
    monkeypatch.setattr(exhaustive, "bic", lambda *_: 1.0)
    assert exhaustive.attempt(task, effect)[1] == "found"
    assert asked == [
        {f"{effect.name}.{one.name}" for one in effect.parameters},
        {f"{effect.name}.{name}" for name in effect.strength},
    ]
