"""`optid identify`: recursive ARMAX models of a recording, their audit, and the paper's Table 2."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from optid.cli.armax_options import FORGETTING, numbers, one_for_each_input
from optid.cli.common import OUT, RATE, deliver, progress, read_all, results_folder, say_next, say_table

if TYPE_CHECKING:
    from optid.armax.forgetting import Forgetting
    from optid.armax.identifier import Identifier
    from optid.armax.loop import Gains
    from optid.armax.plan import Plan
    from optid.armax.resample import Sampled
    from optid.armax.survey import Survey

MODEL_C, IDENTIFIER_C = "armax_model.h", "armax_identifier.h"
TOLD = (
    "static_gain",
    "operating_point",
    "trend",
    "noise_cancellation",
    "recursion_not_settled",
)  # besides alarms
MODEL_ST, IDENTIFIER_ST = "armax_model.st", "armax_identifier.st"


def _gains(context: click.Context, option: click.Parameter, value: str | None) -> Gains | None:
    """Read "16,6,0.001": KP,KI,KD as in pid.json, the latter two optional."""
    from optid.armax.loop import Gains

    if value is None:
        return None
    try:
        numbers = [float(part) for part in value.split(",")]
    except ValueError:
        numbers = []
    if not 1 <= len(numbers) <= 3 or not all(map(math.isfinite, numbers)):
        raise click.BadParameter(f'"{value}": expected KP,KI,KD, as in 16,6,0.001', context, option)
    return Gains(*numbers)


@click.command()
@click.argument("recording")
@click.option("--rig", required=True, metavar="RIG", help="Rig file; its [channels] table names the columns.")
@click.option(
    "--orders",
    callback=numbers,
    default="3,4,5",
    metavar="N,N",
    help="Model orders na = nb = nc; 3,4,5 by default.",
)
@click.option(
    "--steps",
    callback=numbers,
    default="1,5,10",
    metavar="K,K",
    help="Prediction horizons in samples; 1,5,10 by default.",
)
@click.option(
    "--na",
    type=click.IntRange(1, 400),
    metavar="N",
    help="Number of coefficients of A: one model of this structure, instead of --orders.",
)
@click.option(
    "--nb",
    callback=one_for_each_input(1),
    metavar="N[,N]",
    help="Number of coefficients of B, one for each input; na by default.",
)
@click.option(
    "--nc",
    type=click.IntRange(0, 400),
    metavar="N",
    help="Number of coefficients of C; na by default, 0 gives an ARX model.",
)
@click.option(
    "--delay",
    callback=one_for_each_input(0),
    metavar="NK[,NK]",
    help="Delay in samples, one for each input; chosen from the data by default.",
)
@click.option(
    "--method",
    type=click.Choice(["pem", "rml", "rls"]),
    default="pem",
    show_default=True,
    help="Estimator of the models and the table: offline prediction error method, recursive maximum "
    "likelihood, or the paper's recursive least squares.",
)
@FORGETTING
@click.option(
    "--trend",
    type=click.Choice(["auto", "none", "constant", "linear"]),
    default="auto",
    show_default=True,
    help="Terms added to eq. 12; auto: a constant, and a slope where the recording shows one.",
)
@click.option(
    "--input",
    "inputs",
    multiple=True,
    metavar="ROLE",
    help="Input channel; the plant's inputs by default; may be repeated.",
)
@click.option(
    "--output", metavar="ROLE", help="Output channel; the plant's first measured output by default."
)
@click.option(
    "--gains", callback=_gains, metavar="KP,KI,KD", help="PID gains to test: do they stabilise the models?"
)
@click.option(
    "--export-c", is_flag=True, help="Write the recommended model and its recursive identifier as C headers."
)
@click.option("--export-st", is_flag=True, help="Write both as IEC 61131-3 structured text.")
@RATE
@OUT
def identify(
    recording: str,
    rig: str,
    out: str,
    inputs: tuple[str, ...],
    output: str | None,
    export_c: bool,
    export_st: bool,
    **asked: Any,
) -> None:
    """Identify ARMAX models, check them, and tabulate their prediction errors as in the paper's Table 2."""
    folder = results_folder(out)
    understood, [(read, remarks)], _ = read_all(rig, (recording,))

    from optid.api.identifying import sampled_of
    from optid.armax.files import from_survey, to_json
    from optid.armax.sliding import axis_shown
    from optid.armax.survey import survey
    from optid.report.armax_page import Source, armax_page

    sampled = sampled_of(understood, read, inputs, output)
    plan = replace(
        _plan(**asked),
        unit=sampled.output_unit,
        output=sampled.output,
        input=", ".join(sampled.inputs),
        input_unit=", ".join(sampled.input_units),
    )
    with progress("identifying") as tell:
        found = survey(sampled.signals.y, sampled.signals.u, sampled.sample_time, plan, tell)
        tell(0.95, "report")
        page = armax_page(found, sampled, Source(understood, read, remarks), out)
    contents = from_survey(found, axis_shown(sampled.signals, found.chosen.model))
    files = {"armax.json": to_json(contents), "table2.csv": found.table2.csv(), "report.html": page}
    if export_c:
        files |= _headers(found, sampled)
    if export_st:
        files |= _structured_text(found, sampled)

    def write(place: Path) -> None:
        for name, content in files.items():
            (place / name).write_text(content, encoding="utf-8")

    deliver(folder, write)
    _say(found)
    click.echo(f"written to {out}: {', '.join(files)}")
    say_next("tune", f"{out}/armax.json", "--rig", rig, "--out", "DIR")


def _plan(
    *,
    orders: tuple[int, ...],
    steps: tuple[int, ...],
    na: int | None,
    nb: tuple[int, ...] | None,
    nc: int | None,
    delay: tuple[int, ...] | None,
    method: str,
    forgetting: Forgetting | None,
    trend: str,
    gains: Gains | None,
) -> Plan:
    """The survey's plan from the options."""
    from optid.armax.plan import Estimator, Plan
    from optid.armax.trend import Trend

    def one(each: tuple[int, ...] | None) -> int | tuple[int, ...] | None:
        return each[0] if each is not None and len(each) == 1 else each

    plan = Plan(
        orders=orders if na is None else (na,),
        steps=steps,
        delay=one(delay),
        nb=one(nb),
        nc=nc,
        exact=na is not None,
        gains=gains,
        estimator=Estimator[method.upper()],
        trend=None if trend == "auto" else Trend[trend.upper()],
    )
    return plan if forgetting is None else replace(plan, forgetting=forgetting)


def _headers(found: Survey, sampled: Sampled) -> dict[str, str]:
    """The recommended model, and an identifier that continues from the end of the recording, in C."""
    from optid.armax.export_c import identifier_header, model_header

    identifier, constant = _going_on(found, sampled)
    return {
        MODEL_C: model_header(found.chosen.model, "armax_model"),
        IDENTIFIER_C: identifier_header(identifier, "armax_identifier", constant=constant),
    }


def _structured_text(found: Survey, sampled: Sampled) -> dict[str, str]:
    """The same as structured text."""
    from optid.armax.export_st import identifier_block, model_block

    identifier, constant = _going_on(found, sampled)
    return {
        MODEL_ST: model_block(found.chosen.model, "armax_model"),
        IDENTIFIER_ST: identifier_block(identifier, "armax_identifier", constant=constant),
    }


def _going_on(found: Survey, sampled: Sampled) -> tuple[Identifier, bool]:
    """An identifier at the end of the recording, and whether its last input is a constant of 1."""
    from optid.armax.survey import going_on

    return going_on(found, sampled.signals)


def _say(found: Survey) -> None:
    from optid.armax.table2 import HELD_OUT, IN_SAMPLE

    click.echo(f"{found.output} from {found.input}: {found.words}")
    click.echo(f"order {found.recommended}: {found.chosen.model}")
    click.echo(f"estimator: {found.estimator.value}")
    unit, held = found.table2.unit, {_key(row): row for row in found.table2.errors(HELD_OUT)}
    rows = []
    for row in found.table2.errors(IN_SAMPLE):
        other = held.get(_key(row), {})
        rows.append(
            (
                str(row["order"]) if row["order"] else "-",
                str(row["steps"]),
                str(row["predictor"]),
                *(_cell(one, column) for column in ("mean_square_error", "sd") for one in (row, other)),
                _cell(row, "lag"),
                _cell(row, "expected_sd"),
            )
        )
    head = (
        "order",
        "steps",
        "predictor",
        f"mean square error ({unit}²)",
        "held out",
        f"sd ({unit})",
        "held out",
        "lag",
        "expected sd",
    )
    say_table(head, rows)
    for candidate in found.candidates:
        grave = [finding.text for finding in candidate.audit.findings if finding.grave]
        told = [f.text for f in candidate.audit.findings if f.name in TOLD and not f.grave]
        click.echo(f"order {candidate.order}: {'no alarm' if not grave else ''}".rstrip())
        for text in grave:
            click.echo(f"  ! {text}")
        for text in told:
            click.echo(f"    {text}")


def _key(row: dict[str, object]) -> tuple[object, ...]:
    return row["order"], row["steps"], row["predictor"]


def _cell(row: dict[str, object], column: str) -> str:
    value = row.get(column)
    if not isinstance(value, float) or math.isnan(value):
        return ""
    return f"{value:.2f}" if column == "lag" else f"{value:.4g}"
