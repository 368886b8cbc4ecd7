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

from optid.cli.common import OUT, deliver, progress, results_folder, say_next, say_table, waiting, write_json
from optid.cli.tune_options import RangeCommand, present_gains, search_options, specification
from optid.errors import JobError, SolveError

if TYPE_CHECKING:
    from optid.tuning.problem import TuningProblem
    from optid.tuning.structures import Structure
    from optid.tuning.tuning import Scored, Tuning


@click.command(cls=RangeCommand)
@click.argument("model", metavar="MODEL.json")
@OUT
@click.option(
    "--setpoint",
    "setpoints",
    multiple=True,
    metavar="SIZE",
    help='Largest step, as in "6 cm"; smaller steps and both directions are added. May be repeated.',
)
@click.option(
    "--profile", "profiles", multiple=True, metavar="CSV", help="Set-point profile: columns time and value."
)
@click.option(
    "--disturbance",
    "disturbances",
    multiple=True,
    metavar="SIZE",
    help="Size of a load step, added to the command.",
)
@click.option(
    "--limits",
    metavar="LOW,HIGH",
    help='Limits of the command: "-5,5", "-5 V, 5 V", or one value for both sides.',
)
@click.option("--rate", metavar="RATE", help="Largest change of the command per second.")
@click.option("--resolution", metavar="STEP", help="Smallest step of the command.")
@click.option(
    "--deadband",
    metavar="LOW,HIGH",
    help="Widths of the valve's dead band that the controller jumps over, both positive.",
)
@click.option(
    "--anti-windup",
    type=click.Choice(["clamping", "back-calculation", "none"]),
    default="clamping",
    show_default=True,
    help="What the integral does while the command is at a limit.",
)
@click.option(
    "--order",
    type=int,
    metavar="NA",
    help="Order of the model in MODEL.json; the recommended one by default.",
)
@click.option("--horizon", metavar="S", help="Duration of each simulated step or profile.")
@click.option("--sample-time", metavar="S", help="Sampling interval of the controller: must be the model's.")
@click.option(
    "--cost",
    type=click.Choice(["itae", "iae", "itse", "ise"]),
    default="itae",
    show_default=True,
    help="Integral criterion that is minimised.",
)
@click.option(
    "--effort",
    type=float,
    default=0.0,
    metavar="W",
    help="Weight of the command's total variation in the cost.",
)
@click.option(
    "--overshoot", type=float, default=0.0, metavar="W", help="Weight of the overshoot in the cost."
)
@click.option(
    "--ms",
    metavar="MS",
    help="Largest maximum sensitivity on MODEL; by default 2, 5 where friction is assumed, none with --rig.",
)
@click.option("--gain-margin", type=float, metavar="FACTOR", help="Smallest gain margin.")
@click.option("--phase-margin", type=float, metavar="DEG", help="Smallest phase margin, degrees.")
@click.option("--delay-margin", metavar="S", help="Smallest delay margin.")
@click.option("--present", metavar="KP,KI,KD", help="Gains in use today (SI, as in pid.json), as a baseline.")
@click.option(
    "--structure", metavar="NAME", help="pid, pid2, pd, pi, p, or p-pi: P position over PI velocity."
)
@click.option(
    "--notch",
    metavar="HZ[,WIDTH[,DEPTH]]",
    help="Notch filter on the command; by default a third of HZ wide, and of full depth.",
)
@click.option(
    "--acceleration", metavar="GAIN", help="Feed-forward gain: command per acceleration of the set-point."
)
@click.option(
    "--compensate", is_flag=True, help="Let the controller compensate friction and dead band of RIG's model."
)
@click.option("--free", metavar="NAMES", help="Gains to optimise, as in kp,ki; the structure's by default.")
@click.option(
    "--integrator",
    type=click.Choice(["auto", "yes", "no"]),
    default="auto",
    show_default=True,
    help="Replace the model's pole nearest to 1 by an exact integrator.",
)
@click.option(
    "--dead-zone", metavar="LOW,HIGH", help="Widths of the valve's dead zone in the plant, both positive."
)
@click.option(
    "--time-limit",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Processor time after which the best gains so far are kept.",
)
@click.option(
    "--deadline",
    type=click.FloatRange(min=0, min_open=True),
    metavar="S",
    help="Wall-clock time after which the best gains so far are kept.",
)
@click.option("--derivative-filter", metavar="S", help="Time constant of the filter on the derivative.")
@click.option(
    "--scenarios",
    type=click.IntRange(1, 1000),
    default=1,
    help="Number of plants drawn from the model's covariance.",
)
@click.option(
    "--robust",
    type=click.Choice(["worst", "mean"]),
    default="worst",
    help="Minimise the worst or the mean cost over the scenarios.",
)
@click.option(
    "--rig",
    metavar="RIG",
    help="Rig file of the axis: its physical model is used for tuning and for the test.",
)
@click.option("--check-only", is_flag=True, help="Test the gains on the rig's model, but do not tune for it.")
@click.option(
    "--starts",
    type=click.IntRange(1, 100),
    default=4,
    show_default=True,
    help="Number of independent searches.",
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of all random numbers."
)
@click.option(
    "--export", is_flag=True, help="Also write the controller as C (pid.h) and structured text (pid.st)."
)
def tune(model: str, out: str, **choices: Any) -> None:
    """Find PID gains for an identified model (armax.json) by optimising the closed loop."""
    folder = results_folder(out)

    import numpy as np

    from optid.armax.files import load
    from optid.rigs.rigfile import read_rig
    from optid.tuning.bench_search import Effort
    from optid.tuning.compensation import compensated
    from optid.tuning.files import document
    from optid.tuning.problem import build_problem
    from optid.tuning.structures import structure_of
    from optid.tuning.tuning import tune as tuned

    contents = load(Path(model))
    rig = None if choices["rig"] is None else read_rig(choices["rig"])
    rng = np.random.default_rng(choices["seed"])
    spec = specification(choices, contents)
    problem = build_problem(contents, Path(model), spec, rng, rig, not choices["check_only"])
    structure = structure_of(choices["structure"] or problem.structure)
    present = present_gains(choices["present"])
    patience = _Patience(choices["time_limit"], choices["deadline"])
    with progress("tuning") as show, patience:
        options = search_options(choices, structure, Effort(show, patience.over), problem.task.bench_alone)
        try:
            result = tuned(problem.task, rng, options, problem.bench, present)
        except SolveError:
            if choices["ms"] is not None:
                raise
            problem = problem.without_sensitivity()
            result = tuned(problem.task, rng, options, problem.bench, present)
    if choices["compensate"] and rig is not None:
        result = compensated(result, rig, contents.output)
    if patience.words:
        result = replace(result, remarks=(*result.remarks, patience.words))
    content = document(result, problem.command_unit, problem.output_unit, problem.judged_on, structure)
    from optid.report.tuning_page import tuning_page

    with waiting("reporting"):
        page = tuning_page(result, problem, Path(model).name, structure, out, choices["rig"] or "RIG")

    files = {"report.html": page, **(_exported(result) if choices["export"] else {})}

    def write(place: Path) -> None:
        write_json(place / "pid.json", content)
        for name, text in files.items():
            (place / name).write_text(text, encoding="utf-8")

    deliver(folder, write)
    _say(result, problem, structure)
    click.echo(f"written to {out}: {', '.join(['pid.json', *files])}")
    gains = ("--gains", f"{out}/pid.json", "--out", "DIR")
    say_next("live", choices["rig"] or "RIG", "--driver", "simulated", *gains)
    if patience.interrupted:
        raise JobError(f"interrupted: the best gains so far are in {out}")


class _Patience:
    """Ends a search at its time limit or at the first Ctrl-C and keeps the best so far; a second Ctrl-C aborts.

    Args:
        processor: s of the process's own time, so that other work on the machine changes no answer.
        clock: s of wall-clock time.
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
        """Whether the time limit is reached or the search was interrupted."""
        if self.interrupted:
            self.words = "Interrupted: these are the best gains so far."
        elif time.process_time() > self._processor or time.monotonic() - self._began > self._clock:
            self.words = "The time limit was reached: these are the best gains so far."
        return bool(self.words)


def _exported(tuning: Tuning) -> dict[str, str]:
    from optid.pid.export import c_header, structured_text

    controller = tuning.controller
    return {"pid.h": c_header(controller), "pid.st": structured_text(controller)}


def _say(tuning: Tuning, problem: TuningProblem, structure: Structure) -> None:
    from optid.core.quantity import unit_name
    from optid.tuning.files import units
    from optid.tuning.response_metrics import by_size
    from optid.tuning.structures import drive_values
    from optid.tuning.tuning import compared

    for line in problem.assumed:
        click.echo(f"assumed: {line}")
    named = units(problem.command_unit, problem.output_unit)
    names = ("kp", "ki", "kd", "derivative_filter", "setpoint_weight", "derivative_weight")
    rows = [
        (n, f"{getattr(tuning.gains, n):.5g}", named[n].replace("1", "") if named[n] == "1" else named[n])
        for n in names
    ]
    say_table(("gain", "value", "unit"), rows)
    span = min(-tuning.settings.low, tuning.settings.high)
    drive = drive_values(tuning.gains, structure, span, (problem.command_unit, problem.output_unit))
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
        (f"step ({problem.output_unit})", "ITAE / size (s²)", "overshoot", "settled (s)", "hunting"),
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
    on_rig = () if problem.bench is None else ("on the rig's model",)
    head: tuple[str, ...] = ("", f"ITAE ({unit_name(named['itae'])})", *on_rig, "Ms", "")
    say_table(head, [_row(one, problem) for one in (tuning.found, *compared(tuning), *tuning.baselines)])
    click.echo(f"the costs were computed on {problem.judged_on}")
    for remark in tuning.remarks:
        click.echo(f"  ! {remark}")


def _row(one: Scored, problem: TuningProblem) -> tuple[str, ...]:
    name = one.name.replace("_", " ")
    dash = ("–",) * (2 if problem.bench is not None else 1)
    if one.gains is None or one.margins is None:
        return (name, *dash, "–", one.note)
    costs = [f"{one.total('itae'):.4g}"]
    if problem.bench is not None:
        costs.append(f"{one.total('itae', True):.4g}")
    if not one.stable:
        return (name, *costs, "–", "unstable: only the limits of the command hold it")
    return (name, *costs, f"{one.margins.maximum_sensitivity:.3g}", "")
