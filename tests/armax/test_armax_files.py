"""armax.json, Table 2, the survey behind `optid identify`, and the C export."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess

import numpy as np
import pandas as pd
import pytest

from optid.armax import (
    Armax,
    Constant,
    Directional,
    Identifier,
    Method,
    Settings,
    Variable,
)
from optid.armax.export_c import model_header, write_header
from optid.armax.files import ArmaxFile, SavedModel, from_survey, load, save, to_json
from optid.armax.plan import Plan
from optid.armax.prediction import innovations, predict
from optid.armax.survey import survey
from optid.armax.table2 import CAPTIONS, Entry, table2
from optid.errors import InputError

SYSTEM = Armax(
    a=(1.0, -1.5, 0.7), b=((1.0, 0.5),), c=(1.0, -0.6), nk=(2,), sample_time=0.01, noise_variance=0.01
)


@pytest.fixture(scope="module")
def result(simulated):
    y, u = simulated(SYSTEM, 1500, 0, switch=0.3)
    return survey(y, u, 0.01, Plan(orders=(1, 2, 3), steps=(1, 5, 10), unit="mm")), y, u


def test_survey_finds_order_and_delay(result):
    found, _, _ = result
    assert found.recommended == 2
    assert found.orders.recommended.nk == (2,)
    assert [c.order for c in found.candidates] == [1, 2, 3]
    assert found.chosen.settled
    assert found.chosen.audit.residuals.white
    assert "Take" in found.words


def test_every_input_s_path_is_audited(simulated):
    system = Armax(a=(1.0, -0.9), b=((1.0,), (-0.5,)), c=(1.0, 0.3), nk=(1, 1), noise_variance=0.01)
    y, u = simulated(system, 2000, 0, switch=0.3)
    found = survey(y, u, 0.01, Plan(orders=(1,), steps=(1,), delay=1)).chosen
    gains = [finding.text for finding in found.audit.findings if finding.name == "static_gain"]
    assert len(gains) == 2
    assert gains[1].startswith("Input 2: Static gain -")
    assert len([f for f in found.audit.findings if f.name == "independent"]) == 2
    assert np.array(found.model.b).ravel() == pytest.approx([1.0, -0.5], abs=0.02)


def test_json_loads_again_bit_for_bit(result, tmp_path):
    found, _, _ = result
    contents = from_survey(found)
    save(tmp_path / "armax.json", contents)
    again = load(tmp_path / "armax.json")
    assert again == contents
    assert [saved.intervals for saved in again.models] == [c.intervals for c in found.candidates]
    assert to_json(again) == (tmp_path / "armax.json").read_text(encoding="utf-8")
    document = json.loads(to_json(contents))
    assert document["schema"] == "optid.armax/1"
    model = document["models"][1]
    assert {"na", "nb", "nc", "nk", "a", "b", "c", "sample_time", "noise_variance", "audit"} <= set(model)
    assert (model["na"], model["nb"], model["nk"], model["a"][0], model["c"][0]) == (2, 2, 2, 1.0, 1.0)
    assert again.chosen.a == tuple(model["a"])


def test_json_with_two_inputs(tmp_path):
    model = Armax(a=(1.0, -0.1 / 3), b=((1.0, 1e-17 / 7), (2.0,)), nk=(1, 3))
    contents = ArmaxFile("command", "position", 1, (SavedModel(model),))
    save(tmp_path / "armax.json", contents)
    assert load(tmp_path / "armax.json") == contents


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "optid.fit/1"}, "schema"),
        ({"models": []}, "not a list"),
        ({"recommended": 9}, "recommended"),
        ({"recommended": "four"}, "recommended: .*a whole number"),
        ({"input": None, "models": [{"na": 1}]}, "missing"),
    ],
)
def test_a_damaged_file_is_refused(result, tmp_path, change, message):
    document = json.loads(to_json(from_survey(result[0]))) | change
    path = tmp_path / "armax.json"
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=message):
        load(path)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("noise_variance", -1.0, "noise_variance: -1; expected no negative number"),
        ("covariance", [[1.0]], "covariance: a matrix of another size; expected 3 rows"),
        ("covariance", [[1.0, 0.0, 0.0]] * 2 + [[1.0]], "covariance: a matrix of another size"),
        ("covariance", [[1e308] * 3] * 3, r"covariance: 1e\+308"),
        ("covariance", "abc", "covariance: found a text"),
        ("b", [1e101], r"b: 1e\+101"),
    ],
)
def test_numbers_that_no_model_can_have_are_refused(field, value, message, tmp_path):
    entry = {"na": 1, "nb": 1, "nc": 1, "nk": 1, "a": [1.0, -0.9], "b": [0.1], "c": [1.0, 0.1]}
    entry |= {"sample_time": 1e-3, "noise_variance": 1e-9, "covariance": [[1.0, 0.0, 0.0]] * 3}
    document = {"schema": "optid.armax/1", "input": "u", "output": "y", "recommended": 1, "models": [entry]}
    path = tmp_path / "armax.json"
    path.write_text(json.dumps(document))
    load(path)
    entry[field] = value
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match=message):
        load(path)


def test_no_file_and_no_json(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load(tmp_path / "none.json")
    (tmp_path / "armax.json").write_text("{")
    with pytest.raises(InputError, match="cannot be read"):
        load(tmp_path / "armax.json")


def test_table2_holds_what_its_captions_say(result):
    _, y, u = result
    table = table2(y, u, [Entry(2, 1, SYSTEM), Entry(2, 5, SYSTEM)], unit="mm")
    frame = table.frame()
    assert list(frame.columns) == list(CAPTIONS)
    row = frame[(frame.steps == 5) & (frame.signal == "error")].iloc[0]
    e = predict(SYSTEM, y, u, 5, estimated_start=True) - y
    e = e[np.isfinite(e)]
    assert row.square_error == pytest.approx(0.5 * np.sum(e**2))
    assert row.mean_square_error == pytest.approx(np.mean(e**2))
    assert row.sd == pytest.approx(pd.Series(e).std())
    assert (row["max"], row["min"]) == (e.max(), e.min())
    assert row.square_error_8 / row.sd**2 == pytest.approx(4.0, rel=1e-2)
    assert table.captions()["square_error"].endswith("mm²")
    assert table.captions()["sd"].endswith("mm")
    assert table.traces[2, 5].size == table.time().size == y.size


def compiled(tmp_path, source: str) -> ctypes.CDLL:
    if shutil.which("gcc") is None:
        pytest.skip("no gcc: the C export cannot be compiled here")
    (tmp_path / "main.c").write_text(source)
    flags = ["-O2", "-std=c99", "-Wall", "-Wextra", "-Werror", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, "main.c", "-o", "main.so", "-lm"], cwd=tmp_path, check=True)
    return ctypes.CDLL(str(tmp_path / "main.so"))


def pointer(x: np.ndarray) -> object:
    return x.ctypes.data_as(ctypes.POINTER(ctypes.c_double))


C_SETTINGS = [
    Settings(),
    Settings(method=Method.EXTENDED_LEAST_SQUARES, forgetting=Directional(0.99), outliers=4.0),
    Settings(forgetting=Variable(300.0, 0.95), outliers=5.0),
    Settings(forgetting=Constant(0.98)),
]


@pytest.mark.parametrize("settings", C_SETTINGS, ids=range(len(C_SETTINGS)))
def test_c_identifier_is_python_s(tmp_path, truth, simulated, settings):
    y, u = simulated(truth, 3000, 0)
    y[[300, 301]] = np.nan
    u[500] = np.nan
    y[900] += 30.0
    identifier = Identifier(truth.orders, settings=settings, scales=(2.0, [0.5]))
    write_header(tmp_path / "rig.h", identifier, "rig")
    library = compiled(
        tmp_path,
        '#include "rig.h"\nvoid go(double *m, const double *y, const double *u, long n, double *e) {'
        " rig_start(m); for (long t = 0; t < n; t++) e[t] = rig_step(m, y[t], u + t); }\n",
    )
    memory, e = np.empty(identifier.state.size), np.empty(y.size)
    library.go(pointer(memory), pointer(y), pointer(u), ctypes.c_long(y.size), pointer(e))
    expected, _ = identifier.run(y, u)
    assert e == pytest.approx(expected, rel=1e-12, abs=1e-12, nan_ok=True)
    assert memory == pytest.approx(identifier.state, rel=1e-12, abs=1e-12, nan_ok=True)


def test_c_identifier_with_two_inputs_goes_on_from_its_memory(tmp_path, simulated):
    system = Armax(a=(1.0, -0.9), b=((1.0, 0.5), (-2.0,)), c=(1.0, 0.4), nk=(1, 4), noise_variance=0.01)
    y, u = simulated(system, 1000, 5, switch=0.3)
    identifier = Identifier(system.orders)
    identifier.run(y[:500], u[:500])
    write_header(tmp_path / "rig.h", identifier, "rig")
    library = compiled(
        tmp_path,
        '#include "rig.h"\nvoid go(double *m, const double *y, const double *u, long n, double *e) {'
        " rig_start(m); for (long t = 0; t < n; t++) e[t] = rig_step(m, y[t], u + 2 * t); }\n",
    )
    memory, e, rest = np.empty(identifier.state.size), np.empty(500), np.ascontiguousarray(u[500:])
    library.go(pointer(memory), pointer(y[500:]), pointer(rest), ctypes.c_long(500), pointer(e))
    assert e == pytest.approx(identifier.run(y[500:], rest)[0], rel=1e-12, abs=1e-12)


def test_c_model_is_python_s(tmp_path, truth, simulated):
    y, u = simulated(truth, 1000, 0)
    write_header(tmp_path / "model.h", truth, "plant")
    library = compiled(
        tmp_path,
        '#include "model.h"\nvoid go(double *y, double *u, long n, long k, double *e, double *o) {'
        " plant_model m = {{0}, {0}, {{0}}}; double guess;"
        " for (long t = 0; t < n; t++) e[t] = plant_follow(&m, y[t], u + t, &guess);"
        " plant_ahead(&m, u + n, k, o); }\n",
    )
    e, out = np.empty(990), np.empty(10)
    library.go(pointer(y), pointer(u), ctypes.c_long(990), ctypes.c_long(10), pointer(e), pointer(out))
    # C begins from zeros, Python from measured outputs: equal once the roots of C have died out.
    assert e[200:] == pytest.approx(innovations(truth, y[:990], u[:990])[200:], rel=1e-12, abs=1e-12)
    expected = [predict(truth, y[: 990 + k], u[: 990 + k], k)[-1] for k in range(1, 11)]
    assert out == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_a_name_that_is_no_c_is_refused():
    with pytest.raises(InputError, match="a name in C"):
        model_header(SYSTEM, "2 fast")
