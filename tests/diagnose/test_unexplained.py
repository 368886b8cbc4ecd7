"""A curve describes what no effect of the catalogue explains, and only where there is something to describe."""

import numpy as np
import pytest

from optid.diagnose.candidate import Data, fit_base
from optid.diagnose.disturbance import locate, locate_at
from optid.diagnose.unexplained import describe, nameless
from optid.rigs.rigfile import read_rig, write_rig
from tests.diagnose.trolley import SD, recording, rig


def wavy(u):
    return u + 0.2 * np.sin(3.0 * u)


def fitted(folder, concealed):
    train = [recording(seed, f"run_{seed}", concealed) for seed in (1, 2)]
    held = [recording(3, "held", concealed)]
    data = Data(tuple(train), tuple(held), {"position": SD}, np.random.default_rng(0))
    return fit_base(rig(folder), data, lambda share, words: None), data


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    base, data = fitted(tmp_path_factory.mktemp("wavy"), wavy)
    site = locate_at(base, data, "drive.command")  # the drag's force would do as well
    return base, data, site, describe(base, site, data, lambda words: None)


def test_the_curve_is_the_law(described):
    base, _, _, rival = described
    assert rival.effect.name == "curve@drive.command@command"
    before, after = (one.judged.scores["position"].rmse for one in (base, rival.candidate))
    assert after < 0.2 * before
    model, p = rival.candidate.rig.model, rival.candidate.answer.p
    u = np.linspace(-0.9, 0.9, 19)
    # velocity at rest: what pushes is the gain times the command with the curve
    rates = np.array([float(model.rates([0.0, 0.0], [one], p)[1]) for one in u])
    assert rates == pytest.approx(3.0 * wavy(u), abs=0.05)


def test_a_finding_tells_of_it_and_stays_without_a_name(described):
    base, data, site, rival = described
    finding = nameless(base, [site], rival, data)
    assert finding.effect is None and finding.evidence is rival.against
    assert "a curve over command describes it, without a name" in finding.sentence
    assert finding.shown[0] == "command"
    # the law's picture is the curve itself, up to what the fitted gain has taken of it
    u = rival.candidate.answer.question.problem.inputs[:, 0]
    slope, level = np.polyfit(u, finding.law - 0.2 * np.sin(3.0 * u), 1)
    assert finding.law == pytest.approx(0.2 * np.sin(3.0 * u) + slope * u + level, abs=0.03)


def test_the_rig_file_holds_it(described, tmp_path):
    found = described[3].candidate
    values = dict(zip((q.name for q in found.rig.model.parameters), found.answer.p.tolist(), strict=True))
    write_rig(found.rig, tmp_path / "rig.toml", values)
    again = read_rig(tmp_path / "rig.toml")
    assert again.model.vector(again.parameters) == pytest.approx(found.answer.p, rel=1e-11)


def test_nothing_is_drawn_where_nothing_is_missing(tmp_path):
    base, data = fitted(tmp_path, lambda u: u)
    assert all(describe(base, one, data, lambda words: None) is None for one in locate(base, data))
