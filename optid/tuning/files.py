"""pid.json: written from a tuning, read back as a controller."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from optid.errors import InputError
from optid.pid.controller import AntiWindup, Controller, Gains, Settings
from optid.tuning.margins import Margins
from optid.tuning.score import Response
from optid.tuning.tuning import Scored, Tuning, compared

SCHEMA = "optid.pid/1"


def document(tuning: Tuning, command_unit: str, output_unit: str) -> dict[str, Any]:
    """The content of pid.json; a number that does not exist is null.

    Args:
        tuning: as found.
        command_unit, output_unit: of the model's signals, SI.
    """
    found = tuning.found
    return {
        "schema": SCHEMA,
        "gains": _gains(tuning.gains),
        "units": units(command_unit, output_unit),
        "sample_time": tuning.settings.sample_time,
        "limits": _limits(tuning.settings),
        "anti_windup": {
            "kind": tuning.settings.anti_windup.name.lower(),
            "tracking_time": tuning.settings.tracking_time,
        },
        "cost": {**_measures(found, False), "minimised": _number(found.cost)},
        "baselines": {one.name: _scored(one) for one in tuning.baselines},
        "limits_compared": {one.name: _scored(one) for one in compared(tuning)},
        "margins": _margins(found.margins),
        "responses": [_response(run) for run in found.responses],
        "physical_model": _bench(found),
        "certificate": {name: _number(value) for name, value in vars(tuning.certificate).items()},
        "free": list(tuning.within.free),
        "remarks": list(tuning.remarks),
    }


def units(command: str, output: str) -> dict[str, str]:
    """Of the gains, made of the signals' own."""
    per = "1" if command == output else f"{command}/{output}" if output != "1" else command
    if command == "1" and output != "1":
        per = f"1/{output}"
    integral = f"{command}/({output} s)" if output != "1" else f"{command}/s" if command != "1" else "1/s"
    derivative = "s" if per == "1" else f"{command} s/{output}" if output != "1" else f"{command} s"
    return {
        "kp": per, "ki": "1/s" if per == "1" else integral, "kd": derivative, "derivative_filter": "s",
        "setpoint_weight": "1", "derivative_weight": "1", "limits": command, "rate": f"{command}/s",
        "sample_time": "s", "itae": f"{output} s^2", "iae": f"{output} s", "itse": f"{output}^2 s^2",
        "ise": f"{output}^2 s",
    }  # fmt: skip


def _gains(gains: Gains) -> dict[str, float]:
    return {name: float(value) for name, value in vars(gains).items()}


def _limits(settings: Settings) -> dict[str, float | None]:
    said = {name: _number(getattr(settings, name)) for name in ("low", "high", "rate", "resolution")}
    for name in ("deadband_low", "deadband_high", "deadband_onset"):
        if getattr(settings, name):
            said[name] = getattr(settings, name)
    return said


def _measures(one: Scored, bench: bool) -> dict[str, float | None]:
    return {name: _number(one.total(name, bench)) for name in ("itae", "iae", "itse", "ise")}


def _scored(one: Scored) -> dict[str, Any]:
    if one.gains is None:
        return {"itae": None, "gains": None, "stable": None, "note": one.note}
    return {
        **_measures(one, False),
        "stable": one.stable,
        "gains": _gains(one.gains),
        "maximum_sensitivity": _number(one.margins.maximum_sensitivity) if one.margins else None,
        "physical_model": _bench(one),
        "note": one.note,
    }


def _bench(one: Scored) -> dict[str, float | None] | None:
    return _measures(one, True) if one.bench else None


def _response(run: Response) -> dict[str, Any]:
    command = run.command[: -1 if not run.bounded else None]
    return {
        "name": run.episode.name,
        **{name: _number(value) for name, value in run.measures.items()},
        "overshoot": _number(run.overshoot),
        "settling_time": _number(run.settled),
        "command_low": _number(float(command.min())),
        "command_high": _number(float(command.max())),
        "command_travel": _number(run.travel),
    }


def _margins(margins: Margins | None) -> dict[str, float | bool | None]:
    if margins is None:
        return {}
    return {
        name: value if isinstance(value, bool) else _number(value) for name, value in vars(margins).items()
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def load(path: Path) -> Controller:
    """The controller of a pid.json.

    Raises:
        InputError: no such file, no JSON, another schema, or a field that is missing or wrong.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError("no such file", where=path) from error
    except (OSError, ValueError) as error:
        raise InputError(
            f"cannot be read ({error})", where=path, expected="a file of `optid tune`"
        ) from error
    return controller_of(content, path)


def controller_of(content: Any, path: object = None) -> Controller:
    """The controller of a parsed pid.json; `path` is named in errors.

    Raises:
        InputError: another schema, or a field that is missing or wrong.
    """
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = content.get("schema") if isinstance(content, dict) else type(content).__name__
        raise InputError(f"{found}", where=path, field="schema", expected=SCHEMA)
    try:
        gains, limits = content["gains"], content["limits"]
        windup = content.get("anti_windup", {"kind": "clamping", "tracking_time": 0.0})
        settings = Settings(
            float(content["sample_time"]),
            -math.inf if limits["low"] is None else float(limits["low"]),
            math.inf if limits["high"] is None else float(limits["high"]),
            math.inf if limits["rate"] is None else float(limits["rate"]),
            float(limits.get("deadband_low", 0.0)),
            float(limits.get("deadband_high", 0.0)),
            float(limits.get("deadband_onset", 0.0)),
            float(limits.get("resolution") or 0.0),
            AntiWindup[str(windup["kind"]).upper()],
            float(windup["tracking_time"]),
        )
        return Controller(Gains(**{name: float(value) for name, value in gains.items()}), settings)
    except KeyError as error:
        raise InputError("missing or unknown", where=path, field=str(error.args[0])) from error
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{error}", where=path, expected="an optid.pid/1 document") from error
