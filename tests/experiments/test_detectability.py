"""Detectability: how sizes follow noise and length, and where rivals stand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from optid.cli import cli
from optid.effects.library import admitted
from optid.experiments.detectability import detectability
from optid.experiments.separation import NEEDED
from tests.diagnosis.trolley import SD, TRUTH, recording, rig


@pytest.fixture
def true_rig(tmp_path):
    found = rig(tmp_path)
    return replace(found, parameters={**found.parameters, **TRUTH})


def by_name(rig_, recordings):
    return {one.effect: one for one in detectability(rig_, recordings, admitted(rig_.model))}


def test_less_noise_and_more_data_show_more(true_rig):
    once = [recording(1, "a.csv")]
    channels = {**true_rig.channels, "position": replace(true_rig.channels["position"], sd=SD / 2)}
    quiet = replace(true_rig, channels=channels)
    plain, less, more = (
        by_name(true_rig, once),
        by_name(quiet, once),
        by_name(true_rig, [*once, recording(2, "b.csv")]),
    )
    assert plain
    for name, one in plain.items():
        if 0.1 < one.separation < 1e3:
            # Not twice: a filter that believes its sensor more lets less of an effect stand in its innovations.
            assert one.separation < less[name].separation < 2.02 * one.separation, name
            assert more[name].separation > one.separation, name
        assert one.apart <= one.separation * (1.0 + 1e-9)


def test_sizes_are_worth_a_name_and_in_proportion(true_rig):
    effects = {one.name: one for one in admitted(true_rig.model)}
    for name, one in by_name(true_rig, [recording(1, "a.csv")]).items():
        if one.shows_from:
            size = effects[name].size({**effects[name].at_null(), **one.shows_from})
            assert size == pytest.approx(max(NEEDED / one.separation, 1.0), rel=1e-6), name
            assert np.isfinite(list(one.told_from.values())).all()


def test_the_command_tells_and_writes_it(true_rig, tmp_path):
    file = tmp_path / "a.csv"
    one = recording(1, "a.csv")
    columns = (one.time, one["command"].values, one["position"].values)
    np.savetxt(file, np.c_[columns], delimiter=",", header="t,u,x", comments="")
    out = tmp_path / "out"
    ran = CliRunner().invoke(
        cli, ["check", str(tmp_path / "trolley.toml"), str(file), "--detectability", "--out", str(out)]
    )
    assert ran.exit_code == 0, ran.output
    assert "smallest detectable sizes" in ran.output
    told = json.loads((out / "check.json").read_text())["detectability"]
    assert [one["separation"] for one in told] == sorted((one["separation"] for one in told), reverse=True)
    assert "What these recordings could show" in (out / "report.html").read_text()
