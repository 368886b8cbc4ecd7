"""The options of `optid tune`: numbers with units, ranges and profiles, read into a specification in SI."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from optid.errors import InputError

if TYPE_CHECKING:
    from optid.core.model import Array
    from optid.pid.controller import Gains, Notch
    from optid.tuning.bench_search import Effort
    from optid.tuning.optimise import Options
    from optid.tuning.specification import TuningSpec
    from optid.tuning.structures import Structure


class RangeCommand(click.Command):
    """Lets `--limits -5 5` and `--limits -5,5` mean the same."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Join two values that follow an option for a range."""
        joined, rest = [], list(args)
        while rest:
            joined.append(rest.pop(0))
            if (
                joined[-1] in ("--limits", "--deadband", "--dead-zone")
                and len(rest) > 1
                and _numeric(rest[0])
                and _numeric(rest[1])
            ):
                joined.append(f"{rest.pop(0)},{rest.pop(0)}")
        return super().parse_args(ctx, joined)


def _numeric(text: str) -> bool:
    return text[:1].isdigit() or text[:2] in {f"-{d}" for d in "0123456789."} or text[:1] in "+."


def present_gains(text: str | None) -> Gains | None:
    """The gains in use: KP,KI,KD and nothing else."""
    from optid.pid.controller import Gains

    if text is None:
        return None
    parts = text.split(",")
    if not 1 <= len(parts) <= 3:
        raise InputError(f'"{text}"', where="--present", expected="KP,KI,KD, as in 60,80,0.5")
    return Gains(*(_known(part.strip(), "1", "--present") for part in parts))


def notch_of(text: str | None) -> Notch | None:
    """HZ[,WIDTH[,DEPTH]]."""
    from optid.pid.controller import Notch

    if text is None:
        return None
    parts = [part.strip() for part in text.split(",")]
    if not 1 <= len(parts) <= 3:
        raise InputError(f'"{text}"', where="--notch", expected="HZ[,WIDTH[,DEPTH]], as in 25,8,0.1")
    frequency = _known(parts[0], "Hz", "--notch")
    width = _known(parts[1], "Hz", "--notch") if len(parts) > 1 else frequency / 3.0
    depth = _known(parts[2], "1", "--notch") if len(parts) > 2 else 0.0
    return Notch(2.0 * math.pi * frequency, 2.0 * math.pi * width, depth)


def search_options(choices: dict[str, Any], structure: Structure, effort: Effort, simulated: bool) -> Options:
    """Options of the search; `simulated` if the gains are judged by a simulation with friction."""
    from optid.pid.controller import Gains
    from optid.tuning.optimise import Options
    from optid.tuning.structures import free_gains

    lag = _quantity(choices["derivative_filter"], "s", "--derivative-filter")
    free = free_gains(structure, simulated and lag is None, bool(choices["profiles"]))
    if choices["free"] is not None:
        free = tuple(name.strip() for name in choices["free"].split(","))
    fixed = None if lag is None else Gains(kp=1.0, derivative_filter=lag)
    return Options(free, fixed, choices["starts"], cascade=structure.cascade, effort=effort)


def specification(choices: dict[str, Any], contents: Any) -> TuningSpec:
    """The options in SI."""
    from optid.pid.controller import AntiWindup
    from optid.tuning.criterion import Criterion
    from optid.tuning.integral_criteria import Measure
    from optid.tuning.integrator import Integrator
    from optid.tuning.margins import Required
    from optid.tuning.problem import units_of
    from optid.tuning.specification import TuningSpec
    from optid.tuning.task import Aggregation

    u, y = units_of(contents)
    low, high = _range(choices["limits"], u, "--limits")
    wide = _range(choices["deadband"], u, "--deadband")
    dead = (0.0, 0.0, 0.0)
    if wide[0] is not None and wide[1] is not None:
        below, above = abs(wide[0]), abs(wide[1])
        dead = (below, above, 0.1 * max(below, above))
    return TuningSpec(
        order=choices["order"],
        setpoints=tuple(_known(text, y, "--setpoint") for text in choices["setpoints"]),
        disturbances=tuple(_known(text, u, "--disturbance") for text in choices["disturbances"]),
        profiles=tuple(_path(name, contents.chosen.sample_time) for name in choices["profiles"]),
        low=low,
        high=high,
        deadband=dead,
        anti_windup=AntiWindup[choices["anti_windup"].upper().replace("-", "_")],
        rate=_quantity(choices["rate"], "Hz" if u == "1" else f"{u}/s", "--rate"),
        resolution=_quantity(choices["resolution"], u, "--resolution") or 0.0,
        horizon=_quantity(choices["horizon"], "s", "--horizon"),
        sample_time=_quantity(choices["sample_time"], "s", "--sample-time"),
        criterion=Criterion(Measure[choices["cost"].upper()], choices["effort"], choices["overshoot"]),
        required=Required(
            _sensitivity(choices["ms"]),
            choices["gain_margin"],
            choices["phase_margin"],
            _quantity(choices["delay_margin"], "s", "--delay-margin"),
        ),
        over=Aggregation.WORST if choices["robust"] == "worst" else Aggregation.MEAN,
        scenarios=choices["scenarios"],
        integrator=Integrator[choices["integrator"].upper()],
        dead_zone=_dead_zone(choices["dead_zone"], u),
        notch=notch_of(choices["notch"]),
        acceleration=_quantity(choices["acceleration"], f"{u} s**2/{y}", "--acceleration") or 0.0,
        compensate=choices["compensate"],
        usual_sensitivity=choices["ms"] is None,
    )


def _dead_zone(text: str | None, unit: str) -> tuple[float, float]:
    low, high = _range(text, unit, "--dead-zone")
    return (0.0, 0.0) if low is None or high is None else (-abs(low), abs(high))


def _sensitivity(text: str | None) -> float | None:
    if text is None or text.lower() in ("none", "inf"):
        return None
    return _known(text, "1", "--ms")


def _quantity(text: str | None, unit: str, option: str) -> float | None:
    """A number in SI, or a number with a unit."""
    from optid.core.units import to_si

    if text is None:
        return None
    try:
        value = float(text)
    except ValueError:
        value = to_si(text, unit, where=option)
    if not math.isfinite(value):
        raise InputError(f'"{text}"', where=option, expected=f"a finite number ({unit})")
    return value


def _known(text: str, unit: str, option: str) -> float:
    value = _quantity(text, unit, option)
    assert value is not None
    return value


def _range(text: str | None, unit: str, option: str) -> tuple[float | None, float | None]:
    """Two values, or one for both sides."""
    if text is None:
        return None, None
    parts = [part.strip() for part in text.replace("..", ",").replace(";", ",").split(",")]
    if len(parts) not in (1, 2):
        raise InputError(f'"{text}"', where=option, expected="LOW,HIGH, as in -5,5")
    values = [_known(part, unit, option) for part in parts]
    if len(values) == 1:
        return -abs(values[0]), abs(values[0])
    return values[0], values[1]


def _path(name: str, sample_time: float) -> tuple[str, Array]:
    """A profile: time (s) and wanted value (SI) in the first two columns, held between its rows."""
    import numpy as np
    import pandas as pd

    try:
        table = pd.read_csv(name, comment="#", sep=None, engine="python")
        values = table.iloc[:, :2].to_numpy(dtype=float)
    except FileNotFoundError:
        raise InputError("no such file", where=name) from None
    except (OSError, ValueError, UnicodeDecodeError, pd.errors.ParserError) as error:
        raise InputError(
            f"cannot be read ({error})", where=name, expected="two columns of numbers: time (s), value"
        ) from None
    if values.ndim != 2 or values.shape[1] != 2 or len(values) < 2 or not np.isfinite(values).all():
        raise InputError(
            "this is not a set-point profile",
            where=name,
            expected="two columns of numbers: time (s), value",
            hint="no row may be empty",
        )
    time, wanted = values.T
    if not np.all(np.diff(time) > 0):
        raise InputError("the times do not increase", where=name, field=str(table.columns[0]))
    at = time[0] + sample_time * np.arange(round((time[-1] - time[0]) / sample_time) + 1)
    return Path(name).stem, wanted[np.searchsorted(time, at + 1e-9 * sample_time, side="right") - 1]
