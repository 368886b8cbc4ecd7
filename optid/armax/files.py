"""armax.json: written by a survey, read back bit for bit."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from optid.armax.audit import Finding
from optid.armax.model import Armax
from optid.armax.survey import Survey
from optid.core.document import finite, known, read_document, whole
from optid.errors import InputError

SCHEMA = "optid.armax/1"
MOST = 1000  # coefficients of a polynomial


@dataclass(frozen=True)
class SavedModel:
    """A model and what its audit found."""

    model: Armax
    audit: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class ArmaxFile:
    """Contents of armax.json.

    Attributes:
        input, output: roles of the signals; several inputs are separated by commas.
        recommended: order na of the model to take.
        words: why.
        models: all of them.
        input_unit, output_unit: in which the models take and give them; empty where nobody said.
    """

    input: str
    output: str
    recommended: int
    models: tuple[SavedModel, ...]
    words: str = ""
    input_unit: str = ""
    output_unit: str = ""

    @property
    def chosen(self) -> Armax:
        """The recommended model."""
        return next(saved.model for saved in self.models if saved.model.orders.na == self.recommended)


def from_survey(survey: Survey) -> ArmaxFile:
    """What of a survey goes into armax.json."""
    models = tuple(SavedModel(c.model, c.audit.findings) for c in survey.candidates)
    units = survey.input_unit, survey.table2.unit
    return ArmaxFile(survey.input, survey.output, survey.recommended, models, survey.words, *units)


def to_json(contents: ArmaxFile) -> str:
    """As text; numbers are written so that they read back to the same bits."""
    document = {
        "schema": SCHEMA,
        "input": contents.input,
        "output": contents.output,
        "units": {"input": contents.input_unit, "output": contents.output_unit},
        "recommended": contents.recommended,
        "words": contents.words,
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
        raise ValueError(f"{field} is no list with entries")
    return value


def _model_out(saved: SavedModel) -> dict[str, Any]:
    model, o = saved.model, saved.model.orders
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
        "covariance": _covariance_out(model),
        "audit": [{"name": f.name, "grave": f.grave, "text": f.text} for f in saved.audit],
    }


def _covariance_out(model: Armax) -> list[list[float]] | None:
    if model.covariance is None or not all(math.isfinite(x) for row in model.covariance for x in row):
        return None
    return [list(row) for row in model.covariance]


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
        covariance=None if covariance is None else tuple(numbers(row, "covariance") for row in covariance),
    )
    if not 1e-9 <= model.sample_time <= 1e6:
        raise InputError(
            f"{model.sample_time:g} s", where=where, field=f"{field}.sample_time", expected="1e-9 to 1e6 s"
        )
    o = model.orders
    said = (entry["na"], entry["nb"], entry["nc"])
    if said != (o.na, o.nb[0] if single else list(o.nb), o.nc):
        raise InputError(
            f"na, nb, nc = {said}", where=where, field=field, expected="the lengths of its a, b and c"
        )
    findings = tuple(
        Finding(str(f["name"]), bool(f["grave"]), str(f["text"])) for f in entry.get("audit", [])
    )
    return SavedModel(model, findings)
