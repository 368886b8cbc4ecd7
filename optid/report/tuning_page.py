"""The page of a tuning: gains, responses of the loop, its margins, baselines, and what remains unknown."""

from __future__ import annotations

import math
from typing import Any

from markupsafe import Markup

from optid.core.quantity import quantity
from optid.report import tuning_figures as figures
from optid.report.shell import render
from optid.tuning.files import units
from optid.tuning.judges import FITTED
from optid.tuning.problem import TuningProblem
from optid.tuning.response_metrics import Response, by_size
from optid.tuning.structures import STRUCTURES, Structure, drive_values
from optid.tuning.tuning import Scored, Tuning, compared

_RIVALS = (
    "ziegler_nichols_ultimate",
    "amigo",
    "paper",
)  # baselines drawn with the tuned response, where they are bounded
DRAWN = 2  # of the largest steps; and the smallest one
_NAMES = {
    "kp": "proportional",
    "ki": "integral",
    "kd": "derivative",
    "derivative_filter": "derivative filter",
    "setpoint_weight": "set-point weight",
    "derivative_weight": "derivative weight",
}


def tuning_page(
    tuning: Tuning,
    problem: TuningProblem,
    source: str,
    structure: Structure = STRUCTURES["pid2"],
    folder: str = "out/tune",
    rig: str = "RIG",
) -> str:
    """The report of `optid tune`.

    Args:
        tuning: to report.
        problem: requirements and assumptions.
        source: name of the model's file.
        structure: of the controller.
        folder: where the gains are written, for the next command; `rig` is that command's rig file.
    """
    named = units(problem.command_unit, problem.output_unit)
    return render(
        "tuning.html.j2",
        title=f"PID gains for {source}",
        model=str(problem.model),
        lead=_lead(tuning, problem, named["itae"]),
        assumed=problem.assumed,
        remarks=tuning.remarks,
        structure=structure.words,
        judged_on=problem.judged_on,
        drive=_drive(tuning, problem, structure),
        sizes=_sizes(tuning, problem),
        hunting_limit=_length(tuning.task.hunting, problem),
        sizes_figure=_sizes_figure(tuning, problem),
        gains=[
            (
                label,
                name,
                f"{getattr(tuning.gains, name):.6g}",
                "" if named[name] == "1" else named[name],
                "searched" if name in tuning.within.free else "fixed",
            )
            for name, label in _NAMES.items()
        ],
        episodes=_episodes(tuning, problem),
        margins=_margins(tuning),
        loop_figure=Markup(figures.loop(tuning)),
        bode_figure=Markup(figures.bode(tuning)),
        rows=[_row(one, problem.bench is not None) for one in _everyone(tuning)],
        bench=problem.bench is not None,
        unit=named["itae"],
        landscape=_landscape(tuning),
        certificate=tuning.certificate,
        limits=_limits(tuning),
        unknowns=_unknowns(tuning, problem),
        next_command=f"optid live {rig} --driver simulated --gains {folder}/pid.json --out out/live",
    )


def _everyone(tuning: Tuning) -> list[Scored]:
    return [tuning.found, *compared(tuning), *tuning.baselines]


def _lead(tuning: Tuning, problem: TuningProblem, unit: str) -> str:
    on = tuning.on_bench
    own = tuning.found.total("itae", on)
    rivals = [one for one in tuning.baselines if one.stable and math.isfinite(one.total("itae", on))]
    said = f"ITAE on {problem.judged_on}, mean over all steps, scaled to one size: {own:.4g} {unit}"
    if rivals:
        best = min(rivals, key=lambda one: one.total("itae", on))
        times = best.total("itae", on) / own
        said += f"; with the best baseline ({best.name.replace('_', ' ')}) it is {times:.3g} times that"
    if problem.bench is not None and not on:
        said += f". On the rig's physical model: {tuning.found.total('itae', True):.4g} {unit}"
    return said + "."


def _episodes(tuning: Tuning, problem: TuningProblem) -> list[dict[str, Any]]:
    """Pictures of some steps: on the plant that judged first; of a loop that only friction holds, none without it."""
    rivals = [one for one in tuning.baselines if one.name in _RIVALS and one.gains is not None]
    pair, found = (problem.output_unit, problem.command_unit), []
    on = tuning.on_bench
    model = "the identified model" if on else problem.judged_on
    plants = {False: model, True: "the rig's physical model, with friction and all its nonlinearities"}
    drawn = [
        bench for bench in (on, not on) if (problem.bench is not None if bench else _is_worth_drawing(tuning))
    ]
    for number, run in _shown(tuning):
        pictures = []
        for bench in drawn:
            own = (tuning.found.bench if bench else tuning.found.responses)[number]
            figure = figures.responses(tuning, _bounded(rivals, number, bench), number, pair, bench)
            said = f"On {plants[bench]}: {_facts(own)}. The legend gives each ITAE."
            pictures.append((said, Markup(figure)))
        unit = problem.output_unit if run.episode.size else problem.command_unit
        found.append({"name": f"{run.episode.name} {unit}", "pictures": pictures})
    return found


def _is_worth_drawing(tuning: Tuning) -> bool:
    """Whether the loop holds on the model that its responses are of."""
    return tuning.found.stable or not tuning.on_bench


def _drive(tuning: Tuning, problem: TuningProblem, structure: Structure) -> list[tuple[str, str, str]]:
    span = min(-tuning.settings.low, tuning.settings.high)
    values = drive_values(tuning.gains, structure, span, (problem.command_unit, problem.output_unit))
    return [(name, f"{value:.4g}", unit) for name, value, unit in values]


def _length(value: float, problem: TuningProblem) -> str:
    """A length in a readable unit; empty where it is infinite."""
    return quantity(value, problem.output_unit) if math.isfinite(value) else ""


def _judged(tuning: Tuning) -> tuple[Response, ...]:
    return tuning.found.bench if tuning.on_bench else tuning.found.responses


def _sizes(tuning: Tuning, problem: TuningProblem) -> list[tuple[str, ...]]:
    return [
        (
            _length(row.size, problem),
            f"{row.itae_over_size:.4g}",
            f"{100.0 * row.overshoot:.2g} %",
            f"{row.settling_time:.3g}" if math.isfinite(row.settling_time) else "not in all runs",
            _length(row.hunting, problem),
        )
        for row in by_size(_judged(tuning))
    ]


def _sizes_figure(tuning: Tuning, problem: TuningProblem) -> Markup | None:
    rivals = [one for one in tuning.baselines if one.name in ("present", *_RIVALS) and one.gains is not None]
    rows = len(by_size(_judged(tuning)))
    return Markup(figures.over_sizes(tuning, rivals, problem.output_unit)) if rows > 1 else None


def _shown(tuning: Tuning) -> list[tuple[int, Response]]:
    """Numbers and runs to draw: of the runs without noise the first of the largest and smallest steps."""
    quiet = [(n, run) for n, run in enumerate(tuning.found.responses) if run.episode.run <= 0]
    steps = sorted((one for one in quiet if one[1].episode.size), key=lambda one: -one[1].episode.size)
    others = [one for one in quiet if not one[1].episode.size]
    return [*steps[:DRAWN], *([steps[-1]] if len(steps) > DRAWN else []), *others]


def _bounded(rivals: list[Scored], number: int, bench: bool) -> list[Scored]:
    return [one for one in rivals if (one.bench if bench else one.responses)[number].bounded]


def _facts(run: Any) -> str:
    settled = f"settled within 2 % after {run.settled:.3g} s" if math.isfinite(run.settled) else "not settled"
    said = [f"overshoot {100 * run.overshoot:.2g} %", settled] if run.episode.rise[-1] else []
    low, high = float(run.command.min()), float(run.command.max())
    return "; ".join([*said, f"command {low:.4g} to {high:.4g}", f"its travel {run.travel:.3g}"])


def _margins(tuning: Tuning) -> list[tuple[str, str, str]]:
    m, asked = tuning.found.margins, tuning.task.required
    assert m is not None

    def wish(value: float | None, words: str) -> str:
        return "" if value is None else f"{words} {value:g} required"

    lower = f" (and down to {m.gain_reduction:.2g})" if m.gain_reduction > 0.0 else ""
    return [
        (
            "maximum sensitivity Ms",
            f"{m.maximum_sensitivity:.4g}",
            wish(asked.maximum_sensitivity, "at most"),
        ),
        ("gain margin", f"{m.gain_margin:.4g}{lower}", wish(asked.gain_margin, "at least")),
        ("phase margin", f"{m.phase_margin:.4g}°", wish(asked.phase_margin, "at least")),
        ("delay margin", f"{1e3 * m.delay_margin:.4g} ms", wish(asked.delay_margin, "at least (s)")),
        ("highest crossover", f"{m.crossover:.4g} rad/s", ""),
    ]


def _row(one: Scored, bench: bool) -> dict[str, str]:
    def number(value: float) -> str:
        return f"{value:.4g}" if math.isfinite(value) else "∞"

    if one.gains is None or one.margins is None:
        return {
            "name": one.name.replace("_", " "),
            "model": "–",
            "bench": "–",
            "ms": "–",
            "gains": "–",
            "state": "",
            "note": one.note,
        }
    return {
        "name": one.name.replace("_", " "),
        "model": number(one.total("itae")),
        "bench": number(one.total("itae", True)) if bench else "",
        "ms": number(one.margins.maximum_sensitivity) if one.stable else "–",
        "gains": f"{one.gains.kp:.4g}, {one.gains.ki:.4g}, {one.gains.kd:.4g}",
        "state": "" if one.stable else "unstable on the linear model",
        "note": one.note,
    }


def _landscape(tuning: Tuning) -> Markup | None:
    free = [name for name in tuning.within.free if name != "derivative_filter"]
    most = 1 if tuning.task.bench_alone else 2
    pairs = [pair for pair in (("kp", "kd"), ("kp", "ki"), ("ki", "kd")) if set(pair) <= set(free)][:most]
    return Markup(figures.landscape(tuning, pairs)) if pairs else None


def _limits(tuning: Tuning) -> str:
    if tuning.unaware is None:
        return ""
    own, other = tuning.aware.total("itae"), tuning.unaware.total("itae")
    said = (
        "On the identified model, a tuning without limits chooses gains whose ITAE under the limits is "
        f"{other:.4g}; one with them, {own:.4g}: "
    )
    if not math.isfinite(other):
        return said + "the former is unstable."
    gain = 100.0 * (1.0 - own / other)
    return said + (f"{gain:.3g} % less." if gain >= 0.05 else "here the limits make no difference.")


def _unknowns(tuning: Tuning, problem: TuningProblem) -> list[str]:
    said = []
    if problem.judged_on == FITTED:
        said.append(
            "Nonlinearities other than dry friction, break-away, load and dead zone, which the recording shows: "
            "with --rig the gains are tuned for the rig's physical model."
        )
    elif problem.bench is None:
        said.append(
            "Friction, dead band and all other nonlinearities: the identified model is linear. With --rig the gains "
            "are tested on the rig's physical model and tuned for it."
        )
    if len(tuning.task.plants) == 1:
        said.append(
            "How the gains perform when the model's coefficients are slightly wrong: --scenarios tunes for a set of "
            "plants "
            "drawn from their covariance."
        )
    if not any(e.load.any() for e in tuning.task.episodes):
        said.append("How a load is rejected: none was given (--disturbance).")
    if tuning.task.required.maximum_sensitivity is None:
        said.append(
            "Whether the margins are sufficient for your axis: none was required (--ms, --phase-margin, ...)."
        )
    return said
