"""A user's own effects and plant go where a rig file goes, under names that its folder understands."""

from pathlib import Path

import pytest

from optid.effects.library import from_file
from optid.errors import RigError
from optid.rigs.rigfile import read_rig, with_effects, write_rig

DATA = Path(__file__).resolve().parents[2] / "data"
PULL = """
from optid.core.parameter import Parameter
from optid.effects.effect import Effect
PULL = Parameter("pull", "N", 10.0, "a pull", "own", 0.0, (-1e4, 1e4))
class Pull(Effect):
    name, sites, parameters = "my_pull", ("force.external",), (PULL,)
    def apply(self, site, nominal, near, sheet):
        return nominal + sheet.param(PULL)
"""


@pytest.fixture
def pulled(tmp_path):
    """A rig with an effect from a file elsewhere, as a diagnosis adds it."""
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "mine.py").write_text(PULL)
    return with_effects(read_rig(DATA / "emps.toml"), from_file(tmp_path / "lab" / "mine.py"))


def test_an_effect_of_a_users_own_is_written_by_its_file_and_goes_with_it(pulled, tmp_path):
    for name in ("first", "second"):  # and from there to the next folder
        (tmp_path / name).mkdir()
        write_rig(pulled, tmp_path / name / "rig.toml", {"my_pull.pull": 12.5})
        assert '[effects."mine.py:my_pull"]\n' in (tmp_path / name / "rig.toml").read_text()
        assert (tmp_path / name / "mine.py").read_text() == PULL
        pulled = read_rig(tmp_path / name / "rig.toml")
        assert pulled.parameters["my_pull.pull"] == 12.5


def test_what_was_run_is_what_goes_along(pulled, tmp_path):
    """The file may have been edited since: hours lie between."""
    (tmp_path / "lab" / "mine.py").write_text(PULL.replace("10.0", "20.0"))
    (tmp_path / "out").mkdir()
    write_rig(pulled, tmp_path / "out" / "rig.toml")
    assert (tmp_path / "out" / "mine.py").read_text() == PULL


def test_another_file_of_the_same_name_is_left_alone(pulled, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.py").write_text("something else")
    write_rig(pulled, tmp_path / "out" / "rig.toml")
    assert (tmp_path / "out" / "mine.py").read_text() == "something else"
    assert '[effects."mine_2.py:my_pull"]' in (tmp_path / "out" / "rig.toml").read_text()
    assert read_rig(tmp_path / "out" / "rig.toml").effects[0].name == "my_pull"


def test_in_the_folder_of_the_file_nothing_is_copied(pulled, tmp_path):
    write_rig(pulled, tmp_path / "rig.toml")
    assert '[effects."lab/mine.py:my_pull"]' in (tmp_path / "rig.toml").read_text()
    assert {path.name for path in tmp_path.iterdir()} == {"lab", "rig.toml"}


def test_an_effect_outside_the_folder_is_refused(pulled, tmp_path):
    write_rig(pulled, tmp_path / "rig.toml")
    (tmp_path / "sub").mkdir()
    text = (tmp_path / "rig.toml").read_text().replace('"lab/mine.py', '"../lab/mine.py')
    (tmp_path / "sub" / "rig.toml").write_text(text)
    with pytest.raises(RigError, match="outside the folder of the rig file"):
        read_rig(tmp_path / "sub" / "rig.toml")
