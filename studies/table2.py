"""Table 2 of the paper on recordings of today, beside what the paper prints and an audit of its models.

    python studies/table2.py [--out DIR] [--quick]

Runs on the paper's impulse experiment (the rig of `independent_rig`, valve command in pulses), on the
example rigs and on the EMPS benchmark where these recordings lie beside the checkout. Every estimator makes a table of
its own, `table2_NAME_ESTIMATOR.csv` with every column's formula: offline prediction errors (pem), recursive maximum
likelihood (rml), and recursive least squares as the paper has it (rls). Their errors stand side by side with the print
in `table2_NAME.csv`. Printed besides: the choice of order, the audits, and which of the paper's claims stand on the
impulse experiment (`studies/paper_claims.py`). The printed table, restored, goes into `table2_printed.csv` with a
remark on every row that does not agree.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import scipy.io
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1]))
from optid.armax import Armax, from_transfer_function
from optid.armax.audit import Audit, audit
from optid.armax.loop import Gains
from optid.armax.plan import Estimator, Plan
from optid.armax.survey import Survey, survey
from studies.independent_rig import Rig, balanced, replay
from studies.independent_rig.loop import state
from studies.paper_claims import claims
from studies.physical_rows import physical_entries

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared"
PAPER_GAINS = Gains(kp=16.0, ki=6.0, kd=0.001)  # section 6, after Table 2; units and sample time not printed
PAPER_SAMPLE_TIME = 1e-3  # s, assumed: the paper names only its card's 250 kS/s
POSITION_NOISE = 3e-5  # m, of the example rigs
FULL_SCALE = 5.0  # V


@dataclass(frozen=True)
class Experiment:
    """A recording to tabulate: output y and input u with unit, name and sample time."""

    name: str
    y: Array
    u: Array
    sample_time: float
    unit: str


def main() -> None:
    """Write and print all tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("out/table2"))
    parser.add_argument("--quick", action="store_true", help="the impulse experiment only")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    pd.set_option("display.width", 200, "display.max_columns", 30, "display.max_rows", 200)
    pd.set_option("display.max_colwidth", 90, "display.precision", 4)
    for experiment in experiments(quick=arguments.quick):
        tables = {}
        for estimator in Estimator:
            plan = Plan(unit=experiment.unit, gains=PAPER_GAINS, estimator=estimator)
            found = survey(experiment.y, experiment.u, experiment.sample_time, plan)
            path = arguments.out / f"table2_{experiment.name}_{estimator.name.lower()}.csv"
            path.write_text(found.table2.csv(), encoding="utf-8")
            tables[estimator] = found
        beside = side_by_side(tables, experiment)
        beside.to_csv(arguments.out / f"table2_{experiment.name}.csv")
        print(f"\n{experiment.name}: {experiment.y.size} samples every {experiment.sample_time:g} s")
        print(beside.to_string())
        tell(tables[Estimator.PEM])
        if experiment.name == "impulse":
            print("\nThe paper's claims")
            for claim in claims(experiment.y, experiment.u, experiment.sample_time, tables[Estimator.PEM]):
                print(f"  {claim}")
    print("\nThe paper's Table 2 as printed (cm), and what does not agree")
    print(printed_table().drop(columns="remark").to_string())
    for remark in dict.fromkeys(filter(None, printed_table()["remark"])):
        print(f"  {remark}")
    printed_table().to_csv(arguments.out / "table2_printed.csv")
    for (order, steps), model in published().items():
        print(f"\nThe paper's model of order {order}, {steps} steps")
        say(audit(model, gains=PAPER_GAINS))


def side_by_side(tables: dict[Estimator, Survey], experiment: Experiment) -> pd.DataFrame:
    """Standard deviation of the errors by estimator, in sample and held out, beside the print's."""
    columns = {}
    for estimator, found in tables.items():
        frame = found.table2.frame()
        errors = frame[frame["signal"] == "error"]
        for part, rows in errors.groupby("part", sort=False):
            keys = pd.MultiIndex.from_frame(rows[["predictor", "order", "steps"]])
            columns[estimator.name.lower(), part] = pd.Series(rows["sd"].to_numpy(), index=keys)
    extra = (
        physical_entries(experiment.y, experiment.u, experiment.sample_time)
        if experiment.name == "impulse"
        else {}
    )
    for part, values in extra.items():
        keys = pd.MultiIndex.from_tuples(
            [("physical model", 0, k) for k in values], names=["predictor", "order", "steps"]
        )
        columns["physical", part] = pd.Series(list(values.values()), index=keys)
    table = pd.DataFrame(columns)
    printed = printed_table().xs("error", level="signal")["standard_deviation"]
    table["print (cm)", ""] = [
        printed.get((order, steps), math.nan) if predictor == "armax" else math.nan
        for predictor, order, steps in table.index
    ]
    return table


def tell(found: Survey) -> None:
    """Print a recording's choice of order and audits."""
    print(found.words)
    for candidate in found.candidates:
        print(f"\nOrder {candidate.order}: {candidate.model}")
        say(candidate.audit)


def say(found: Audit) -> None:
    """Print an audit's findings, grave ones marked."""
    for finding in found.findings:
        print(f"  {'!' if finding.grave else ' '} {finding.text}")


def experiments(*, quick: bool = False) -> Iterator[Experiment]:
    """The recordings there are; says which are absent."""
    yield impulse_experiment(np.random.default_rng(0))
    if quick:
        return
    for case in ("plain", "one_effect", "two_effects_with_pressures"):
        path = SHARED / "examples" / case / "mixed.csv"
        if not path.is_file():
            print(f"skipped: {path.name} of the example rig {case} does not lie beside the checkout")
            continue
        table = pd.read_csv(path)
        y, u = table["x"].to_numpy() / 10.0, table["u"].to_numpy()
        yield Experiment(f"example_{case}", y, u, 1e-3, "cm")
    path = SHARED / "recordings" / "emps" / "DATA_EMPS.mat"
    if not path.is_file():
        print("skipped: the EMPS recording does not lie beside the checkout")
        return
    emps = scipy.io.loadmat(path)
    y, u = (np.asarray(emps[name], dtype=float).ravel()[20:] for name in ("qm", "vir"))
    yield Experiment("emps", 100.0 * y, u, 1e-3, "cm")


def impulse_experiment(
    rng: np.random.Generator, seconds: float = 4.0, sample_time: float = 1e-3
) -> Experiment:
    """Valve pulses of 2 V and 40 ms in turn to both sides, which keep the piston off the ends; open loop."""
    n = round(seconds / sample_time)
    command = np.zeros(n)
    starts = np.arange(0.1, seconds - 0.2, 0.4)
    for k, start in enumerate(starts):
        first = round(start / sample_time)
        command[first : first + round(0.04 / sample_time)] = 2.0 if k % 2 == 0 else -2.0
    rig = Rig()
    _, position = replay(rig, command / FULL_SCALE, state(rig, balanced(rig)), 0, n, dt=sample_time)
    noisy = position + POSITION_NOISE * rng.standard_normal(n)
    return Experiment("impulse", 100.0 * noisy, command, sample_time, "cm")


def published() -> dict[tuple[int, int], Armax]:
    """The paper's printed transfer functions by order and steps."""
    table = pd.read_csv(ROOT / "data" / "transfer_functions.csv", comment="#")
    models = {}
    for row in table.itertuples():
        polynomials = tuple(np.array(text.split(), dtype=float) for text in (row.numerator, row.denominator))
        models[row.order, row.steps] = from_transfer_function(polynomials, PAPER_SAMPLE_TIME)
    return models


def printed_table() -> pd.DataFrame:
    """The paper's Table 2 with the ratio that gives its square error away, and what does not agree."""
    table = pd.read_csv(ROOT / "data" / "table2.csv", comment="#").set_index(["order", "steps", "signal"])
    ratio = table["square_error"] / table["standard_deviation"] ** 2
    table.insert(1, "over_sd_squared", ratio)
    said = [text if isinstance(text, str) else "" for text in table["remark"]]
    for k, value in enumerate(ratio):
        if not math.isnan(value):
            usual = "square error is 3.98 sd²: eq. 13 over 8 samples, neither the record's sum nor its mean"
            said[k] = "; ".join(filter(None, [usual if abs(value - 3.98) < 0.02 else "", said[k]]))
    return table.assign(remark=said)


if __name__ == "__main__":
    main()
