"""What a fit or a simulation does not know, in sentences."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from optid.api.exhibit import Exhibit
from optid.core.quantity import friendly, plain
from optid.estimation.result import Fit
from optid.report.residuals import autocorrelation, residual
from optid.rigs.per_recording import measured_inputs
from optid.rigs.rigfile import Rig

WHITE = 0.1  # share of lags outside the 95 % band above which residuals count as coloured


def about_fit(fit: Fit, asked: Sequence[str], exhibits: Sequence[Exhibit]) -> list[str]:
    """Outcome, bounds, parameters that cannot be separated, and whether anything was held out.

    Parameters
    ----------
    fit : Fit
        as found.
    asked : Sequence[str]
        names of the parameters that the rig file fits; other settings of the equations are not reported.
    exhibits : Sequence[Exhibit]
        recordings with their predictions.
    """
    said = []
    if fit.outcome.name.lower() != "converged":
        said.append(f"Whether better values exist: the fit did not converge. {fit.outcome.value}")
    for p in fit.parameters:
        if p.name in asked and not p.identifiable:
            said.append(
                f"{p.name}: these recordings do not determine it; the value is no better than its start value."
            )
        elif p.name in asked and p.at_bound:
            said.append(
                f"{p.name}: it lies at its bound; the data call for more, or the model is wrong there."
            )
    said.extend(fit.ties)
    if not any(one.use == "held out" for one in exhibits):
        said.append("How it predicts new data: no recording was held out.")
    return said


def notes(exhibits: Sequence[Exhibit]) -> list[str]:
    """What makes a recording unfit, and notes on the predictions that their scores do not show."""
    unfit = [
        f"{one.recording.name}: {remark.message}"
        for one in exhibits
        for remark in one.remarks
        if remark.severity == "error"
    ]
    return [*unfit, *(note for one in exhibits for note in one.prediction.notes)]


def about_data(exhibits: Sequence[Exhibit], rig: Rig) -> list[str]:
    """Coloured residuals, ranges that were not visited, outputs that were not measured."""
    return [*_coloured(exhibits), *_ranges(exhibits, rig)]


def _coloured(exhibits: Sequence[Exhibit]) -> list[str]:
    said = []
    for one in exhibits:
        for role in one.prediction.scores["window"]:
            _, values, band = autocorrelation(residual(one.prediction.frame, role, "window"))
            share = float(np.mean(np.abs(values) > band)) if values.size else 0.0
            if share > WHITE:
                said.append(
                    f"Why the window residuals of {role} in {one.recording.name} are not white: "
                    f"{100 * share:.0f} % of their autocorrelation lies outside the 95 % band. "
                    "The model lacks something, or the windows start from a slightly wrong state."
                )
    return said


def _ranges(exhibits: Sequence[Exhibit], rig: Rig) -> list[str]:
    said, outputs = [], [port.role for port in rig.model.outputs]
    seen = [one.recording for one in exhibits if one.use != "held out"]
    for role in [*outputs, *(port.role for port in measured_inputs(rig.model))]:
        channels, words = [one[role] for one in seen if role in one], role.replace("_", " ")
        if channels:
            low = min(float(np.nanmin(channel.recorded)) for channel in channels)
            high = max(float(np.nanmax(channel.recorded)) for channel in channels)
            factor, unit = friendly(channels[0].recorded_unit)
            span = f"{plain(low * factor, 4)} to {plain(high * factor, 4)} {unit}".rstrip()
            said.append(f"Any {words} outside the range of these recordings: {span}.")
        elif role in outputs:
            said.append(f"{words}: it was not measured, so the model's prediction of it is untested.")
    return said
