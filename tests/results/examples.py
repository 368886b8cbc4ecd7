"""One result of every kind: real where that takes seconds, else what a diagnosis or a plan writes, in small."""

from dataclasses import replace
from functools import cache
from json import loads
from pathlib import Path

import numpy as np
import pandas as pd

import optid
from optid.armax.files import to_json
from optid.results.check import CheckResult
from optid.results.diagnosis import DiagnosisResult
from optid.results.fit import FitResult, ProfileResult
from optid.results.fleet import FleetResult
from optid.results.identification import IdentificationResult
from optid.results.plan import PlanResult
from optid.results.simulation import SimulationResult
from optid.results.tuning import TuningResult

DATA = Path(__file__).parents[2] / "data"
SAMPLES = 1500


def short(name):
    return pd.read_csv(DATA / f"{name}.csv").head(SAMPLES)


def rig():
    """The bench with two free parameters."""
    read = optid.read_rig(DATA / "bench.toml")
    return replace(
        read, freed=tuple(f for f in read.freed if f.name in ("viscous_friction", "coulomb_friction"))
    )


def check():
    return optid.check(replace(rig(), freed=()), short("bench"))  # what the data can tell is not asked


def simulation():
    return optid.simulate(DATA / "bench.toml", short("bench"))


def fit():
    return optid.fit(rig(), short("bench"), holdout=short("bench_holdout"))


def profile():
    values = np.linspace(1.0, 3.0, 9)
    document = {
        "schema": ProfileResult.SCHEMA,
        "parameter": "mass",
        "value": 2.0,
        "unit": "kg",
        "ci95": [1.5, None],
        "fit_ci95": [1.5, 2.5],
        "limit": 3.84,
        "words": "mass: the data set no limit above within reach",
    }
    table = pd.DataFrame({"value": values, "deviance": 15 * (values - 2.0) ** 2, "damping": 3 * values})
    return ProfileResult(document, {"profile": table})


def diagnosis():
    time = np.tile(0.01 * np.arange(200), 2)
    measured = np.sin(time)
    scores = {"position": {"fit_percent": 80.0, "rmse": 2e-3, "unit": "m"}}
    parameters = {"mass": {"value": 2.0, "unit": "kg", "ci95": [1.9, None]}}
    finding = {
        "effect": "power_law@spring.force",
        "site": "force",
        "place": "spring.force",
        "equation": "11",
        "sentence": "the spring hardens by -0 um",
        "parameters": {"k": {"value": 3.0, "unit": "N/m", "ci95": [2.0, 4.0]}},
        "where": {
            "channels": ["position"],
            "intervals": [["held.csv", 0.1, 0.4]],
            "states": {
                "position": {
                    "low": -45e-6,
                    "high": 1e-3,
                    "unit": "m",
                    "share_of_mismatch": 0.9,
                    "share_of_samples": 0.2,
                    "by_law": True,
                }
            },
        },
        "evidence": {"holdout_fit_gain": 3.0, "p_value": 1e-4, "delta_bic": 50.0},
        "indistinguishable_from": ["spring_load"],
    }
    document = {
        "schema": DiagnosisResult.SCHEMA,
        "verdict": "missing-physics",
        "summary": "Found: 45 um.",
        "baseline": {"parameters": parameters, "holdout": scores},
        "improved": {
            "parameters": parameters,
            "holdout": {"position": {**scores["position"], "fit_percent": 99.0}},
        },
        "noise_floor": {"position": {"rmse": 3e-5, "unit": "m"}},
        "findings": [finding],
        "rejected": [{"effect": "valve_lag", "why": "no gain"}],
        "not_testable": [{"effect": "end_cushioning", "why": "never there", "smallest_visible": ""}],
        "residual_after": {"white": True, "independent_of_input": False},
        "about": {
            "rig": "bench",
            "rig_file": str(DATA / "bench.toml"),
            "horizon": 0.5,
            "outputs": {"position": "m"},
            "training": ["train.csv"],
            "held_out": ["held.csv"],
            "asked": ["mass"],
            "effects": [{"law": "k x^3"}],
        },
    }
    names = ["held.csv"] * 200 + ["more.csv"] * 200
    tables = {
        "holdout": pd.DataFrame(
            {
                "recording": names,
                "time": time,
                "position": measured,
                "position_before": measured + 2e-3,
                "position_after": np.where(time < 0.5, np.nan, measured),
            }
        ),
        "map 1": pd.DataFrame(
            {"recording": "train.csv", "time": 0.1 * np.arange(20), "mismatch": np.arange(20.0)}
        ),
        "state 1 position": pd.DataFrame(
            {"low": [0.0, 0.1], "high": [0.1, 0.2], "samples": [0.5, 0.5], "mismatch": [0.9, 0.1]}
        ),
        "signal 1": pd.DataFrame(
            {
                "recording": "train.csv",
                "time": time[:200],
                "missing": measured[:200],
                "missing_sd": np.full(200, 2e-4),
                "law": measured[:200],
                "cause": measured[:200],
            }
        ),
    }
    rig_file = (DATA / "bench.toml").read_text(encoding="utf-8")
    return DiagnosisResult(document, tables, {"rig.toml": rig_file})


def model():
    """An integrator behind a lag, as python-control has it."""
    import control

    return optid.from_control(control.tf([2e-5, 1.9e-5], np.convolve([1, -1], [1, -0.9]), 1e-3, name="axis"))


def identification():
    return IdentificationResult(
        loads(to_json(model())), {}, {"table2.csv": "order,steps\n", "report.html": "<html></html>"}
    )


@cache  # several tests ask for it, and it takes ten seconds
def tuning():
    return optid.tune(model(), limits=(-5.0, 5.0), setpoints=(0.02,), starts=1, free=("kp", "kd"))


def plan():
    time = np.arange(0.0, 2.0, 0.01)
    document = {
        "schema": PlanResult.SCHEMA,
        "rig": "bench",
        "seconds": 2.0,
        "rate": 100.0,
        "seed": 0,
        "gains": {"kp": 20.0, "ki": 0.0},
        "limits": {
            "command": [-5, 5],
            "command_rate": None,
            "command_unit": "V",
            "position": [-0.1, 0.1],
            "position_unit": "m",
        },
        "noise": {"position": 1e-5},
        "needed_sd": 4.65,
        "pieces": [{"name": "steps", "from": 0.0, "to": 2.0}],
        "rivals": [
            {"effect": "valve_lag", "smallest": {"tau": {"value": 3e-4, "unit": "s"}}, "law": "a lag"}
        ],
        "pairs": [
            {"there": "valve_lag", "instead": None, "sd": 2.0, "sd_plain_steps": 1.0, "seconds_needed": None}
        ],
        "about": {"rig_file": str(DATA / "bench.toml"), "starts": [0.0]},
    }
    table = pd.DataFrame(
        {"time": time, "reference": np.sign(np.sin(time)), "position": np.sin(time), "command": np.cos(time)}
    )
    return PlanResult(document, {"experiment": table}, {"experiment.csv": "t,u\r\n0,1\r\n"})


def fleet():
    """A fleet of two rows, one of which failed; nothing is told of."""
    document = {
        "schema": FleetResult.SCHEMA,
        "version": "1",
        "command": "fleet",
        "inputs": {},
        "rows": 2,
        "rigs": 2,
        "outcomes": {"done": 1, "bad-input": 1},
        "failed": [{"name": "b", "outcome": "bad-input", "said": "no such file"}],
        "level": 0.05,
        "reference": 7,
        "told": [],
        "sentences": [],
        "unlike": [],
        "pooled": [],
    }
    rows = pd.DataFrame(
        {
            "name": ["a", "b"],
            "rig": ["a", "b"],
            "date": ["2026-10-01", "2026-10-02"],
            "job": ["check", "check"],
            "outcome": ["done", "bad-input"],
            "verdict": ["", ""],
            "effects": ["{}", "{}"],
            "said": ["", "no such file"],
            "cpu_seconds": [1.5, 0.5],
        }
    )
    return FleetResult(document, {"rows": rows})


# Made once a process: results do not change.
MAKERS = {
    kind: cache(make)
    for kind, make in {
        CheckResult: check,
        SimulationResult: simulation,
        FitResult: fit,
        ProfileResult: profile,
        DiagnosisResult: diagnosis,
        IdentificationResult: identification,
        TuningResult: tuning,
        PlanResult: plan,
        FleetResult: fleet,
    }.items()
}
