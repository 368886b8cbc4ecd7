"""What leaves parts of the search out: what a part that did nothing costs, and how differences are told."""

import json

import pytest

from optid.diagnosis import pipeline
from studies import ablation


def test_a_part_that_did_nothing_is_not_left_out_by_another_run(tmp_path, monkeypatch):
    """Of three parts in two cases, one acts in the first: only that one and an option of the search run again."""
    (tmp_path / "cases.json").write_text(json.dumps({"cases": ["one", "two"]}))
    ran = []

    def diagnosed(case, name, limit):
        ran.append((case.name, name))
        idle = {"bounds": 3.0, "restart": 0.0} if case.name == "one" else {"bounds": 1.0, "restart": 2.0}
        right = name == ablation.AS_IS or case.name == "two"
        return ablation.Row(
            case.name,
            name,
            "single",
            ("stribeck_friction",),
            (),
            "missing-physics",
            right,
            False,
            1.0,
            10.0,
            idle if name == ablation.AS_IS else {},
        )

    monkeypatch.setattr(ablation, "diagnosed", diagnosed)
    names = ["bounds", "restart", "alternatives", "steps"]
    ablation.run(tmp_path, names, 2, 1.0, lambda words: None)
    every = [(case, name) for case in ("one", "two") for name in (ablation.AS_IS, "alternatives", "steps")]
    assert ran == every
    rows = {(row["case"], row["variant"]): row for row in ablation.rows_of(tmp_path)}
    assert rows["one", "bounds"]["seconds"] == 7.0 and rows["one", "bounds"]["right"]
    assert rows["two", "restart"]["seconds"] == 8.0
    ran.clear()
    ablation.run(tmp_path, names, 2, 1.0, lambda words: None)
    assert ran == []
    lines = {line.split(" | ")[0]: line for line in ablation.table(tmp_path).splitlines()}
    assert "| 2 | 1 | 1 | 0 | +50 %" in lines[f"| {ablation.VARIANTS['steps'].words}"]
    assert "| 2 | 2 | 0 | 0 | +0 %" in lines[f"| {ablation.VARIANTS['bounds'].words}"]


def test_what_a_part_returned_tells_whether_it_acted(monkeypatch):
    monkeypatch.setattr(pipeline, "relax_bounds", lambda base, problem: None if base == "sound" else "wide")
    idle = {}
    with ablation.recorded(idle):
        assert pipeline.relax_bounds("sound", None) is None
    assert idle["bounds"] >= 0.0
    with ablation.recorded(idle):
        assert pipeline.relax_bounds("shut", None) == "wide"
    assert "bounds" not in idle and "restart" in idle


@pytest.mark.parametrize("counts", [(27, 0, 0, 3), (20, 5, 1, 4), (0, 3, 3, 24)])
def test_the_interval_of_a_difference_holds_it(counts):
    gain, low, high = ablation.difference(*counts)
    _, lost, won, _ = counts
    assert gain == pytest.approx((lost - won) / sum(counts))
    assert -1.0 <= low <= gain <= high <= 1.0 and high > low
