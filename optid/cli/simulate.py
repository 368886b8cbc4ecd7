"""`optid simulate`: run the model along a recording."""

from __future__ import annotations

from pathlib import Path

import click

from optid.cli.common import OUT, RATE, deliver, read_all, results_folder, say_scores, waiting, write_json


@click.command()
@click.argument("rig")
@click.argument("recording")
@RATE
@OUT
def simulate(rig: str, recording: str, out: str) -> None:
    """Run the model along a recording, with the rig file's numbers."""
    folder = results_folder(out)
    understood, [(read, remarks)], _ = read_all(rig, (recording,))

    from optid.estimation.prediction import predict
    from optid.report.page import Exhibit, simulation_page
    from optid.report.scores import metrics_document

    with waiting("simulating"):
        prediction = predict(understood, read, understood.parameters)
        page = simulation_page(understood, Exhibit("simulated", read, prediction, remarks))
    metrics = metrics_document(prediction)

    def write(place: Path) -> None:
        prediction.frame.to_csv(place / "prediction.csv", index=False)
        write_json(place / "metrics.json", metrics)
        (place / "report.html").write_text(page, encoding="utf-8")

    deliver(folder, write)
    for kind, words in (("window", f"{prediction.horizon:g} s windows"), ("free_run", "free run")):
        say_scores(words, {role: kinds[kind] for role, kinds in metrics.items()})
    for begin, state in prediction.begins:
        where = ", ".join(f"{name} {value:.5g}" for name, value in state.items())
        click.echo(f"  free run from {begin:.6g} s, start estimated: {where} (SI)")
    for note in prediction.notes:
        click.echo(f"  {note}")
    click.echo(f"written to {out}: prediction.csv, metrics.json, report.html")
