"""Parameters of each recording's own, or of each group's: told to the model, fitted, written, read back."""

import numpy as np
import pandas as pd
import pytest

import optid
from optid.core.readers import read_recording
from optid.errors import RigError
from optid.rigs.per_recording import for_recordings, told
from optid.rigs.rigfile import read_rig

PLANT = '''
from optid import Parameter, Sheet

MASS = Parameter("mass", "kg", 1.0, "moving mass", "test", 1.0, (0.01, 100.0))
DAMPING = Parameter("damping", "N s/m", 1.0, "viscous friction", "test", 1.0, (0.0, 100.0))


def trolley(s: Sheet) -> None:
    """Force -> speed."""
    v = s.state("velocity", "m/s", 1.0, spread=1.0)
    s.rate(v, (s.input("force", "N") - s.param(DAMPING) * v) / s.param(MASS))
    s.output("speed", "m/s", v)
'''
RIG = """
model = "trolley.py:trolley"
[parameters]
mass = "1.5 kg"
damping = "1.2 N s/m"
[fit]
mass = { bounds = ["0.1 kg", "10 kg"], per = PER }
damping = { bounds = ["0.1 N s/m", "10 N s/m"] }
[channels]
time = { column = "t", unit = "s" }
force = { column = "f", unit = "N" }
speed = { column = "v", unit = "m/s" }
"""
MASSES = {"light": 1.0, "heavy": 2.5, "again": 1.0}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "trolley.py").write_text(PLANT)
    for number, (name, mass) in enumerate(MASSES.items()):
        rng = np.random.default_rng(number)
        t, dt = np.arange(400) * 0.01, 0.01
        force = np.repeat(rng.uniform(-3, 3, 20), 20)
        v, pole = np.zeros(400), np.exp(-dt * 2.0 / mass)
        for k in range(399):
            v[k + 1] = pole * v[k] + (1 - pole) * force[k] / 2.0
        noisy = v + rng.normal(scale=1e-3, size=400)
        pd.DataFrame({"t": t, "f": force, "v": noisy}).to_csv(tmp_path / f"{name}.csv", index=False)
    return tmp_path


def rig(folder, per='"recording"', more=""):
    (folder / "rig.toml").write_text(RIG.replace("PER", per) + more)
    return folder / "rig.toml"


def files(folder, *names):
    return [folder / f"{name}.csv" for name in names]


def test_each_recordings_own_is_found_with_its_interval_and_kept_in_the_rig_file(folder):
    found = optid.fit(rig(folder), files(folder, "light", "heavy"))
    light, heavy = found.parameters["mass[light]"], found.parameters["mass[heavy]"]
    assert light.value == pytest.approx(1.0, rel=0.01) and light.low <= 1.0 <= light.high
    assert heavy.value == pytest.approx(2.5, rel=0.01) and heavy.low <= 2.5 <= heavy.high
    assert found.parameters["damping"].value == pytest.approx(2.0, rel=0.01)
    assert "mass" not in found.parameters
    (folder / "fitted.toml").write_text(found.files["rig.toml"])
    again = read_rig(folder / "fitted.toml")
    assert again.recordings["heavy.csv"]["mass"] == pytest.approx(heavy.value, rel=1e-12)
    assert again.parameters["mass"] == 1.5
    shown = optid.simulate(folder / "fitted.toml", files(folder, "heavy"))
    assert shown.document["speed"]["free_run"]["fit_percent"] > 99.0


def test_groups_of_one_tag_have_one_value(folder):
    tags = "\n".join(
        f'[recordings."{name}.csv"]\nload = "{load}"' for name, load in zip(MASSES, "aba", strict=True)
    )
    found = optid.fit(rig(folder, '"load"', tags), files(folder, *MASSES))
    assert found.parameters["mass[load a]"].value == pytest.approx(1.0, rel=0.01)
    assert found.parameters["mass[load b]"].value == pytest.approx(2.5, rel=0.01)
    written = read_rig_text(folder, found)
    assert written["light.csv"]["mass"] == written["again.csv"]["mass"] != written["heavy.csv"]["mass"]
    assert written["heavy.csv"]["load"] == "b"


def read_rig_text(folder, found):
    (folder / "fitted.toml").write_text(found.files["rig.toml"])
    return read_rig(folder / "fitted.toml").recordings


def test_a_recording_without_the_tag_is_named(folder):
    with pytest.raises(RigError, match=r'heavy\.csv" has no tag "load".*mass') as error:
        optid.fit(
            rig(folder, '"load"', '[recordings."light.csv"]\nload = "a"'), files(folder, "light", "heavy")
        )
    assert error.value.field == "recordings"


def test_one_of_no_group_has_the_mean_and_others_their_own(folder):
    read = read_rig(rig(folder))
    data = [read_recording(path, read) for path in files(folder, *MASSES)]
    own = for_recordings(read, data[:2])
    p = own.model.vector({**own.parameters, "mass[light]": 1.0, "mass[heavy]": 3.0})
    roles = [port.role for port in own.model.inputs]
    for recording, mass in zip(data, (1.0, 3.0, 2.0), strict=True):
        channels = told(own, recording).channels
        u = [2.0 if role == "force" else channels[role].values[0] for role in roles]
        assert float(own.model.rates([0.5], u, p)) == pytest.approx((2.0 - 1.2 * 0.5) / mass)
    assert for_recordings(own, data) is own


def test_without_such_parameters_nothing_changes(folder):
    plain = read_rig(rig(folder))
    (folder / "plain.toml").write_text(RIG.replace(", per = PER", ""))
    read = read_rig(folder / "plain.toml")
    data = [read_recording(path, read) for path in files(folder, "light")]
    assert for_recordings(read, data) is read
    assert told(read, data[0]) is data[0]
    assert [q.name for q in plain.model.parameters] == ["damping", "mass"]


def test_a_diagnosis_takes_them_too(folder):
    found = optid.diagnose(
        rig(folder), files(folder, "light", "heavy"), holdout=files(folder, "again"), time_limit=20
    )
    values = found.document["baseline"]["parameters"]
    assert values["mass[heavy]"]["value"] == pytest.approx(2.5, rel=0.02)
