"""`fleet.toml`: rows as stated, from tables and from patterns; what is wrong is named."""

import pandas as pd
import pytest

from optid.errors import InputError
from optid.fleet.fleetfile import read_fleet


def written(tmp_path, text):
    file = tmp_path / "fleet.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_rows_take_what_they_do_not_state_from_the_defaults(tmp_path):
    fleet = read_fleet(
        written(
            tmp_path,
            """
            [defaults]
            job = "fit"
            time_limit = 100
            memory = "1.5 GB"
            options = { starts = 3 }
            [[rows]]
            rig = "rigs/a.toml"
            train = ["a1.csv", "a2.csv"]
            holdout = ["a3.csv"]
            tags = { line = "3" }
            [[rows]]
            rig = "rigs/b.toml"
            train = ["b1.csv"]
            job = "diagnose"
            threads = 2
            """,
        )
    )
    one, two = fleet.jobs
    assert (one.name, one.command, one.tags) == ("a", "fit", {"line": "3", "rig": "a"})
    assert one.train == (str(tmp_path / "a1.csv"), str(tmp_path / "a2.csv"))
    assert (one.limits.memory, one.limits.time_limit, one.limits.deadline) == (1_500_000_000, 100, 460.0)
    assert (two.command, two.limits.threads) == ("diagnose", 2)
    words = one.arguments(tmp_path / "out")
    assert words[:4] == ["fit", one.rig, *one.train]
    assert words[words.index("--holdout") + 1] == one.holdout[0]
    assert "--starts=3" in words


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_rows_of_a_table(tmp_path, suffix):
    frame = pd.DataFrame(
        {
            "rig": ["a.toml", "b.toml"],
            "train": ["1.csv; 2.csv", "3.csv"],
            "holdout": ["4.csv", ""],
            "line": ["x", "y"],
        }
    )
    file = tmp_path / f"rows.{suffix}"
    frame.to_csv(file, index=False) if suffix == "csv" else frame.to_parquet(file)
    jobs = read_fleet(written(tmp_path, f'[table]\nfile = "rows.{suffix}"\n')).jobs
    assert [len(job.train) for job in jobs] == [2, 1]
    assert [len(job.holdout) for job in jobs] == [1, 0]
    assert [job.tags["line"] for job in jobs] == ["x", "y"]


def test_rows_of_a_pattern(tmp_path):
    for name in (
        "r1/2026-10-01_a.csv",
        "r1/2026-10-01_b.csv",
        "r1/2026-10-02_a.csv",
        "r2/2026-10-01_a.csv",
        "r2/x.txt",
    ):
        (tmp_path / "data" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "data" / name).touch()
    jobs = read_fleet(
        written(tmp_path, '[glob]\nrecordings = "data/{rig}/{date}_*.csv"\nrig = "rigs/{rig}.toml"\n')
    ).jobs
    assert {job.name: len(job.train) for job in jobs} == {
        "r1-2026-10-01": 2,
        "r1-2026-10-02": 1,
        "r2-2026-10-01": 1,
    }
    assert jobs[0].rig == str(tmp_path / "rigs" / "r1.toml")


def test_rows_of_one_name_are_told_apart_by_what_they_do(tmp_path):
    row = '[[rows]]\nrig = "a.toml"\ntrain = ["{}.csv"]\n'
    one, two = read_fleet(written(tmp_path, row.format("x") + row.format("y"))).jobs
    assert one.name != two.name
    (again,) = (
        job
        for job in read_fleet(written(tmp_path, row.format("y") + row.format("x"))).jobs
        if "y.csv" in job.train[0]
    )
    assert again.name == two.name  # their order does not matter
    with pytest.raises(InputError, match="two rows are the same"):
        read_fleet(written(tmp_path, row.format("x") + row.format("x")))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no rows"),
        ("x = 1", 'unknown key "x"'),
        ("[[rows]]\ntrain = ['a.csv']", "rig: missing"),
        ("[[rows]]\nrig = 'a.toml'", "train"),
        ("[[rows]]\nrig = 'a.toml'\ntrain = 'a.csv'", "a list of paths"),
        ("[defaults]\njob = 'chek'\n[[rows]]\nrig = 'a.toml'\ntrain = ['a.csv']", 'did you mean "check"'),
        ("[[rows]]\nrig = 'a.toml'\ntrain = ['a.csv']\nmemory = '2 apples'", "memory"),
        ("[[rows]]\nrig = 'a.toml'\ntrain = ['a.csv']\nthreads = 0", "threads"),
        ("[nightly]\nreference = 2\n[[rows]]\nrig = 'a.toml'\ntrain = ['a.csv']", "at least 3 nights"),
        ("[nightly]\n[[rows]]\nrig = 'a.toml'\ntrain = ['a.csv']", "no date"),
        ("[glob]\nrecordings = 'data/{date}.csv'\nrig = '{rig}.toml'", "{rig}"),
        ("[table]\nfile = 'none.csv'", "no such file"),
        ("[statistics]\nlevel = 2.0\n[[rows]]\nrig = 'a.toml'\ntrain = ['a.csv']", "between 0 and 1"),
        ("not toml", "cannot be read"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, said):
    with pytest.raises(InputError) as caught:
        read_fleet(written(tmp_path, text))
    assert said in str(caught.value)
    assert "fleet.toml" in str(caught.value) or "same" in str(caught.value)
