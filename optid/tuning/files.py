"""pid.json: written from a tuning, read back as a controller."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from optid.core.document import finite, read_document
from optid.errors import InputError
from optid.pid.controller import AntiWindup, Controller, Gains, Notch, Settings
from optid.tuning.margins import Margins
from optid.tuning.response_metrics import Response, SizeRow, by_size
from optid.tuning.structures import STRUCTURES, Structure, drive_values
from optid.tuning.tuning import Scored, Tuning, compared

SCHEMA = "optid.pid/1"
EQUATION = (
    "u = kp (b r - y) + integral of ki (r - y) + kd d(c r - y)/dt, the derivative lagged by derivative_filter"
)
CLAMPING = {
    AntiWindup.NONE: "the command is limited, the integral is not",
    AntiWindup.CLAMPING: "the command is limited; the integral stops while it would push further into a limit",
    AntiWindup.BACK_CALCULATION: "the command is limited; the integral gives back the excess over the tracking time",
}


def document(
    tuning: Tuning,
    command_unit: str,
    output_unit: str,
    plant: str = "the identified linear model",
    structure: Structure = STRUCTURES["pid2"],
) -> dict[str, Any]:
    """The content of pid.json; a number that does not exist is null.

    Args:
        tuning: as found.
        command_unit, output_unit: of the model's signals, SI.
        plant: on which `cost` was computed, in words.
        structure: of the controller.
    """
    found = tuning.found
    settings = tuning.settings
    drive = drive_values(
        tuning.gains, structure, min(-settings.low, settings.high), (command_unit, output_unit)
    )
    return {
        "schema": SCHEMA,
        "gains": _gains(tuning.gains),
        "units": units(command_unit, output_unit),
        "drive": [{"name": name, "value": _number(value), "unit": unit} for name, value, unit in drive],
        "structure": structure.name,
        "control_law": {
            "equation": EQUATION + _then(settings),
            "limits": CLAMPING[settings.anti_windup],
            "structure": structure.words,
        },
        "sample_time": settings.sample_time,
        "limits": _limits(settings),
        **_ahead(settings),
        "anti_windup": {"kind": settings.anti_windup.name.lower(), "tracking_time": settings.tracking_time},
        "cost": {**_measures(found, tuning.on_bench), "minimised": _number(found.cost), "plant": plant},
        "baselines": {one.name: _scored(one, tuning.on_bench) for one in tuning.baselines},
        "limits_compared": {one.name: _scored(one, tuning.on_bench) for one in compared(tuning)},
        "margins": _margins(found.margins),
        "by_size": [_by_size(row) for row in by_size(found.bench if tuning.on_bench else found.responses)],
        "hunting_limit": _number(tuning.task.hunting),
        "responses": [_response(run) for run in found.responses],
        "responses_on_rig": [_response(run) for run in found.bench],
        "physical_model": _bench(found),
        "certificate": {name: _number(value) for name, value in vars(tuning.certificate).items()},
        "free": list(tuning.within.free),
        "remarks": list(tuning.remarks),
    }


def _by_size(row: SizeRow) -> dict[str, float | None]:
    return {name: _number(value) for name, value in vars(row).items()}


def units(command: str, output: str) -> dict[str, str]:
    """Units of the gains, derived from the signals' units."""
    per = "1" if command == output else f"{command}/{output}" if output != "1" else command
    if command == "1" and output != "1":
        per = f"1/{output}"
    integral = f"{command}/({output} s)" if output != "1" else f"{command}/s" if command != "1" else "1/s"
    derivative = "s" if per == "1" else f"{command} s/{output}" if output != "1" else f"{command} s"
    return {
        "kp": per,
        "ki": "1/s" if per == "1" else integral,
        "kd": derivative,
        "derivative_filter": "s",
        "setpoint_weight": "1",
        "derivative_weight": "1",
        "limits": command,
        "rate": f"{command}/s",
        "sample_time": "s",
        "itae": f"{output} s^2",
        "iae": f"{output} s",
        "itse": f"{output}^2 s^2",
        "ise": f"{output}^2 s",
    }


def _gains(gains: Gains) -> dict[str, float]:
    return {name: float(value) for name, value in vars(gains).items()}


def _limits(settings: Settings) -> dict[str, float | None]:
    said = {name: _number(getattr(settings, name)) for name in ("low", "high", "rate", "resolution")}
    for name in ("deadband_low", "deadband_high", "deadband_onset"):
        if getattr(settings, name):
            said[name] = getattr(settings, name)
    return said


AHEAD = ("acceleration", "friction", "friction_speed")


def _ahead(settings: Settings) -> dict[str, dict[str, float]]:
    """Entries of feed-forward and notch, where there are any."""
    said: dict[str, dict[str, float]] = {}
    if settings.acceleration or settings.friction:
        said["feed_forward"] = {name: float(getattr(settings, name)) for name in AHEAD}
    if settings.notch is not None:
        said["notch"] = {name: float(value) for name, value in vars(settings.notch).items()}
    return said


def _then(settings: Settings) -> str:
    """Terms in addition to the law, in words."""
    said = [
        "; filtered by a notch" if settings.notch is not None else "",
        "; plus feed_forward.acceleration times the set-point's acceleration"
        if settings.acceleration
        else "",
        "; plus feed_forward.friction in the set-point's direction" if settings.friction else "",
    ]
    return "".join(said)


def _measures(one: Scored, bench: bool) -> dict[str, float | None]:
    return {name: _number(one.total(name, bench)) for name in ("itae", "iae", "itse", "ise")}


def _scored(one: Scored, bench: bool) -> dict[str, Any]:
    if one.gains is None:
        return {"itae": None, "gains": None, "stable": None, "note": one.note}
    return {
        **_measures(one, bench),
        "hunting": _number(
            max((run.hunting for run in (one.bench if bench else one.responses)), default=0.0)
        ),
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
        "size": float(run.episode.reference[-1]),
        "weight": run.episode.weight,
        "noisy": bool(run.episode.noise.any()),
        "hunting": _number(run.hunting),
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


def _notch(content: Any, path: Path) -> Notch | None:
    if content is None:
        return None
    frequency, width, depth = (
        finite(content[name], f"notch.{name}", path) for name in ("frequency", "width", "depth")
    )
    return Notch(frequency, width, depth)


LIMITS = ("low", "high", "rate")  # fields of every file, null for none


def load(path: Path) -> Controller:
    """The controller of a pid.json.

    Raises:
        InputError: no such file, no JSON, another schema, or a field that is missing or wrong.
    """
    return controller_of(read_document(path, SCHEMA, "a file of `optid tune`"), path)


def controller_of(content: Any, path: Path) -> Controller:
    """The controller of a parsed pid.json; `path` is named in errors.

    Raises:
        InputError: a field that is missing or wrong.
    """

    def bound(name: str, open_end: float) -> float:
        value = limits[name] if name in LIMITS else limits.get(name)
        return open_end if value is None else finite(value, f"limits.{name}", path)

    def ahead(name: str) -> float:
        return finite(content.get("feed_forward", {}).get(name, 0.0), f"feed_forward.{name}", path)

    try:
        gains, limits = content["gains"], content["limits"]
        windup = content.get("anti_windup", {"kind": "clamping", "tracking_time": 0.0})
        settings = Settings(
            finite(content["sample_time"], "sample_time", path),
            bound("low", -math.inf),
            bound("high", math.inf),
            bound("rate", math.inf),
            bound("deadband_low", 0.0),
            bound("deadband_high", 0.0),
            bound("deadband_onset", 0.0),
            bound("resolution", 0.0),
            AntiWindup[str(windup["kind"]).upper()],
            finite(windup["tracking_time"], "anti_windup.tracking_time", path),
            ahead("acceleration"),
            ahead("friction"),
            ahead("friction_speed"),
            _notch(content.get("notch"), path),
        )
        return Controller(
            Gains(**{name: finite(value, f"gains.{name}", path) for name, value in gains.items()}), settings
        )
    except KeyError as error:
        raise InputError("missing or unknown", where=path, field=str(error.args[0])) from error
    except (TypeError, ValueError, AttributeError) as error:
        raise InputError(f"{error}", where=path, expected="an optid.pid/1 document") from error
