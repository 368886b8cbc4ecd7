"""Values that no rig can have together, in [parameters] or for one recording; tags that mean a parameter."""

from pathlib import Path

import pytest

from optid.errors import RigError
from optid.rigs.rigfile import read_rig

DATA = Path(__file__).parents[2] / "data"


def said(tmp_path, name, old="", new="", more=""):
    """What reading a rig file of `data` says after a change."""
    text = (DATA / f"{name}.toml").read_text(encoding="utf-8")
    assert old in text
    (tmp_path / "rig.toml").write_text(text.replace(old, new) + more)
    with pytest.raises(RigError) as refused:
        read_rig(tmp_path / "rig.toml")
    return str(refused.value)


@pytest.mark.parametrize(
    ("name", "old", "new", "words"),
    [
        ("bench", 'rod_diameter = "16 mm"', 'rod_diameter = "43 mm"', "the rod is thinner than the bore"),
        ("bench", 'exhaust_pressure = "1 bar"', 'exhaust_pressure = "8 bar"', "supply pressure is above"),
        ("table1", 'coulomb_friction = "83 N"', 'coulomb_friction = "83 kN"', "supply overcomes Coulomb"),
        ("servo_hydraulic", 'coulomb_friction = "300 N"', 'coulomb_friction = "30 kN"', "supply overcomes"),
    ],
)
def test_what_cannot_be_built_or_moved_is_refused(tmp_path, name, old, new, words):
    assert words in said(tmp_path, name, old, new)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ('supply_pressure = "0.5 bar"', "the supply pressure is above the exhaust pressure"),
        ('rod_diameter = "60 mm"', "the rod is thinner than the bore"),
        ('payload_mass = "-3 kg"', "outside the physical range"),
        ('payload_mas = "3 kg"', 'did you mean "payload_mass"?'),
    ],
)
def test_so_is_what_one_recording_has_of_its_own(tmp_path, entry, words):
    message = said(tmp_path, "bench", more=f'\n[recordings."a.csv"]\n{entry}\n')
    assert words in message
    assert "recordings.a.csv" in message


def test_tags_of_other_names_are_tags(tmp_path):
    text = (DATA / "bench.toml").read_text(encoding="utf-8")
    tags = '\n[recordings."a.csv"]\npayload = 3\nline = "mass"\nsupply_pressure = "6 bar"\n'
    (tmp_path / "rig.toml").write_text(text + tags)
    own = read_rig(tmp_path / "rig.toml").recordings["a.csv"]
    assert own == {"payload": "3", "line": "mass", "supply_pressure": pytest.approx(6e5)}
