"""`optid.simulate`: run a model along recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from optid.api.document import stamp
from optid.api.exhibit import Exhibit, about, input_table, prediction_table
from optid.api.inputs import Progress, given, of_each, rig_of, silent
from optid.api.unknowns import about_data, notes
from optid.estimation.prediction import predict
from optid.report.scores import metrics_document
from optid.results.fit import FitResult
from optid.results.simulation import SimulationResult
from optid.rigs.rigfile import Rig

if TYPE_CHECKING:
    from optid.api.inputs import Recordings


def simulate(
    rig: str | Path | Rig,
    recordings: Recordings,
    *,
    fit: FitResult | None = None,
    rate: float | None = None,
    progress: Progress = silent,
) -> SimulationResult:
    """Simulate the model along recordings, in a free run from their start and in windows of 0.5 s.

    The start state of a window is estimated from data before it.

    Parameters
    ----------
    rig : str | Path | Rig
        a rig file, or what `read_rig` made of one.
    recordings : Recordings
        a path, a DataFrame, a Recording, or a list of them.
    fit : FitResult | None
        a fit whose values replace the rig file's; then both predictions have the 95 % band that
        the parameters' covariance gives (linearised; measurement noise not counted).
    rate : float | None
        Hz to which faster recordings are decimated; by default as fast as the axis's fastest pole needs.
    progress : Progress
        called with the share done and a few words.

    Returns
    -------
    SimulationResult
        Predictions, scores and a report.

    Raises
    ------
    InputError
        an input is wrong; names file, field and what was expected.
    SolveError
        the simulation diverged (NaN or infinite).
    """
    understood = rig_of(rig)
    data, _ = given(understood, recordings, rate=rate)
    understood, (data,) = of_each(understood, data)
    values = fit.values if fit is not None else dict(understood.parameters)
    noise = fit.process_noise if fit is not None else None
    exhibits = []
    for number, one in enumerate(data):
        progress(number / len(data), f"simulating {one.recording.name}")
        prediction = predict(understood, one.recording, values, noise)
        exhibits.append(Exhibit("simulated", one.recording, prediction, one.remarks))
    table = prediction_table(exhibits).drop(columns="use")
    if fit is not None:
        from optid.api.band import with_band

        table = with_band(table, understood, [one.recording for one in data], fit, progress)
    units = {one.name: one.unit for one in understood.model.states}
    document = {
        **stamp(SimulationResult.SCHEMA, "simulate", understood, [one.recording for one in data]),
        **metrics_document([one.prediction for one in exhibits]),
        "about": {
            **about(understood, exhibits),
            "lead": "The parameters are the rig file's: nothing was fitted."
            if fit is None
            else "The parameters are those of a fit.",
            "starts": [
                {"recording": one.recording.name, "time": begin, "state": dict(state), "units": units}
                for one in exhibits
                for begin, state in one.prediction.begins
            ],
            "notes": notes(exhibits),
            "unknowns": [*notes(exhibits), *about_data(exhibits, understood)],
        },
    }
    return SimulationResult(document, {"prediction": table, "inputs": input_table(understood, exhibits)})
