"""`optid identify`: recursive ARMAX models of a recording, their audit, and the paper's Table 2."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from optid.cli.common import OUT, RATE, deliver, read_all, results_folder, say_table, waiting
from optid.errors import NotIdentifiable

if TYPE_CHECKING:
    from optid.armax.loop import Gains
    from optid.armax.sampled import Sampled
    from optid.armax.survey import Survey
    from optid.core.recording import Recording
    from optid.rigs.rigfile import Rig

MODEL_C, IDENTIFIER_C = "armax_model.h", "armax_identifier.h"


def _numbers(context: click.Context, option: click.Parameter, value: str) -> tuple[int, ...]:
    """Read "3,4,5": whole numbers of at least 1, each once."""
    try:
        numbers = tuple(dict.fromkeys(int(part) for part in value.split(",")))
    except ValueError:
        numbers = ()
    if not numbers or min(numbers) < 1:
        raise click.BadParameter(
            f'"{value}": expected whole numbers of at least 1, as in 3,4,5', context, option
        )
    return numbers


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
@click.option("--rig", required=True, metavar="RIG", help="Rig file: says which column is what.")
@click.option(
    "--orders", callback=_numbers, default="3,4,5", metavar="N,N", help="na = nb = nc; 3,4,5 by default."
)
@click.option(
    "--steps", callback=_numbers, default="1,5,10", metavar="K,K", help="Horizons; 1,5,10 by default."
)
@click.option(
    "--delay", type=click.IntRange(0, 10_000), metavar="NK", help="Samples; chosen by BIC if absent."
)
@click.option(
    "--input", "inputs", multiple=True, metavar="ROLE", help="The plant's by default; may be repeated."
)
@click.option("--output", metavar="ROLE", help="The plant's first measured one by default.")
@click.option("--gains", callback=_gains, metavar="KP,KI,KD", help="Say whether these stabilise the models.")
@click.option("--export-c", is_flag=True, help="Write the recommended model and its identifier as C headers.")
@RATE
@OUT
def identify(
    recording: str, rig: str, out: str, inputs: tuple[str, ...], output: str | None, export_c: bool,
    orders: tuple[int, ...], steps: tuple[int, ...], delay: int | None, gains: Gains | None,
) -> None:  # fmt: skip
    """Identify ARMAX models recursively, audit them, and tabulate their predictions as the paper's Table 2."""
    folder = results_folder(out)
    understood, [(read, remarks)], _ = read_all(rig, (recording,))

    from optid.armax.files import from_survey, to_json
    from optid.armax.survey import Plan, survey
    from optid.report.armax_page import Source, armax_page

    sampled = _sampled(understood, read, inputs, output)
    plan = Plan(
        orders=orders, steps=steps, delay=delay, gains=gains, unit=sampled.output_unit, output=sampled.output,
        input=", ".join(sampled.inputs), input_unit=", ".join(sampled.input_units),
    )  # fmt: skip
    with waiting("identifying"):
        found = survey(sampled.signals.y, sampled.signals.u, sampled.sample_time, plan)
        page = armax_page(found, sampled, Source(understood, read, remarks))
    files = {"armax.json": to_json(from_survey(found)), "table2.csv": found.table2.csv(), "report.html": page}
    if export_c:
        files |= _headers(found)

    def write(place: Path) -> None:
        for name, content in files.items():
            (place / name).write_text(content, encoding="utf-8")

    deliver(folder, write)
    _say(found)
    click.echo(f"written to {out}: {', '.join(files)}")


def _sampled(rig: Rig, recording: Recording, inputs: tuple[str, ...], output: str | None) -> Sampled:
    """The channels to identify between, on an even grid, once they hold anything to learn from."""
    import numpy as np

    from optid.armax.sampled import evenly

    outputs = [port.role for port in rig.model.outputs if port.role in recording]
    sampled = evenly(
        recording, output or outputs[0], inputs or tuple(port.role for port in rig.model.recorded)
    )
    columns = np.column_stack([sampled.signals.y, sampled.signals.u])
    for role, column in zip((sampled.output, *sampled.inputs), columns.T, strict=True):
        known = column[np.isfinite(column)]
        if known.size == 0 or np.ptp(known) == 0.0:
            raise NotIdentifiable(
                f"{recording.name}: {role} never changes: it teaches nothing (nothing was written)"
            )
    return sampled


def _headers(found: Survey) -> dict[str, str]:
    """The recommended model, and an identifier that goes on from the end of the recording, in C."""
    from optid.armax.export_c import identifier_header, model_header
    from optid.armax.identifier import Identifier

    model = found.chosen.model
    identifier = Identifier(model.orders, model.sample_time).restored(found.chosen.recursive.state)
    identifier.start_at(model.theta)
    return {
        MODEL_C: model_header(model, "armax_model"),
        IDENTIFIER_C: identifier_header(identifier, "armax_identifier"),
    }


def _say(found: Survey) -> None:
    click.echo(f"{found.output} from {found.input}: {found.words}")
    click.echo(f"order {found.recommended}: {found.chosen.model}")
    unit = found.table2.unit
    rows = [
        (str(row["order"]), str(row["steps"]), *(f"{row[c]:.4g}" for c in ("mean_square_error", "sd", "max", "min")))
        for row in found.table2.rows
        if row["signal"] == "error"
    ]  # fmt: skip
    say_table(("order", "steps", f"mean square error ({unit}²)", f"sd ({unit})", "max", "min"), rows)
    for candidate in found.candidates:
        grave = [finding.text for finding in candidate.audit.findings if finding.grave]
        click.echo(f"order {candidate.order}: {'no alarm' if not grave else ''}".rstrip())
        for text in grave:
            click.echo(f"  ! {text}")
