"""`optid identify`: what it writes, what it says, how it refuses."""

from __future__ import annotations

import json
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner
from malformed import CASES, SOUND_RECORDING, SOUND_RIG, Case, make

from optid import cli
from optid.armax import Armax
from optid.armax.files import load
from optid.armax.prediction import predict
from optid.report.armax_page import equation

DATA = Path(__file__).resolve().parents[1] / "data"
RIG = DATA / "bench.toml"
ORDERS, STEPS = [2, 4], [1, 5]


def run(*arguments):
    return CliRunner().invoke(cli.cli, [str(argument) for argument in arguments], prog_name="optid")


def refused(result, status=2):
    assert result.exit_code == status, result.output
    line = result.stderr.strip()
    assert line.startswith("optid: ") and "\n" not in line
    assert "Traceback" not in result.output
    return line


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """The first 1.5 s of the bench, in which it moves."""
    path = tmp_path_factory.mktemp("data") / "short.csv"
    pd.read_csv(DATA / "bench.csv", comment="#").iloc[:1500].to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def done(recording, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "armax"
    arguments = (
        "--orders",
        "2,4",
        "--steps",
        "1,5",
        "--gains",
        "30,20",
        "--export-c",
        "--export-st",
        "--out",
        out,
    )
    result = run("identify", recording, "--rig", RIG, *arguments)
    assert result.exit_code == 0, result.output
    return result, out


def test_files_and_summary(done):
    result, out = done
    names = {"manifest.json", "armax.json", "table2.csv", "report.html"}
    names |= {f"armax_{what}.{kind}" for what in ("model", "identifier") for kind in ("h", "st")}
    assert {path.name for path in out.iterdir()} == names
    assert result.stdout.startswith("position from command: ")
    assert "stabilise" in (out / "report.html").read_text(encoding="utf-8")
    assert len(result.stdout.splitlines()) < 50
    assert "last value" in result.stdout and "held out" in result.stdout


def test_json_is_the_contract_s(done):
    document = json.loads((done[1] / "armax.json").read_text(encoding="utf-8"))
    assert document["schema"] == "optid.armax/1"
    assert (document["input"], document["output"]) == ("command", "position")
    assert document["units"] == {"input": "V", "output": "m"}
    assert [model["na"] for model in document["models"]] == ORDERS
    assert document["recommended"] in ORDERS
    for model in document["models"]:
        assert len(model["a"]) == model["na"] + 1 and len(model["b"]) == model["nb"]
        assert len(model["c"]) == model["nc"] + 1 and model["nk"] >= 1
        assert model["sample_time"] == pytest.approx(0.001)
        assert any(finding["name"] in ("loop_stable", "loop_unstable") for finding in model["audit"])


def test_table_is_what_the_saved_models_predict(done, recording):
    """table2.csv from armax.json and the recording alone: units, orders and horizons."""
    table = pd.read_csv(done[1] / "table2.csv", comment="#")
    errors = table[table.signal == "error"]
    for part in ("in sample", "held out"):
        rows = errors[errors.part == part]
        assert [*zip(rows.order, rows.steps, rows.predictor, strict=True)] == [
            (2, 1, "armax"),
            (4, 1, "armax"),
            (4, 5, "armax"),
            (4, 5, "armax, 5 steps"),
            (0, 1, "last value"),
            (0, 5, "last value"),
        ]
    still = errors[(errors.predictor == "last value") & (errors.part == "in sample")]
    assert still.lag.to_numpy() == pytest.approx([1.0, 5.0], abs=0.05)
    raw = pd.read_csv(recording)
    y, u = raw["x"].to_numpy() * 1e-3, raw["u"].to_numpy()
    for saved in load(done[1] / "armax.json").models:
        e = predict(saved.model, y, u, 1, estimated_start=True) - y
        row = table[
            (table.order == saved.model.orders.na) & (table.steps == 1) & (table.signal == "error")
        ].iloc[0]
        assert row.mean_square_error == pytest.approx(np.nanmean(e**2), rel=1e-9)
    captions = [line for line in (done[1] / "table2.csv").read_text().splitlines() if line.startswith("#")]
    assert len(captions) == len(table.columns)


def test_report_stands_alone(done):
    class Tags(HTMLParser):
        def __init__(self):
            super().__init__()
            self.seen: list[str] = []
            self.links: list[str] = []

        def handle_starttag(self, tag, attributes):
            self.seen.append(tag)
            self.links += [v for k, v in attributes if k in ("src", "href") and v and not v.startswith("#")]

    page, tags = (done[1] / "report.html").read_text(encoding="utf-8"), Tags()
    tags.feed(page)
    assert tags.links == []
    assert page.count('<div class="figure"') == 7
    for words in (
        "The recommended model",
        "Table 2",
        "eq. 13",
        "Choice of order",
        "do not know",
        "Responses of the models",
        "pole of the rig",
    ):
        assert words in page
    assert "{{" not in page and "nan" not in page.split("<div")[0]


@pytest.mark.parametrize(
    "case",
    [
        c
        for c in CASES
        if c.name
        in (
            "unit misspelt",
            "TOML syntax",
            "no command",
            "rig absent",
            "missing column",
            "empty file",
            "time goes back",
            "binary garbage",
            "absent",
            "row: text in numbers",
        )
    ],
    ids=lambda case: case.name,
)
def test_malformed_files_are_refused_and_nothing_is_written(case, tmp_path):
    rig, path = make(case, tmp_path)
    line = refused(run("identify", path, "--rig", rig, "--out", tmp_path / "out"))
    assert (rig if case.fault == "rig" else path).name in line
    assert not (tmp_path / "out").exists()
    assert not list(tmp_path.glob(".*.part"))


@pytest.mark.parametrize(
    ("arguments", "fragment"),
    [
        (("--orders", "3,x"), '"3,x"'),
        (("--orders", "0"), "at least 1"),
        (("--orders", ""), "--orders"),
        (("--orders", "400"), "parameters"),
        (("--steps", "1,-5"), "--steps"),
        (("--delay", "-1"), "--delay"),
        (("--delay", "1,2"), "one per input"),
        (("--nb", "0"), "--nb"),
        (("--forgetting", "0.2"), "0.5 to 1"),
        (("--forgetting", "fading:0.9"), "directional"),
        (("--method", "ls"), "--method"),
        (("--gains", "1,2,3,4"), "KP,KI,KD"),
        (("--gains", "nan"), "KP,KI,KD"),
        (("--output", "postion"), 'did you mean "position"'),
        (("--input", "force"), "no channel"),
        (("--input", "position"), "differ"),
    ],
    ids=str,
)
def test_wrong_calls_are_refused(arguments, fragment, recording, tmp_path):
    line = refused(run("identify", recording, "--rig", RIG, "--out", tmp_path / "out", *arguments))
    assert fragment in line
    assert list(tmp_path.iterdir()) == []


def test_missing_options_are_named(recording, tmp_path):
    assert "--rig" in refused(run("identify", recording, "--out", tmp_path / "out"))
    assert "--out" in refused(run("identify", recording, "--rig", RIG))


@pytest.mark.parametrize("change", ["still", "short"])
def test_data_that_teach_nothing_fail_the_job(change, recording, tmp_path):
    table = pd.read_csv(recording)
    table = table.assign(u=1.0) if change == "still" else table.iloc[:12]
    table.to_csv(tmp_path / "run.csv", index=False)
    line = refused(run("identify", tmp_path / "run.csv", "--rig", RIG, "--out", tmp_path / "out"), status=1)
    assert "never changes" in line or "cannot determine" in line
    assert not (tmp_path / "out").exists()


def test_gaps_and_missing_samples_are_lived_with(recording, tmp_path):
    table = pd.read_csv(recording)
    table.loc[700:704, "x"] = np.nan
    table.loc[900, "u"] = np.nan
    table = table.drop(index=range(1100, 1120))
    table.to_csv(tmp_path / "run.csv", index=False)
    result = run("identify", tmp_path / "run.csv", "--rig", RIG, "--orders", "3", "--out", tmp_path / "out")
    assert result.exit_code == 0, result.output
    model = load(tmp_path / "out" / "armax.json").chosen
    assert np.sqrt(model.noise_variance) < 1e-4


def test_sound_but_tiny_file_fails_in_words(tmp_path):
    rig, path = make(Case("sound", "none", (), SOUND_RIG, SOUND_RECORDING), tmp_path)
    result = run("identify", path, "--rig", rig, "--orders", 3, "--out", tmp_path / "out")
    assert result.exit_code in (0, 1)
    assert "bug" not in result.output


def test_the_equation_reads_as_eq_12():
    model = Armax(a=(1.0, -0.5, 0.25), b=((2.0, -1.0),), c=(1.0, 0.3), nk=(1,))
    words = "y(t) = 0.5 y(t−1) − 0.25 y(t−2) + 2 u(t−1) − 1 u(t−2) + e(t) + 0.3 e(t−1)"
    assert equation(model) == words
    assert equation(Armax(a=(1.0, 0.5))) == "y(t) = − 0.5 y(t−1) + e(t)"


@pytest.mark.parametrize("method", ["rls", "rml"])
def test_all_of_eq_12_and_one_estimator(method, recording, tmp_path):
    """A structure of the user's own by a recursion: the models of the file and of the table are that recursion's."""
    options = (
        "--na",
        2,
        "--nb",
        "1,2",
        "--nc",
        1,
        "--delay",
        "1,3",
        "--input",
        "command",
        "--input",
        "reference",
    )
    more = ("--method", method, "--forgetting", "0.999", "--trend", "none", "--steps", "1")
    result = run("identify", recording, "--rig", RIG, "--out", tmp_path, *options, *more)
    assert result.exit_code == 0, result.output
    [saved] = load(tmp_path / "armax.json").models
    o = saved.model.orders
    assert (o.na, o.nb, o.nc, o.nk) == (2, (1, 2), 1, (1, 3))
    assert saved.model.constant == 0.0
    raw = pd.read_csv(recording)
    y, u = raw["x"].to_numpy() * 1e-3, raw[["u", "r"]].to_numpy() * [1.0, 1e-3]
    table = pd.read_csv(tmp_path / "table2.csv", comment="#")
    row = table[(table.signal == "error") & (table.predictor == "armax") & (table.part == "in sample")].iloc[
        0
    ]
    assert row.mean_square_error == pytest.approx(
        np.nanmean((predict(saved.model, y, u, 1, estimated_start=True) - y) ** 2), rel=1e-9
    )
    assert ("least squares" in result.stdout) is (method == "rls")


def test_an_operating_point_is_told(tmp_path):
    """A first-order plant around 3 V and 50 mm: the gain is right and the constant is said, from the command line."""
    from scipy.signal import lfilter

    rng = np.random.default_rng(0)
    u = np.where(np.cumsum(rng.random(2500) < 0.1) % 2, 0.5, -0.5)
    x = 50 + lfilter([0.0, 0.1], [1.0, -0.95], u) + 0.01 * rng.standard_normal(u.size)
    pd.DataFrame({"t": 0.001 * np.arange(u.size), "u": 3 + u, "x": x}).to_csv(
        tmp_path / "run.csv", index=False
    )
    rig = RIG.read_text().split("reference")[0]
    (tmp_path / "rig.toml").write_text(rig)
    call = (
        "identify",
        tmp_path / "run.csv",
        "--rig",
        tmp_path / "rig.toml",
        "--orders",
        "1,2",
        "--out",
        tmp_path / "o",
    )
    result = run(*call)
    assert result.exit_code == 0, result.output
    document = json.loads((tmp_path / "o" / "armax.json").read_text())
    model = next(m for m in document["models"] if m["na"] == document["recommended"])
    low, high = model["static_gain"][0]["ci95"]
    assert low < 2e-3 < high < 2.1e-3
    assert model["constant"] == pytest.approx((0.05 - 2e-3 * 3) * sum(model["a"]), rel=0.01)
    assert "Operating point in the model" in result.stdout
