"""armax.json: written by a survey, read back bit for bit."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from optid.armax import sliding
from optid.armax.model import Armax
from optid.armax.offline import names
from optid.armax.profile import Interval, Intervals, wald_intervals
from optid.armax.sliding import SlidingAxis
from optid.armax.survey import Survey
from optid.armax.words import Finding
from optid.core.document import finite, known, read_document, whole
from optid.errors import InputError

SCHEMA = "optid.armax/1"
MOST = 1000  # coefficients of a polynomial


@dataclass(frozen=True)
class SavedModel:
    """A model, the findings of its audit, and its intervals if they are better than those from its covariance."""

    model: Armax
    audit: tuple[Finding, ...] = ()
    intervals: Intervals | None = field(default=None, compare=False)


@dataclass(frozen=True)
class ArmaxFile:
    """Contents of armax.json.

    Attributes:
        input, output: roles of the signals; several inputs are separated by commas.
        recommended: order na of the recommended model.
        words: the reasons.
        models: all of them.
        input_unit, output_unit: units of the models' signals; empty where not stated.
        axis: with dry friction, fitted to the recording in addition to the linear models; None where it shows none.
    """

    input: str
    output: str
    recommended: int
    models: tuple[SavedModel, ...]
    words: str = ""
    input_unit: str = ""
    output_unit: str = ""
    axis: SlidingAxis | None = None

    @property
    def chosen(self) -> Armax:
        """The recommended model."""
        return next(saved.model for saved in self.models if saved.model.orders.na == self.recommended)


def from_survey(survey: Survey, axis: SlidingAxis | None = None) -> ArmaxFile:
    """The content of armax.json from a survey, with the axis fitted to its recording."""
    models = tuple(SavedModel(c.model, c.audit.findings, c.intervals) for c in survey.candidates)
    units = survey.input_unit, survey.table2.unit
    return ArmaxFile(survey.input, survey.output, survey.recommended, models, survey.words, *units, axis)


def to_json(contents: ArmaxFile) -> str:
    """As text; numbers are written so that they read back to the same bits."""
    document = {
        "schema": SCHEMA,
        "input": contents.input,
        "output": contents.output,
        "units": {"input": contents.input_unit, "output": contents.output_unit},
        "recommended": contents.recommended,
        "words": contents.words,
        "axis": sliding.to_document(contents.axis),
        "models": [_model_out(saved) for saved in contents.models],
    }
    return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def save(path: Path, contents: ArmaxFile) -> None:
    """Write armax.json."""
    path.write_text(to_json(contents), encoding="utf-8")


def load(path: Path) -> ArmaxFile:
    """Read armax.json.

    Raises:
        InputError: no such file, no JSON, another schema, or a field that is missing or of the wrong kind.
    """
    return from_document(read_document(path, SCHEMA, "a file of `optid identify`"), path)


def from_document(document: Any, where: object = None) -> ArmaxFile:
    """From parsed JSON."""
    document = known(document, SCHEMA, where)
    try:
        models = tuple(
            _model_in(entry, f"models[{i}]", where) for i, entry in enumerate(_list(document, "models"))
        )
        units = document.get("units", {})
        contents = ArmaxFile(
            str(document["input"]),
            str(document["output"]),
            whole(document["recommended"], "recommended", where),
            models,
            str(document.get("words", "")),
            str(units.get("input", "")),
            str(units.get("output", "")),
            sliding.from_document(document.get("axis"), where),
        )
    except KeyError as error:
        raise InputError("missing", where=where, field=str(error.args[0])) from error
    except (AttributeError, TypeError, ValueError, OverflowError, IndexError) as error:
        raise InputError(f"{error}", where=where, expected="an optid.armax/1 document") from error
    if all(saved.model.orders.na != contents.recommended for saved in models):
        raise InputError(
            f"{contents.recommended}", where=where, field="recommended", expected="na of a model"
        )
    return contents


def _list(document: dict[str, Any], field: str) -> list[Any]:
    value = document[field]
    if not isinstance(value, list) or not value:
        raise ValueError(f"{field} is not a list with entries")
    return value


def _model_out(saved: SavedModel) -> dict[str, Any]:
    model, o = saved.model, saved.model.orders
    intervals = saved.intervals or wald_intervals(model)
    single = o.inputs == 1
    return {
        "na": o.na,
        "nb": o.nb[0] if single else list(o.nb),
        "nc": o.nc,
        "nk": o.nk[0] if single else list(o.nk),
        "a": list(model.a),
        "b": list(model.b[0]) if single else [list(b) for b in model.b],
        "c": list(model.c),
        "sample_time": model.sample_time,
        "noise_variance": model.noise_variance,
        "constant": model.constant,
        "slope": model.slope,
        "trend_errors": [_number(x) for x in model.trend_errors],
        "covariance": _covariance_out(model),
        "not_determined": [
            name for name, sd in zip(names(o), model.standard_errors, strict=True) if math.isinf(sd)
        ],
        "static_gain": [_gain_out(model, i, intervals.static_gains[i]) for i in range(o.inputs)],
        "poles": _poles_out(model, intervals),
        "audit": [{"name": f.name, "grave": f.grave, "text": f.text} for f in saved.audit],
    }


def _covariance_out(model: Armax) -> list[list[float | None]] | None:
    """Null represents infinity: the data do not determine it."""
    if model.covariance is None:
        return None
    return [[_number(x) for x in row] for row in model.covariance]


def _number(x: float) -> float | None:
    return x if math.isfinite(x) else None


def _gain_out(model: Armax, input: int, interval: Interval) -> dict[str, Any]:
    """Value and 95 % interval of B(1)/A(1); null for an integrator's, or where the data do not determine it."""
    at_one = math.fsum(model.a)
    value = math.fsum(model.b[input]) / at_one if abs(at_one) > 1e-12 else math.inf
    return {"value": _number(value), "ci95": _interval_out(interval)}


def _poles_out(model: Armax, intervals: Intervals) -> list[dict[str, Any]]:
    """In z, with the 95 % interval of each one's modulus."""
    poles = np.roots(np.array(model.a)).astype(complex)
    return [
        {
            "real": float(pole.real),
            "imag": float(pole.imag),
            "modulus": float(abs(pole)),
            "ci95": _interval_out(interval),
        }
        for pole, interval in zip(poles, intervals.poles, strict=True)
    ]


def _interval_out(interval: Interval) -> list[float | None] | None:
    """Null for an open side, and for an interval that is open on both or unknown."""
    low, high = (_number(float(end)) for end in interval)
    return None if low is None and high is None else [low, high]


def _model_in(entry: dict[str, Any], field: str, where: object) -> SavedModel:
    def numbers(values: Any, name: str) -> tuple[float, ...]:
        if len(values) > MOST:
            raise ValueError(f"{field}.{name} has {len(values)} entries, more than {MOST}")
        return tuple(finite(x, f"{field}.{name}", where) for x in values)

    nk, b = entry["nk"], entry["b"]
    single = not isinstance(nk, list)
    covariance = entry.get("covariance")
    model = Armax(
        a=numbers(entry["a"], "a"),
        b=tuple(numbers(row, "b") for row in ([b] if single else b)),
        c=numbers(entry["c"], "c"),
        nk=tuple(whole(k, f"{field}.nk", where) for k in ([nk] if single else nk)),
        sample_time=finite(entry["sample_time"], f"{field}.sample_time", where),
        noise_variance=finite(entry["noise_variance"], f"{field}.noise_variance", where),
        covariance=None if covariance is None else _covariance_in(covariance, f"{field}.covariance", where),
        constant=finite(entry.get("constant", 0.0), f"{field}.constant", where),
        slope=finite(entry.get("slope", 0.0), f"{field}.slope", where),
        trend_errors=_pair(entry.get("trend_errors", (0.0, 0.0))),
    )
    if not 1e-9 <= model.sample_time <= 1e6:
        raise InputError(
            f"{model.sample_time:g} s", where=where, field=f"{field}.sample_time", expected="1e-9 to 1e6 s"
        )
    if model.noise_variance < 0.0:
        found = f"{model.noise_variance:g}"
        raise InputError(found, where=where, field=f"{field}.noise_variance", expected="no negative number")
    o = model.orders
    if model.covariance is not None and {len(model.covariance), *map(len, model.covariance)} != {
        len(model.theta)
    }:
        size = f"{len(model.theta)} rows and columns, as many as there are coefficients"
        raise InputError("a matrix of another size", where=where, field=f"{field}.covariance", expected=size)
    said = (entry["na"], entry["nb"], entry["nc"])
    if said != (o.na, o.nb[0] if single else list(o.nb), o.nc):
        raise InputError(
            f"na, nb, nc = {said}", where=where, field=field, expected="the lengths of its a, b and c"
        )
    findings = tuple(
        Finding(str(f["name"]), bool(f["grave"]), str(f["text"])) for f in entry.get("audit", [])
    )
    return SavedModel(model, findings, _intervals_in(entry))


def _intervals_in(entry: dict[str, Any]) -> Intervals | None:
    """The stored intervals; None where a file has none."""

    def interval(said: list[float | None] | None) -> Interval:
        low, high = (None, None) if said is None else said
        return -math.inf if low is None else float(low), math.inf if high is None else float(high)

    if "poles" not in entry or "static_gain" not in entry:
        return None
    return Intervals(
        tuple(interval(pole.get("ci95")) for pole in entry["poles"]),
        tuple(interval(gain.get("ci95")) for gain in entry["static_gain"]),
    )


def _covariance_in(
    rows: list[list[float | None]], field: str, where: object
) -> tuple[tuple[float, ...], ...]:
    def value(x: float | None, i: int, j: int) -> float:
        if x is None:
            return math.inf if i == j else math.nan
        return finite(x, field, where)

    return tuple(tuple(value(x, i, j) for j, x in enumerate(row)) for i, row in enumerate(rows))


def _pair(values: Any) -> tuple[float, float]:
    first, second = (math.inf if x is None else float(x) for x in values)
    return first, second
