"""The statistics of a fleet: error rates by simulation, and known answers."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from optid.fleet.statistics.changes import changes
from optid.fleet.statistics.moderated import moderated
from optid.fleet.statistics.siblings import levels, pooled, shrunken, unlike, variance_among
from optid.fleet.statistics.trends import change_point, trends
from optid.fleet.statistics.wander import wander, weights

REFERENCE, LEVEL = 5, 0.05


def fleet(rng, rigs=40, nights=20, quantities=6, drift=None):
    """Nights of rigs whose spread differs, as a table; `drift` adds to some: (rig, quantity) -> (night, sd a night)."""
    rows = []
    for r in range(rigs):
        spread = np.sqrt(stats.invgamma.rvs(5.0, scale=4.0, random_state=rng))
        for q in range(quantities):
            values = rng.normal(10.0 * q + r, spread, nights)
            if drift and (r, q) in drift:
                first, slope = drift[r, q]
                values += spread * slope * np.clip(np.arange(nights) - first + 1, 0, None)
            rows += [(f"r{r:03}", f"2026-10-{n + 1:02}", f"q{q}", v, spread) for n, v in enumerate(values)]
    return pd.DataFrame(rows, columns=["rig", "date", "quantity", "value", "sd"])


def test_a_fleet_that_does_not_change_is_seldom_told_of():
    rng = np.random.default_rng(1)
    some = [len(changes(fleet(rng, nights=12), REFERENCE, 0.2).told) > 0 for _ in range(6)]
    assert sum(some) <= stats.binom.ppf(0.999, 6, 0.2)


def test_p_values_of_nights_hold():
    rng = np.random.default_rng(2)
    nights = pd.concat([changes(fleet(rng, nights=7), REFERENCE, LEVEL).nights for _ in range(4)])
    first = nights.groupby("rig").head(1)  # one look, so Bonferroni over quantities alone
    assert (
        stats.binomtest(int((first["p"] < 0.1).sum()), len(first), 0.1, alternative="greater").pvalue > 1e-3
    )
    assert (first["p"] < 0.5).mean() > 0.05  # and are no idle bound


def test_drifts_are_told_with_their_quantity():
    rng = np.random.default_rng(3)
    drift = {(r, r % 3): (8, 2.0) for r in range(5)}
    found = changes(fleet(rng, drift=drift), REFERENCE, LEVEL)
    told = found.told.set_index("rig")
    assert set(told.index) == {f"r{r:03}" for r in range(5)}
    assert all(told.loc[f"r{r:03}", "quantity"] == f"q{r % 3}" for r in range(5))
    assert told["date"].between("2026-10-08", "2026-10-14").all()
    assert (told["shift"] > 0).all()


def test_who_was_told_stays_told_and_silent_rigs_count():
    rng = np.random.default_rng(4)
    table = fleet(rng, rigs=30, drift={(0, 0): (8, 2.0)})
    nights = changes(table, REFERENCE, LEVEL).nights
    assert (nights.groupby("rig")["p_rig"].diff().dropna() <= 1e-15).all()
    few = table[table["rig"].isin(["r000", "r001"])]
    q = changes(few, REFERENCE, LEVEL).nights
    at = ("r000", "2026-10-09")
    more = nights.set_index(["rig", "date"]).loc[at, "q"]
    assert more >= q.set_index(["rig", "date"]).loc[at, "q"]


def test_nothing_is_told_before_there_are_nights_to_compare():
    found = changes(fleet(np.random.default_rng(5), nights=REFERENCE), REFERENCE, LEVEL)
    assert found.nights.empty
    assert found.told.empty


def test_variances_are_drawn_together():
    rng = np.random.default_rng(6)
    true = 3.0 * stats.invgamma.rvs(6.0, scale=5.0, size=4000, random_state=rng)
    sample = true * rng.chisquare(4, 4000) / 4
    found = moderated(sample, np.full(4000, 4.0))
    assert 9.0 < found.prior_degrees < 12.0  # twice the shape, at most
    assert np.mean((found.variance - true) ** 2) < 0.5 * np.mean((sample - true) ** 2)
    same = moderated(2.0 * rng.chisquare(4, 4000) / 4, np.full(4000, 4.0))
    assert same.prior_degrees > 30.0
    assert same.common == pytest.approx(2.0, rel=0.05)


def test_one_bad_night_is_not_told():
    rng = np.random.default_rng(12)
    table = fleet(rng, rigs=30, nights=15)
    bad = (table["rig"] == "r003") & (table["date"] == "2026-10-11") & (table["quantity"] == "q2")
    table.loc[bad, "value"] += 1000.0 * table.loc[bad, "sd"]
    assert changes(table, REFERENCE, LEVEL).told.empty


def test_nights_count_by_their_own_intervals():
    rng = np.random.default_rng(13)
    sds = [np.exp(rng.normal(0.0, 1.0, 6)) for _ in range(300)]
    assert wander([rng.normal(0.0, sd) for sd in sds], sds) < 0.1
    more = wander([rng.normal(0.0, np.hypot(sd, 2.0)) for sd in sds], sds)
    assert more == pytest.approx(4.0, rel=0.25)
    assert weights(np.array([0.0, 1.0]), 4.0) == pytest.approx([0.25, 0.2])


def test_a_change_point_is_where_it_is():
    rng = np.random.default_rng(7)
    values = np.r_[rng.normal(0, 1, 20), rng.normal(3, 1, 15)]
    at, p = change_point(values)
    assert abs(at - 20) <= 1
    assert p < 1e-3
    ps = np.array([change_point(rng.normal(size=30))[1] for _ in range(400)])
    assert (ps < 0.05).mean() < 0.09


def test_a_trend_has_its_slope():
    dates = [str(d.date()) for d in pd.date_range("2026-10-01", periods=12, freq="2D")]
    rng = np.random.default_rng(8)
    tables = [
        pd.DataFrame(
            {
                "rig": f"r{k}",
                "date": dates,
                "quantity": "q",
                "value": 5.0 + 0.3 * 2.0 * np.arange(12) + rng.normal(0, 0.2, 12),
                "sd": 0.2,
            }
        )
        for k in range(60)
    ]
    found = trends(pd.concat(tables))
    assert ((found["low"] < 0.3) & (found["high"] > 0.3)).mean() > 0.88
    assert found["slope"].mean() == pytest.approx(0.3, abs=0.01)
    assert (found["p_change"] < 0.05).all()


def test_the_odd_one_out_is_told():
    rng = np.random.default_rng(9)
    table = fleet(rng, rigs=30, nights=5, quantities=1).assign(
        value=lambda t: t["value"] - t["rig"].str[1:].astype(int)
    )
    table.loc[table["rig"] == "r007", "value"] += 15.0
    found = unlike(levels(table, REFERENCE), LEVEL)
    assert found.loc[found["told"], "rig"].tolist() == ["r007"]


def test_pooling_gains_what_it_says():
    rng = np.random.default_rng(10)
    truth, v = rng.normal(4.0, 0.5, 300), np.full(300, 1.0)
    own = truth + rng.normal(0, 1.0, 300)
    assert variance_among(own, v) == pytest.approx(0.25, abs=0.15)
    drawn = shrunken(own, v)
    table = pd.DataFrame({"rig": range(300), "quantity": "q", "value": own, "variance": v, "count": 1})
    (told,) = pooled(table).to_dict("records")
    assert told["low"] < 4.0 < told["high"]
    gain = 1.0 - np.mean((drawn - truth) ** 2) / np.mean((own - truth) ** 2)
    assert gain == pytest.approx(told["gain"], abs=0.08)
    assert gain > 0.6
