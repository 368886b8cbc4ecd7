"""`optid tune`: PID gains by optimising the closed loop on an identified model."""

from __future__ import annotations

import math
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import click

from optid.cli.common import OUT, deliver, progress, results_folder, say_table, waiting, write_json
from optid.errors import InputError, JobError, SolveError

if TYPE_CHECKING:
    from optid.core.model import Array
    from optid.pid.controller import Gains
    from optid.tuning.bench_search import Effort
    from optid.tuning.optimise import Options
    from optid.tuning.posing import Posed, Wishes
    from optid.tuning.structures import Structure
    from optid.tuning.tuning import Scored, Tuning


class _Pairs(click.Command):
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


@click.command(cls=_Pairs)
@click.argument("model", metavar="MODEL.json")
@OUT
@click.option(
    "--setpoint",
    "setpoints",
    multiple=True,
    metavar="SIZE",
    help='Largest step, "6 cm"; shares of it in both directions are added. May be repeated.',
)
@click.option(
    "--profile", "profiles", multiple=True, metavar="CSV", help="Path to follow: columns time and value."
)
@click.option(
    "--disturbance", "disturbances", multiple=True, metavar="SIZE", help="Step added to the command."
)
@click.option(
    "--limits", metavar="LOW,HIGH", help='Of the command; "-5,5", "-5 V, 5 V", or one for both sides.'
)
@click.option("--rate", metavar="RATE", help="Largest change of the command per second.")
@click.option("--resolution", metavar="STEP", help="Smallest step of the command.")
@click.option(
    "--deadband", metavar="LOW,HIGH", help="Widths of the valve's dead band to jump over, both positive."
)
@click.option(
    "--anti-windup",
    type=click.Choice(["clamping", "back-calculation", "none"]),
    default="clamping",
    show_default=True,
)
@click.option("--order", type=int, metavar="NA", help="Model to take; the recommended one by default.")
@click.option("--horizon", metavar="S", help="Seconds of an episode.")
@click.option("--sample-time", metavar="S", help="At which the controller will run: must be the model's.")
@click.option("--cost", type=click.Choice(["itae", "iae", "itse", "ise"]), default="itae", show_default=True)
@click.option("--effort", type=float, default=0.0, metavar="W", help="Weight of the command's travel.")
@click.option("--overshoot", type=float, default=0.0, metavar="W", help="Weight of the overshoot.")
@click.option(
    "--ms",
    metavar="MS",
    help="Maximum sensitivity on MODEL, at most; 2, 5 where friction is assumed, none with --rig.",
)
@click.option("--gain-margin", type=float, metavar="FACTOR", help="At least.")
@click.option("--phase-margin", type=float, metavar="DEG", help="At least, degrees.")
@click.option("--delay-margin", metavar="S", help="At least, seconds.")
@click.option("--present", metavar="KP,KI,KD", help="Gains now in force (SI, as in pid.json): a baseline.")
@click.option(
    "--structure", metavar="NAME", help="pid, pid2, pd, pi, p, or p-pi: P position over PI velocity."
)
@click.option("--free", metavar="NAMES", help="Gains that may move; the structure's by default.")
@click.option(
    "--integrator",
    type=click.Choice(["auto", "yes", "no"]),
    default="auto",
    show_default=True,
    help="Carry the model's pole nearest to 1 as an exact integrator.",
)
@click.option(
    "--dead-zone", metavar="LOW,HIGH", help="Of the valve, part of the plant; both widths positive."
)
@click.option(
    "--time-limit",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Seconds of the processor; the best so far is kept.",
)
@click.option(
    "--deadline", type=click.FloatRange(min=0, min_open=True), metavar="S", help="The same by the clock."
)
@click.option("--derivative-filter", metavar="S", help="Time constant of the derivative's lag.")
@click.option(
    "--scenarios", type=click.IntRange(1, 1000), default=1, help="Plants drawn from the covariance."
)
@click.option("--robust", type=click.Choice(["worst", "mean"]), default="worst", help="Over the scenarios.")
@click.option("--rig", metavar="RIG", help="Physical model of the axis: tuned for and tried on as well.")
@click.option("--check-only", is_flag=True, help="Try the gains on the rig's model, but do not tune for it.")
@click.option(
    "--starts", type=click.IntRange(1, 100), default=4, show_default=True, help="Independent searches."
)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--export", is_flag=True, help="Write the controller as C (pid.h) and structured text (pid.st), too."
)
def tune(model: str, out: str, **choices: Any) -> None:
    """Find PID gains for an identified model (armax.json) by optimising the closed loop."""
    folder = results_folder(out)

    import numpy as np

    from optid.armax.files import load
    from optid.rigs.rigfile import read_rig
    from optid.tuning.bench_search import Effort
    from optid.tuning.files import document
    from optid.tuning.posing import build_problem
    from optid.tuning.structures import structure_of
    from optid.tuning.tuning import tune as tuned

    contents = load(Path(model))
    rig = None if choices["rig"] is None else read_rig(choices["rig"])
    rng = np.random.default_rng(choices["seed"])
    wishes = _wishes(choices, contents)
    posed = build_problem(contents, Path(model), wishes, rng, rig, not choices["check_only"])
    structure = structure_of(choices["structure"] or ("pid" if posed.task.bench_alone else "pid2"))
    present = _present(choices["present"])
    patience = _Patience(choices["time_limit"], choices["deadline"])
    with progress("tuning") as show, patience:
        options = _options(choices, structure, Effort(show, patience.over), posed.task.bench_alone)
        try:
            result = tuned(posed.task, rng, options, posed.bench, present)
        except SolveError:
            if choices["ms"] is not None:
                raise
            posed = posed.without_sensitivity()
            result = tuned(posed.task, rng, options, posed.bench, present)
    if patience.words:
        result = replace(result, remarks=(*result.remarks, patience.words))
    content = document(result, posed.command_unit, posed.output_unit, posed.judged_on, structure)
    from optid.report.tuning_page import tuning_page

    with waiting("reporting"):
        page = tuning_page(result, posed, Path(model).name, structure, out, choices["rig"] or "RIG")

    files = {"report.html": page, **(_exported(result) if choices["export"] else {})}

    def write(place: Path) -> None:
        write_json(place / "pid.json", content)
        for name, text in files.items():
            (place / name).write_text(text, encoding="utf-8")

    deliver(folder, write)
    _say(result, posed, structure)
    click.echo(f"written to {out}: {', '.join(['pid.json', *files])}")
    if patience.interrupted:
        raise JobError(f"interrupted: the best gains so far are in {out}")


class _Patience:
    """Ends a search at its time, or at the first Ctrl-C, so that the best so far is kept; the second one ends all.

    Args:
        processor: s of the process's own time, so that other work on the machine changes no answer.
        clock: s by the clock.
    """

    def __init__(self, processor: float | None, clock: float | None) -> None:
        self._processor, self._clock = processor or math.inf, clock or math.inf
        self._began, self.interrupted, self.words = time.monotonic(), False, ""
        self._before: Any = None

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._stop)
        return self

    def __exit__(self, *_: object) -> None:
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _stop(self, *_: object) -> None:
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True

    def over(self) -> bool:
        """Time is up, or somebody said so."""
        if self.interrupted:
            self.words = "Interrupted: these are the best gains so far."
        elif time.process_time() > self._processor or time.monotonic() - self._began > self._clock:
            self.words = "Time was up: these are the best gains so far."
        return bool(self.words)


def _present(text: str | None) -> Gains | None:
    """Gains now in force: KP,KI,KD and no more."""
    from optid.pid.controller import Gains

    if text is None:
        return None
    parts = text.split(",")
    if not 1 <= len(parts) <= 3:
        raise InputError(f'"{text}"', where="--present", expected="KP,KI,KD, as in 60,80,0.5")
    return Gains(*(_known(part.strip(), "1", "--present") for part in parts))


def _exported(tuning: Tuning) -> dict[str, str]:
    from optid.pid.export import c_header, structured_text

    controller = tuning.controller
    return {"pid.h": c_header(controller), "pid.st": structured_text(controller)}


def _options(choices: dict[str, Any], structure: Structure, effort: Effort, simulated: bool) -> Options:
    from optid.pid.controller import Gains
    from optid.tuning.optimise import Options
    from optid.tuning.structures import free_gains

    lag = _quantity(choices["derivative_filter"], "s", "--derivative-filter")
    free = free_gains(structure, simulated and lag is None)
    if choices["free"] is not None:
        free = tuple(name.strip() for name in choices["free"].split(","))
    fixed = None if lag is None else Gains(kp=1.0, derivative_filter=lag)
    return Options(free, fixed, choices["starts"], cascade=structure.cascade, effort=effort)


def _wishes(choices: dict[str, Any], contents: Any) -> Wishes:
    """The options in SI."""
    from optid.pid.controller import AntiWindup
    from optid.tuning.criterion import Criterion
    from optid.tuning.integrator import Integrator
    from optid.tuning.margins import Required
    from optid.tuning.measure import Measure
    from optid.tuning.posing import Wishes, units_of
    from optid.tuning.task import Over

    u, y = units_of(contents)
    low, high = _range(choices["limits"], u, "--limits")
    wide = _range(choices["deadband"], u, "--deadband")
    dead = (0.0, 0.0, 0.0)
    if wide[0] is not None and wide[1] is not None:
        below, above = abs(wide[0]), abs(wide[1])
        dead = (below, above, 0.1 * max(below, above))
    return Wishes(
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
        over=Over.WORST if choices["robust"] == "worst" else Over.MEAN,
        scenarios=choices["scenarios"],
        integrator=Integrator[choices["integrator"].upper()],
        dead_zone=_dead_zone(choices["dead_zone"], u),
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
        raise InputError(f"{error}", where=name, expected="two columns of numbers: time (s), value") from None
    if values.ndim != 2 or values.shape[1] != 2 or len(values) < 2 or not np.isfinite(values).all():
        raise InputError(
            "not a path",
            where=name,
            expected="two columns of numbers: time (s), value",
            hint="no row may be empty",
        )
    time, wanted = values.T
    if not np.all(np.diff(time) > 0):
        raise InputError("time does not rise", where=name, field=str(table.columns[0]))
    at = time[0] + sample_time * np.arange(round((time[-1] - time[0]) / sample_time) + 1)
    return Path(name).stem, wanted[np.searchsorted(time, at + 1e-9 * sample_time, side="right") - 1]


def _say(tuning: Tuning, posed: Posed, structure: Structure) -> None:
    from optid.core.quantity import unit_name
    from optid.tuning.files import units
    from optid.tuning.score import by_size
    from optid.tuning.structures import drive_values
    from optid.tuning.tuning import compared

    for line in posed.assumed:
        click.echo(f"assumed: {line}")
    named = units(posed.command_unit, posed.output_unit)
    names = ("kp", "ki", "kd", "derivative_filter", "setpoint_weight", "derivative_weight")
    rows = [
        (n, f"{getattr(tuning.gains, n):.5g}", named[n].replace("1", "") if named[n] == "1" else named[n])
        for n in names
    ]
    say_table(("gain", "value", "unit"), rows)
    span = min(-tuning.settings.low, tuning.settings.high)
    drive = drive_values(tuning.gains, structure, span, (posed.command_unit, posed.output_unit))
    click.echo(
        f"{structure.words}: " + ", ".join(f"{name} {value:.4g} {unit}" for name, value, unit in drive)
    )
    kept = tuning.found.margins
    assert kept is not None
    click.echo(
        f"maximum sensitivity {kept.maximum_sensitivity:.3g}, gain margin {kept.gain_margin:.3g}, "
        f"phase margin {kept.phase_margin:.3g}°, delay margin {1e3 * kept.delay_margin:.3g} ms"
    )
    judged = tuning.found.bench if tuning.on_bench else tuning.found.responses
    say_table(
        (f"step ({posed.output_unit})", "ITAE / size (s²)", "overshoot", "settled (s)", "hunting"),
        [
            (
                f"{r.size:g}",
                f"{r.itae_over_size:.4g}",
                f"{100 * r.overshoot:.2g} %",
                f"{r.settling_time:.3g}" if math.isfinite(r.settling_time) else "no",
                f"{r.hunting:.2g}",
            )
            for r in by_size(judged)
        ],
    )
    on_rig = () if posed.bench is None else ("on the rig's model",)
    head: tuple[str, ...] = ("", f"ITAE ({unit_name(named['itae'])})", *on_rig, "Ms", "")
    say_table(head, [_row(one, posed) for one in (tuning.found, *compared(tuning), *tuning.baselines)])
    click.echo(f"costs stand for {posed.judged_on}")
    for remark in tuning.remarks:
        click.echo(f"  ! {remark}")


def _row(one: Scored, posed: Posed) -> tuple[str, ...]:
    name = one.name.replace("_", " ")
    dash = ("–",) * (2 if posed.bench is not None else 1)
    if one.gains is None or one.margins is None:
        return (name, *dash, "–", one.note)
    costs = [f"{one.total('itae'):.4g}"]
    if posed.bench is not None:
        costs.append(f"{one.total('itae', True):.4g}")
    if not one.stable:
        return (name, *costs, "–", "unstable: only its limits hold it")
    return (name, *costs, f"{one.margins.maximum_sensitivity:.3g}", "")
