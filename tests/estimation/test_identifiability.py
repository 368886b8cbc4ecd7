"""What data cannot tell apart is said in words: exact symmetries of the plant, weak directions, idle parameters."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from optid.cli import cli
from optid.core.readers import read_recording
from optid.core.recording import Recording
from optid.core.simulation import simulate
from optid.estimation.identifiability import identifiability
from optid.rigs.rigfile import read_rig
from tests.estimation.cart import FREE, RATE, moved, record, recording, rig

DATA = Path(__file__).parents[2] / "data"
SCALED = ("supply_pressure", "payload_mass", "viscous_friction", "coulomb_friction")


@pytest.fixture(scope="module")
def choked(tmp_path_factory):
    """The bench without the rod's ambient force, exhausting into a vacuum: every outflow is choked."""
    path = tmp_path_factory.mktemp("choked") / "rig.toml"
    text = (DATA / "bench.toml").read_text()
    text = text.replace("[parameters]", "[options]\nrod_force = false\n\n[parameters]\n" + REST)
    text = text.replace('exhaust_pressure = "1 bar"', 'exhaust_pressure = "0.01 bar"')
    path.write_text(text.replace("[fit]", "[fit]\n" + SIZES))
    return read_rig(path)


REST = 'presliding_length = "0.01 mm"\nbristle_damping = "0.2 ms"\nbristle_fading = "20 mm/s"\nsampling_skew = "0 s"\n'
SIZES = 'supply_pressure = { bounds = ["2 bar", "15 bar"] }\npayload_mass = { bounds = ["0.5 kg", "9 kg"] }\n'


def run(rig, factor=1.0):
    """Position and pressures under the bench's command, with supply, start pressures, mass and forces scaled."""
    u = read_recording(DATA / "bench.csv", rig)["command"].values[:2000]
    p = rig.model.vector({**rig.parameters, **{name: factor * rig.parameters[name] for name in SCALED}})
    names = [state.name for state in rig.model.states]
    start = np.array(rig.model.start(rig.model.vector(rig.parameters))[0]).ravel()
    start[[names.index("pressure_a"), names.index("pressure_b")]] *= factor
    inputs = np.column_stack(
        [np.full(len(u), 1e-3) if port.role != "command" else u for port in rig.model.inputs]
    )
    found = simulate(rig.model, p, start, np.full(len(u), 1e-3), inputs, tolerance=1e-8)
    return found.outputs[0, :, 0], u


def test_scaling_supply_mass_and_forces_leaves_the_position_as_it_was(choked):
    plain, _ = run(choked)
    assert np.abs(run(choked, 1.3)[0] - plain).max() < 2e-8
    assert np.ptp(plain) > 0.05


def test_the_symmetry_of_choked_flow_is_said(choked):
    x, u = run(choked)
    data = read_recording(DATA / "bench.csv", choked)
    x = x + 3e-5 * np.random.default_rng(1).standard_normal(len(x))
    channels = {
        "command": replace(data["command"], values=u),
        "position": replace(data["position"], values=x),
    }
    ties = identifiability(choked, [Recording("choked.csv", data.time[: len(x)], channels)])
    (sentence,) = ties.sentences
    together = "scaling supply_pressure, payload_mass, viscous_friction and coulomb_friction by one factor"
    assert sentence.startswith(together)
    assert ties.condition > 100
    assert not ties.idle


def test_the_bench_itself_is_told_apart():
    bench = read_rig(DATA / "bench.toml")
    ties = identifiability(bench, [read_recording(DATA / "bench.csv", bench)])
    assert ties.sentences == ()
    assert ties.rank == len(ties.mute) == 7


def test_rank_counts_what_is_determined(tmp_path):
    free = f"{FREE}\nshare = {{ bounds = [0.1, 10] }}"
    ties = identifiability(rig(tmp_path, free), [recording(np.random.default_rng(1))])
    assert (ties.rank, len(ties.mute)) == (2, 3)
    assert ties.sentences == ("gain and share appear only as a product: fix one of them",)
    assert ties.condition > 1e4


def test_what_stands_still_is_idle(tmp_path):
    coasting = record(np.zeros(400), moved(np.zeros(400), 1 / RATE, v=1.0))
    ties = identifiability(rig(tmp_path), [coasting])
    assert ties.idle == ("gain",)
    assert "gain has no visible influence on these data" in ties.sentences


def checked(tmp_path, free, u, x):
    rig(tmp_path, free)
    pd.DataFrame({"t": np.arange(len(u)) / RATE, "u": u, "x": x}).to_csv(tmp_path / "cart.csv", index=False)
    return CliRunner().invoke(cli, ["check", f"{tmp_path}/cart.toml", f"{tmp_path}/cart.csv"])


def test_optid_check_says_it(tmp_path):
    data = recording(np.random.default_rng(2))
    u, x = data["command"].values, data["position"].values
    result = checked(tmp_path, f"{FREE}\nshare = {{ bounds = [0.1, 10] }}", u, x)
    assert result.exit_code == 0, result.output
    assert "rank 2 of 3" in result.output
    assert "gain and share appear only as a product" in result.output
    result = checked(tmp_path, FREE, u, x)
    assert "rank 2 of 2" in result.output
    assert "each has an effect of its own" in result.output
    assert "lag     speed of position against command" in result.output


def test_optid_check_fails_where_a_fit_would_be_refused(tmp_path):
    rng = np.random.default_rng(3)
    u = 1e-9 * np.repeat(rng.uniform(-1.0, 1.0, 8), 100)
    x = moved(u, 1 / RATE, v=1.0) + 1e-3 * rng.standard_normal(len(u))
    result = checked(tmp_path, FREE, u, x)
    assert result.exit_code == 1
    assert "no influence on the data: gain; a fit would be refused" in result.output
