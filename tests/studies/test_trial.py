"""The blind trial: it draws evenly, seals its answers, measures concealment, stops in time and judges fairly."""

import ast
import json
import re
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from optid.effects.library import built_in
from studies import concealed, trial
from studies.independent_rig import Controller, Rig, Sensors, recording, simulate
from studies.independent_rig.states import PA, PB
from studies.trial import running, scoring
from studies.trial.board import Rate, board, conformal, rates, spreads, text
from studies.trial.case import SIZES, Case, Hidden, case_from
from studies.trial.compose import compose
from studies.trial.concealment import Trace, acts_when, hidden_by, trace, traces
from studies.trial.drawing import Order, draw
from studies.trial.excitation import STYLES
from studies.trial.judging import CaseOutcome, judge
from studies.trial.named import NAMED
from studies.trial.oracle import PRIOR, _estimated, _measured, oracle_rmse
from studies.trial.outside import OUTSIDE
from studies.trial.overlap import interval_overlap, time_overlap
from studies.trial.record import Recorded, record
from studies.trial.scoring import score
from studies.trial.seal import SealError, seal, unseal
from studies.trial.sizes import Draw

pytest.importorskip("cryptography", reason="the trial's seal needs cryptography")

BASE = {"viscous": 70.0, "coulomb": 80.0, "discharge": 0.75, "residual_length": 0.01}
CONTRACT = """stribeck_friction asymmetric_friction constant_force position_dependent_friction spring_load
quadratic_drag
periodic_disturbance friction_drift end_cushioning compliant_load cross_leakage ambient_leakage heat_transfer
critical_pressure_ratio supply_droop exhaust_restriction valve_deadband valve_offset valve_lag input_delay
valve_hysteresis valve_saturation valve_underlap sensor_backlash sensor_lag sensor_nonlinearity sensor_drift
presliding"""


def case(*hidden, kind="single", **other):
    conditions = {"with_pressures": False, "noise": "usual", "sensors": Sensors(), "controller": Controller()}
    return Case("case-1", kind, 5, BASE, hidden, reach=0.1, **{**conditions, **other})


def test_it_imports_nothing_of_optid():
    """What draws, conceals and judges; cases run as rows of a fleet do."""
    files = [path for path in sorted(Path(trial.__file__).parent.glob("*.py")) if path.name != "running.py"]
    assert len(files) > 10
    for path in [*files, Path(concealed.__file__)]:
        tree = ast.parse(path.read_text())
        modules = [n.module or "" for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)]
        modules += [a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names]
        assert not [name for name in modules if name.split(".")[0] == "optid"], path


def test_every_name_of_the_contract_is_drawn_and_five_that_are_none():
    assert set(CONTRACT.split()) <= set(NAMED) <= set(CONTRACT.split()) | set(built_in())
    assert len(OUTSIDE) >= 5
    assert not set(OUTSIDE) & (set(NAMED) | set(built_in()))


@pytest.mark.parametrize("name", [*NAMED, *OUTSIDE])
def test_sizes_grow_and_fields_are_the_rigs(name):
    makers = NAMED | OUTSIDE
    fields = set(Rig._fields) | {"clock_drift"}
    for size in SIZES:
        for seed in range(5):
            hidden = makers[name](Draw(size, np.random.default_rng(seed)))
            assert (hidden.name, hidden.size) == (name, size)
            assert set(hidden.fields) <= fields
            assert hidden.site in {"valve", "flow", "force", "sensor"}


@pytest.mark.parametrize("name", NAMED)
def test_quantities_are_parameters_of_the_catalogues_effect(name):
    """What the board compares must be called so there."""
    if name not in built_in():
        pytest.skip(f"the catalogue has no {name}")
    for seed in range(8):
        for quantity in NAMED[name](Draw("medium", np.random.default_rng(seed))).quantities:
            assert quantity in {q.name for q in built_in()[name].parameters}
    hidden = NAMED[name](Draw("medium", np.random.default_rng(0)))
    assert built_in()[name].site in {hidden.site, *hidden.also}


def test_a_size_lies_in_its_third():
    rng = np.random.default_rng(0)
    for third, size in enumerate(SIZES):
        values = [Draw(size, rng).sized(1.0, 1000.0) for _ in range(50)]
        assert 10.0**third <= min(values) <= max(values) <= 10.0 ** (third + 1)


def test_a_draw_repeats_and_has_its_shares():
    cases = compose(3, 100)
    assert cases == compose(3, 100)
    assert cases != compose(4, 100)
    assert Counter(c.kind for c in cases) == {"nothing": 20, "single": 50, "pair": 18, "outside": 12}
    singles = Counter(c.hidden[0].name for c in cases if c.kind == "single")
    assert len(singles) == len(NAMED)
    assert max(singles.values()) <= 2
    assert sum(c.with_pressures for c in cases) == 50
    assert [c.name for c in cases] == sorted(c.name for c in cases)


def test_a_draw_of_some_kinds_holds_no_other():
    assert {c.kind for c in compose(3, 20, ["pair"])} == {"pair"}


def test_pairs_never_set_the_same_thing_twice():
    for c in compose(3, 60, ["pair"]):
        one, other = c.hidden
        assert not set(one.fields) & set(other.fields)


def test_a_case_is_stated_and_read_back():
    for c in compose(3, 40):
        assert case_from(json.loads(json.dumps(c.stated()))) == c


@pytest.mark.parametrize("style", STYLES)
@pytest.mark.parametrize("name", STYLES["calm"])
def test_references_keep_to_their_reach(style, name):
    for seed in range(5):
        path = STYLES[style][name](8.0, 1e-3, np.random.default_rng(seed), 0.1)
        assert path.shape == (8000,)
        assert 0.03 < np.abs(path).max() <= 0.1 + 1e-12


def test_triangles_go_at_one_speed():
    speed = np.abs(np.diff(STYLES["calm"]["ramps"](8.0, 1e-3, np.random.default_rng(2), 0.1))) / 1e-3
    assert np.mean(np.isclose(speed, np.median(speed))) > 0.98
    assert 0.03 <= np.median(speed) <= 0.09


def test_the_seal_opens_with_its_key_only(tmp_path):
    path = tmp_path / "answers.sealed"
    key, digest = seal({"secret": 1}, path)
    assert b"secret" not in path.read_bytes()
    assert unseal(path, key, digest) == {"secret": 1}
    other, _ = seal({"secret": 2}, tmp_path / "other.sealed")
    with pytest.raises(SealError, match="does not open"):
        unseal(path, other, digest)
    with pytest.raises(SealError, match="committed"):
        unseal(path, key, "0" * 64)
    path.write_bytes(path.read_bytes()[:-8] + b"AAAAAAA=")
    with pytest.raises(SealError):
        unseal(path, key, digest)


@pytest.fixture(scope="module")
def stribeck():
    hidden = Hidden("stribeck_friction", "force", "large", {"stick_ratio": 1.5, "stribeck_speed": 0.02})
    return record(case(hidden), 2.0)


@pytest.mark.full
def test_a_refit_absorbs_what_a_parameter_can_do(stribeck):
    one = stribeck.case
    found = trace(stribeck, replace(one, base={**one.base, "viscous": 1.1 * one.base["viscous"]}))
    assert found.raw > 3.0
    assert found.absorbed > 0.99


def test_a_refit_cannot_absorb_sticking(stribeck):
    found = trace(stribeck, replace(stribeck.case, hidden=()))
    assert found.left > 100.0
    assert found.absorbed < 0.9
    assert found.rise > 0.5


def test_the_stribeck_effect_acts_where_it_is_slow(stribeck):
    run = stribeck.runs["steps"]
    when = acts_when(stribeck.case, run, stribeck.case.hidden[0])
    on = np.zeros(len(run.t), dtype=bool)
    for begin, end in when:
        on |= (run.t >= begin) & (run.t < end)
    assert 0.01 < on.mean() < 0.9
    assert np.quantile(np.abs(run.velocity[on]), 0.9) < np.quantile(
        np.abs(run.velocity[~run.stuck & ~on]), 0.5
    )


@pytest.mark.parametrize(
    ("found", "active", "tracking", "sensors", "ways"),
    [
        (Trace(500.0, 5.0, 0.99, 0.0), 1.0, 0.0, Sensors(), ["unseen"]),
        (Trace(500.0, 50.0, 0.5, 0.01), 1.0, 0.2, Sensors(), ["noise"]),
        (Trace(500.0, 100.0, 0.95, 0.2), 1.0, 0.2, Sensors(quantum=6e-5), ["refit", "quantised"]),
        (Trace(500.0, 400.0, 0.3, 3.0), 0.05, 0.01, Sensors(), ["loop", "seldom"]),
        (Trace(500.0, 400.0, 0.3, 3.0), 0.5, -0.3, Sensors(), ["open"]),
    ],
)
def test_what_conceals_an_effect(found, active, tracking, sensors, ways):
    assert hidden_by(case(sensors=sensors), found, active, tracking) == ways


def test_the_oracle_is_left_with_little_more_than_the_noise(stribeck):
    assert 0.9 < oracle_rmse(stribeck) / 0.03e-3 < 1.5


@pytest.mark.parametrize("with_pressures", [False, True])
def test_the_oracle_knows_the_pressures_of_an_axis_at_rest_only_where_they_are_measured(with_pressures):
    """What else is known of them is off by a sd here and there, and a position that stays tells nothing against it."""
    resting = case(with_pressures=with_pressures)
    run = simulate(resting.rig, np.zeros(1200), np.random.default_rng(1), sensors=resting.sensors)
    assert run.stuck[100:].all()
    held = Recorded(resting, {"mixed": run}, {"mixed": recording(run, np.random.default_rng(2))})
    known = np.array([0.0, 0.0, 0.4, -0.2])  # less than moves it
    (start,) = _estimated(resting, run, _measured(held), 100, 1100, known[None])
    off = (start - run.states[100])[[PA, PB]] / PRIOR[PA]
    assert off == pytest.approx([0.0, 0.0] if with_pressures else known[2:], abs=0.01)


@pytest.mark.parametrize("drift", [-2e-3, 2e-3])
def test_the_oracle_reads_by_the_sensors_clock(drift):
    """By the command's clock alone it is 4 ms off in the end: a tenth of a millimetre and more."""
    drifting = case(Hidden("clock_drift", "sensor", "large", {"clock_drift": drift}))
    assert 0.9 < oracle_rmse(record(drifting, 2.0)) / 0.03e-3 < 1.5


def test_a_drifting_clock_leaves_a_trace_and_acts_all_the_time():
    """2 ms in a second, beyond what a constant skew makes up for, shows in 2 s of lively motion."""
    drifting = record(case(Hidden("clock_drift", "sensor", "large", {"clock_drift": 2e-3})), 2.0)
    (found,) = traces(drifting)[1]
    assert found.left > 10.0
    assert acts_when(drifting.case, drifting.runs["steps"], drifting.case.hidden[0]) == [(0.0, 1.999)]
    still = record(case(Hidden("clock_drift", "sensor", "large", {"clock_drift": 0.0})), 2.0)
    assert traces(still)[1][0].raw < 1e-6


def test_overlaps():
    assert interval_overlap((0.0, 2.0), (1.0, 3.0)) == pytest.approx(1 / 3)
    assert interval_overlap((0.0, 1.0), (2.0, 3.0)) == 0.0
    true = {"steps": [(1.0, 2.0)], "ramps": [(0.0, 8.0)]}
    assert time_overlap([("any/steps.csv", 1.0, 3.0)], true) == pytest.approx((0.5, 0.125))
    assert time_overlap([], true) is None


def finding(effect, site="force", **other):
    return {"effect": effect, "site": site, "parameters": {}, "indistinguishable_from": [], **other}


def answered(*hidden, kind="single"):
    parts = [{"hidden_by": ["open"], "intervals": {"steps": [(0.0, 1.0)]}} for _ in hidden]
    return {"kind": kind, "case": case(*hidden, kind=kind).stated(), "parts": parts}


def said(verdict, *findings):
    holdout = {"position": {"rmse": 4e-5}}
    parameters = {"viscous_friction": {"value": 71.0, "ci95": [69.0, 73.0]}}
    part = {"parameters": parameters, "holdout": holdout}
    diagnosis = {"verdict": verdict, "findings": list(findings), "baseline": part, "improved": part}
    return CaseOutcome(diagnosis, 0, 10.0, 3e-5, frozenset({frozenset(("valve_lag", "input_delay"))}))


OFFSET = Hidden("valve_offset", "valve", "large", {"valve_offset": 0.02}, {"offset": 0.02})
DELAY = Hidden("input_delay", "valve", "small", {"delay": 2e-3}, {"delay": 2e-3})
CREEP = Hidden("tube_creep", "flow", "large", {"creep": 1e-10})


def test_a_right_name_with_its_parameter():
    given = finding(
        "valve_offset", "valve", parameters={"offset": {"value": 0.021, "ci95": [0.0205, 0.0215]}}
    )
    judged = judge(answered(OFFSET), said("missing-physics", given))
    assert judged.first_right and judged.exact and judged.site_right
    assert judged.called == "valve_offset"
    (estimate,) = judged.estimates
    assert estimate.error == pytest.approx(0.05)
    assert estimate.held is False
    assert judged.base[0].held is True
    assert (judged.after, judged.oracle) == (4e-5, 3e-5)


def test_a_wrong_name_and_one_too_many():
    wrong = judge(answered(OFFSET), said("missing-physics", finding("cross_leakage", "flow")))
    assert not (wrong.first_right or wrong.in_set or wrong.exact or wrong.site_right)
    more = judge(
        answered(OFFSET),
        said("missing-physics", finding("valve_offset", "valve"), finding("valve_lag", "valve")),
    )
    assert more.first_right
    assert not more.exact


def test_a_look_alike_counts_only_if_proven_and_reported():
    lag = finding("valve_lag", "valve", indistinguishable_from=["input_delay"])
    alike = judge(answered(DELAY), said("missing-physics", lag))
    assert alike.in_set and alike.whole
    assert not (alike.first_right or alike.exact)
    assert not judge(answered(DELAY), said("missing-physics", finding("valve_lag", "valve"))).in_set
    unproven = finding("valve_lag", "valve", indistinguishable_from=["valve_offset"])
    assert not judge(answered(OFFSET), said("missing-physics", unproven)).in_set


def test_both_of_a_pair_are_needed():
    pair = answered(OFFSET, DELAY, kind="pair")
    both = said("missing-physics", finding("input_delay", "valve"), finding("valve_offset", "valve"))
    assert judge(pair, both).exact and judge(pair, both).whole
    one = judge(pair, said("missing-physics", finding("input_delay", "valve")))
    assert not (one.exact or one.whole)
    lag = finding("valve_lag", "valve", indistinguishable_from=["input_delay"])
    alike = judge(pair, said("missing-physics", lag, finding("valve_offset", "valve")))
    assert alike.whole and not alike.exact
    twice = judge(pair, said("missing-physics", lag, finding("input_delay", "valve")))
    assert not twice.whole
    lagging = Hidden("valve_lag", "valve", "small", {"valve_time": 2e-3})
    given = said("missing-physics", lag, finding("input_delay", "valve"))
    assert judge(answered(lagging, DELAY, kind="pair"), given).whole


def test_outside_the_list_a_name_is_wrong_and_silence_too():
    outside = answered(CREEP, kind="outside")
    abstained = judge(outside, said("unexplained", finding(None, "flow")))
    named = judge(outside, said("missing-physics", finding("cross_leakage", "flow")))
    silent = judge(outside, said("consistent"))
    rates = [{r["figure"]: r for r in board([c])["rates"]} for c in (abstained, named, silent)]
    assert [r["outside the list: unexplained, right site"]["hits"] for r in rates] == [1, 0, 0]
    assert [r["... given a name"]["hits"] for r in rates] == [0, 1, 0]


def test_nothing_missing():
    nothing = answered(kind="nothing")
    quiet, alarm = (
        judge(nothing, said("consistent")),
        judge(nothing, said("missing-physics", finding("valve_lag"))),
    )
    rates = [{r["figure"]: r for r in board([c])["rates"]} for c in (quiet, alarm)]
    assert [r["nothing missing, nothing named"]["hits"] for r in rates] == [1, 0]
    crashed = judge(nothing, CaseOutcome(None, 1, 1.0))
    late = judge(nothing, CaseOutcome(None, None, 1.0))
    assert (crashed.called, late.called) == ("failed", "late")
    assert board([crashed])["rates"][9]["hits"] == 0


def test_an_effect_that_leaves_no_trace_is_asked_of_nobody():
    unseen = answered(OFFSET)
    unseen["parts"][0]["hidden_by"] = ["unseen"]
    judged = judge(unseen, said("consistent"))
    assert judged.true == ()
    assert all(not r["trials"] for r in board([judged])["rates"][:4])


def test_intervals_of_clopper_and_pearson():
    # 0 of 300: 1 - 0.025^(1/300); 95 of 100: the tables of Clopper and Pearson give 0.8872 to 0.9836.
    assert Rate("", 0, 300).interval == pytest.approx((0.0, 1 - 0.025 ** (1 / 300)))
    assert Rate("", 95, 100).interval == pytest.approx((0.8872, 0.9836), abs=1e-4)
    assert Rate("", 20, 20).interval[1] == 1.0


def test_the_studies_readme_shows_the_boards_as_they_are(capsys, monkeypatch):
    root = Path(concealed.__file__).parents[1]
    readme = (root / "studies" / "README.md").read_text()
    shown = re.search(r"\| figure \| asked \|(.*)\|\n", readme).group(1)
    files = [
        root / "studies" / ("concealed.json" if name == "concealed" else f"concealed_{name}.json")
        for name in (word.strip() for word in shown.split("|"))
    ]
    monkeypatch.setattr("sys.argv", ["concealed.py", "table", *map(str, files)])
    concealed.main()
    table = capsys.readouterr().out
    assert table in readme
    assert len(table.splitlines()) == 13


SCRIPT = """
import json, sys, time
from pathlib import Path
rig, *rest = sys.argv[1:]
out = Path(rest[rest.index("--out") + 1])
if "case-2" in rig: time.sleep(60)
if "case-3" in rig: sys.exit("no")
out.mkdir()
(out / "diagnosis.json").write_text(json.dumps({"called with": len(rest)}))
"""


def test_running_keeps_its_limits_and_goes_on_where_it_stopped(tmp_path, monkeypatch):
    script = tmp_path / "method.py"
    script.write_text(SCRIPT)
    monkeypatch.setitem(running.METHODS, "diagnose", (str(script),))
    names = ["case-1", "case-2", "case-3"]
    (tmp_path / "cases.json").write_text(json.dumps({"cases": names}))
    for name in names:
        (tmp_path / name).mkdir()
    told = []
    running.run(tmp_path, "diagnose", 3.0, 3, lambda name, ran: told.append((name, ran.status)))
    assert sorted(told) == [("case-1", 0), ("case-2", None), ("case-3", 1)]
    assert json.loads((tmp_path / "case-1/diagnose/diagnosis.json").read_text()) == {"called with": 7}
    assert scoring.outcome(tmp_path / "case-2/diagnose", None, frozenset()).diagnosis is None
    stopped = tmp_path / "case-3/diagnose/run.json"
    stopped.write_text(json.dumps({**json.loads(stopped.read_text()), "status": -15}))  # someone ended it
    told.clear()
    running.run(tmp_path, "diagnose", 3.0, 3, lambda name, ran: told.append((name, ran.status)))
    assert told == [("case-3", 1)]


def test_from_draw_to_board(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "trial"
    key = draw(folder, Order(11, 2, ["nothing"], seconds=1.5), 1)
    everything = b"".join(p.read_bytes() for p in folder.rglob("*") if p.is_file())
    assert key.encode() not in everything
    assert sorted(p.name for p in (folder / "case-001").iterdir()) == [
        "mixed.csv",
        "multisine.csv",
        "ramps.csv",
        "rig.toml",
        "steps.csv",
    ]
    for name in ("case-001", "case-002"):
        place = folder / name / "diagnose"
        place.mkdir()
        diagnosis = said("consistent").diagnosis
        (place / "diagnosis.json").write_text(json.dumps(diagnosis))
        (place / "run.json").write_text(json.dumps({"status": 0, "seconds": 3.0}))
    concealed.key_file(folder).write_text(key)
    monkeypatch.setattr(sys, "argv", ["concealed.py", "score", str(folder), "--jobs", "1"])
    concealed.main()
    shown = capsys.readouterr().out
    assert "nothing missing, nothing named" in shown
    assert "100.0 %  2/2" in shown
    assert text(json.loads((folder / "scores/diagnose.json").read_text())) in shown
    page = tmp_path / "concealed.html"
    monkeypatch.setattr(sys, "argv", ["concealed.py", "page", str(folder), "--out", str(page)])
    concealed.main()
    html = page.read_text()
    assert json.loads((folder / "cases.json").read_text())["answers_sha256"] in html
    assert html.count("<svg") >= 3
    assert "1 of 1 figures that were asked for are reached" in html


def test_a_draw_goes_in_parts(tmp_path):
    whole, parts = Order(11, 3, ["nothing"]), [Order(11, 3, ["nothing"], part=p) for p in ((1, 1), (2, 3))]
    assert [c for part in parts for c in part.cases()] == whole.cases()
    board, texts = None, []
    for number, (part, rmse) in enumerate(zip(parts, (6e-5, 4e-5), strict=True)):
        folder = tmp_path / str(number)
        key = draw(folder, replace(part, seconds=1.5), 1)
        for one in part.cases():
            place = folder / one.name / "diagnose"
            place.mkdir()
            diagnosis = said("consistent").diagnosis
            diagnosis["baseline"]["holdout"]["position"]["rmse"] = rmse
            (place / "diagnosis.json").write_text(json.dumps({**diagnosis, "improved": None}))
            (place / "run.json").write_text(json.dumps({"status": 0, "seconds": 3.0}))
        texts.append(score(folder, key, "diagnose", 1, board))
        board = folder / "scores/diagnose.json"
    result = json.loads(board.read_text())
    assert ["1/1" in texts[0], "3/3" in texts[1]] == [True, True]
    assert [c["after"] for c in result["every"]] == [6e-5, 4e-5, 4e-5]
    digests = [json.loads((tmp_path / n / "cases.json").read_text())["answers_sha256"] for n in "01"]
    assert result["commitments"] == digests
    with pytest.raises(ValueError, match="case-002, case-003 already"):
        score(tmp_path / "1", key, "diagnose", 1, board)


def test_base_intervals_are_not_asked_where_no_effect_could_stand_for_what_is_missing():
    outside = judge(answered(CREEP, kind="outside"), said("unexplained", finding(None, "flow")))
    single = judge(answered(OFFSET), said("missing-physics", finding("valve_offset", "valve")))
    assert outside.exact and single.exact
    counted = {one.figure: one.trials for one in rates([outside, single])}
    assert counted["... the base parameters, effects named exactly"] == len(single.base)


def test_what_right_names_leave_is_counted_beyond_the_oracle():
    given = said("missing-physics", finding("valve_offset", "valve"))
    right = replace(judge(answered(OFFSET), given), before=5e-4)  # then 4e-5 m, where the true model has 3e-5
    assert right.left == pytest.approx((4e-5**2 - 3e-5**2) / (5e-4**2 - 3e-5**2))
    assert replace(right, after=3.5e-5).left == 0.0  # good to the noise
    assert replace(right, oracle=None).left is None


def test_right_names_that_were_refused_count_with_what_they_leave():
    def refused(*effects):
        diagnosis = {
            **said("unexplained", finding(None, "valve")).diagnosis,
            "closest": {"effects": effects, "cleared": 0.8},
        }
        return judge(answered(OFFSET), CaseOutcome(diagnosis, 0, 1.0))

    right = refused("valve_offset")
    assert right.left == right.refused == pytest.approx(0.2)
    assert refused("valve_lag").refused is None
    table = spreads([replace(right, before=None)] * 19)
    assert table["right names leave of the squared error"]["in 19 of 20"] == pytest.approx(0.2)


def test_the_share_that_19_of_20_stay_below():
    values = np.arange(1.0, 40.0)  # 39 values: of 40 with the next one two may lie above the 38th
    assert conformal(values) == 38.0
    drawn = np.random.default_rng(0).random((4000, 40))
    assert np.mean([row[-1] <= conformal(row[:-1]) for row in drawn]) == pytest.approx(0.95, abs=0.01)


def test_a_leak_is_compared_by_its_effective_area():
    leak = Hidden("cross_leakage", "flow", "large", {"leak_cross": 1e-7}, {"area": 1e-7})
    area = {"area": {"value": 7.4e-8, "ci95": [7.3e-8, 7.6e-8]}}
    (estimate,) = judge(
        answered(leak), said("missing-physics", finding("cross_leakage", "flow", parameters=area))
    ).estimates
    assert estimate.truth == pytest.approx(1e-7 * BASE["discharge"])
    assert estimate.held is True
