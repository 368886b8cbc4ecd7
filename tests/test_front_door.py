"""The way in: what `import optid` offers, at what price, and from what a user has at hand."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import optid
from optid.errors import InputError, RecordingError

ROOT = Path(__file__).resolve().parents[1]
DATA = ROOT / "data"
# Slow to import, or needed by some calls only.
HEAVY = ("casadi", "numba", "scipy", "pandas", "matplotlib", "control", "pint", "jinja2")


def fresh(code):
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_the_command_line_keeps_the_linear_algebra_to_one_thread(monkeypatch):
    """Else the last digits of a diagnosis would depend on the number of cores."""
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    run = "import atexit, os, sys; sys.argv[1:] = ['--version']; import optid.cli; assert 'numpy' not in sys.modules; "
    said = fresh(run + "atexit.register(lambda: print(os.environ['OPENBLAS_NUM_THREADS'])); optid.cli.main()")
    assert said.splitlines()[-1] == "1"


def test_the_import_brings_nothing_heavy():
    said = fresh(f"import optid, sys; print([name for name in {HEAVY!r} if name in sys.modules])")
    assert said == "[]"


def test_help_brings_nothing_heavy():
    code = f"""
import sys
from click.testing import CliRunner
from optid import cli
assert CliRunner().invoke(cli.cli, ["--help"]).exit_code == 0
print([name for name in {HEAVY!r} if name in sys.modules])
"""
    assert fresh(code) == "[]"


def test_a_check_brings_no_distributions():
    """`scipy.stats` alone takes half of the start of every small job."""
    code = f"""
import sys
from click.testing import CliRunner
from optid import cli
done = CliRunner().invoke(cli.cli, ["check", {str(DATA / "bench.toml")!r}, {str(DATA / "worn.csv")!r}])
assert done.exit_code == 0, done.output
print("scipy" in sys.modules, "scipy.stats" in sys.modules)
"""
    assert fresh(code) == "True False"


def test_reading_a_rig_needs_neither_matplotlib_nor_pandas():
    code = f"""
import optid, sys
optid.read_rig({str(DATA / "bench.toml")!r}).model.to_casadi()
print([name for name in ("matplotlib", "pandas", "control") if name in sys.modules])
"""
    assert fresh(code) == "[]"


def test_the_calls_need_no_matplotlib_before_something_is_drawn():
    code = """
import optid, sys
for name in ("check", "simulate", "fit", "profile", "diagnose", "plan", "load"):
    getattr(optid, name)
print("matplotlib" in sys.modules)
"""
    assert fresh(code) == "False"


def test_every_public_name_is_there_and_unknown_ones_are_not():
    for name in optid.__all__:
        assert getattr(optid, name) is not None
        assert name in dir(optid)
    asked = """read_rig read_recording Recording check simulate fit profile diagnose identify tune plan build
        Parameter Sheet Effect Driver laws Rig Finding Verdict Outcome OptidError __version__ load datasets from_control
        export_fmu"""
    assert set(asked.split()) <= set(optid.__all__)
    with pytest.raises(AttributeError, match="frobnicate"):
        _ = optid.frobnicate
    assert (ROOT / "optid" / "py.typed").is_file()
    assert {"dry_friction", "signed_root", "soft_floor", "dead_zone"} <= set(optid.laws.__all__)


def test_a_type_checker_sees_the_surface(tmp_path):
    mypy = pytest.importorskip("mypy.api")
    file = tmp_path / "user.py"
    file.write_text(
        "import optid\n"
        'rig = optid.read_rig("bench.toml")\n'
        'reveal_type(optid.fit(rig, "run.csv"))\n'
        "reveal_type(optid.laws.signed_root)\n"
        "optid.nothing\n"
    )
    said, _, status = mypy.run([str(file), "--strict", f"--config-file={ROOT / 'pyproject.toml'}"])
    assert status == 1
    assert "FitResult" in said and "def (q: Any, width: Any)" in said
    assert said.count("error:") == 1 and '"nothing"' in said


def test_frames_and_arrays_by_column_or_role_are_the_recording_in_the_file():
    rig = optid.read_rig(DATA / "bench.toml")
    file = optid.read_recording(DATA / "bench.csv", rig)
    frame = pd.read_csv(DATA / "bench.csv")
    roles = frame.rename(columns={"t": "time", "u": "command", "x": "position", "r": "reference"})
    for made in (
        optid.Recording.from_frame(frame, rig, name="run"),
        optid.Recording.from_frame(roles, rig, name="run"),
        optid.Recording.from_arrays({name: frame[name].to_numpy() for name in frame}, rig, name="run"),
        optid.Recording.from_arrays(dict(roles), rig, name="run"),
    ):
        assert made.name == "run" and made.provenance is None
        pd.testing.assert_frame_equal(made.to_frame(), file.to_frame())


def test_data_in_memory_that_cannot_be_is_refused():
    rig = optid.read_rig(DATA / "bench.toml")
    frame = pd.read_csv(DATA / "bench.csv").head(10)
    with pytest.raises(RecordingError, match='no column "u"'):
        optid.Recording.from_frame(frame.drop(columns="u"), rig, name="run")
    with pytest.raises(RecordingError, match="one length"):
        optid.Recording.from_arrays({"t": np.arange(3.0), "u": np.zeros(4)}, rig)
    with pytest.raises(InputError, match="recordings: a dict; expected a path, a DataFrame"):
        optid.simulate(rig, {"t": [0, 1]})
    with pytest.raises(InputError, match="none is given"):
        optid.simulate(rig, [])
    with pytest.raises(RecordingError, match="twice"):
        optid.fit(rig, DATA / "bench.csv", holdout=DATA / "bench.csv")


def test_the_data_sets():
    rig, train, holdout = optid.datasets.load("worn")
    assert (rig.name, train.name, holdout.name) == ("bench", "worn.csv", "worn_holdout.csv")
    assert optid.datasets.load("bench").train.name == "bench.csv"
    with pytest.raises(InputError, match='did you mean "bench"'):
        optid.datasets.load("bensh")
    with pytest.raises(InputError, match=r"DATA_EMPS\.mat"):
        optid.datasets.load("emps")


def test_a_public_benchmark_is_read_from_a_file_the_user_has(shared):
    rig, train, holdout = optid.datasets.load("emps", shared / "recordings" / "emps")
    assert rig.name and train.name == "DATA_EMPS.mat" and holdout.name == "DATA_EMPS_PULSES.mat"


def test_an_example_folder_is_whole_and_nothing_is_overwritten(tmp_path):
    files = optid.datasets.example(tmp_path / "deep" / "start")
    assert {file.name for file in files} >= {"bench.toml", "worn.csv", "worn_holdout.csv", "bench.csv"}
    assert (tmp_path / "deep" / "start" / "worn.csv").read_bytes() == (DATA / "worn.csv").read_bytes()
    with pytest.raises(InputError, match="there already"):
        optid.datasets.example(tmp_path / "deep" / "start")


@pytest.mark.parametrize("name", ["README.md", "studies/docs/reference/python.md"])
def test_the_pages_python_is_right(name):
    """Its code parses and names what exists; the calls themselves run elsewhere."""
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / name).read_text(encoding="utf-8"), re.S)
    assert blocks
    for node in (node for block in blocks for node in ast.walk(ast.parse(block))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "optid":
            assert hasattr(optid, node.attr), node.attr


def test_the_readme_fits_a_screen_or_two():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 600
