"""`optid.fit` and `optid.profile`: parameters from recordings."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from optid.api.document import stamp
from optid.api.exhibit import Exhibit, about, input_table, prediction_table
from optid.api.inputs import Given, Progress, at_their_rate, given, of_each, refuse_unfit, rig_of, silent
from optid.api.unknowns import about_data, about_fit
from optid.errors import NotIdentifiable
from optid.estimation.multiple_shooting import FitOptions
from optid.estimation.multiple_shooting import fit as estimate
from optid.estimation.prediction import predict
from optid.estimation.profile import Profile, fitted
from optid.estimation.profile import profile as follow
from optid.estimation.result import Certificate, Fit
from optid.report.scores import Miss, fit_document, misses, number
from optid.results.fit import FitResult, ProfileResult
from optid.results.with_rig import RIG
from optid.rigs.constraints import broken
from optid.rigs.per_recording import stated
from optid.rigs.rigfile import Rig, rig_text

if TYPE_CHECKING:
    import pandas as pd

    from optid.api.inputs import Recordings

HUBER = 1.345  # sd: 95 % as efficient as least squares on normal noise (Huber, Robust Statistics, 1981)


def fit(
    rig: str | Path | Rig,
    recordings: Recordings,
    holdout: Recordings = (),
    *,
    starts: int = 1,
    time_limit: float | None = None,
    robust: bool = False,
    profiles: Sequence[str] = (),
    seed: int = 0,
    rate: float | None = None,
    checkpoint: Path | None = None,
    progress: Progress = silent,
) -> FitResult:
    """Fit the parameters of a rig file's [fit] table to recordings, and judge them on others.

    Parameters
    ----------
    rig : str | Path | Rig
        a rig file, or what `read_rig` made of one.
    recordings : Recordings
        to fit to: a path, a DataFrame, a Recording, or a list of them.
    holdout : Recordings
        to judge on; the fit never sees them.
    starts : int
        number of start points.
    time_limit : float | None
        s of the process's own time; then the best point so far is returned.
    robust : bool
        weigh outliers linearly instead of quadratically (Huber's loss).
    profiles : Sequence[str]
        names of parameters whose profile likelihood is computed.
    seed : int
        seed of the drawn starts.
    rate : float | None
        Hz to which faster recordings are decimated; by default as fast as the axis's fastest pole needs.
    checkpoint : Path | None
        a file that keeps the best point, from which an interrupted call continues.
    progress : Progress
        called with the share done and a few words.

    Returns
    -------
    FitResult
        Parameters with 95 % intervals, predictions, scores and a report.

    Raises
    ------
    InputError
        an input is wrong, or no parameter is to be fitted.
    NotIdentifiable
        a recording is unfit, or a parameter has no influence on these data.
    SolveError
        the model cannot be simulated at the start values.
    """
    understood = rig_of(rig)
    train, held = given(understood, recordings, holdout, rate)
    refuse_unfit(train)
    understood = at_their_rate(understood, train)
    understood, (train, held) = of_each(understood, train, held)
    for name in profiles:
        fitted(understood, name)
    data = [one.recording for one in train]
    options = FitOptions(
        starts=starts,
        time_limit=time_limit,
        huber=HUBER if robust else math.inf,
        seed=seed,
        checkpoint=checkpoint,
    )
    found = estimate(
        understood, data, options, lambda now: progress(now.fraction, f"{now.stage}, cost {now.cost:.5g}")
    )
    followed, refused = _profiles(understood, data, found, options, profiles, progress)
    exhibits = _exhibits(understood, found, train, held, progress)
    missed = misses([one.prediction for one in exhibits if one.use == "training"], data)
    found = found.judged(
        [freed.name for freed in understood.freed],
        [one.fit_percent for one in missed],
        sound=not broken(understood.model, found.values),
    )
    return _result(understood, found, exhibits, followed, refused, missed)


def profile(
    fit: FitResult,
    recordings: Recordings,
    name: str,
    *,
    robust: bool = False,
    rate: float | None = None,
    progress: Progress = silent,
) -> ProfileResult:
    """Compute the profile likelihood of one fitted parameter: all others are refitted at each of its values.

    Parameters
    ----------
    fit : FitResult
        converged.
    recordings : Recordings
        those that it was fitted to.
    name : str
        of the parameter.
    robust : bool
        as fitted.
    rate : float | None
        as fitted.
    progress : Progress
        called with the share done and a few words.

    Returns
    -------
    ProfileResult
        the profile likelihood, with its interval.

    Raises
    ------
    InputError
        the fit holds no such parameter.
    NotIdentifiable
        the parameter lies at its bound, or the data do not determine it.
    """
    understood = fit.rig
    data = [one.recording for one in given(understood, recordings, rate=rate)[0]]
    options = FitOptions(huber=HUBER if robust else math.inf)
    found = follow(understood, data, estimated(fit), name, options, partial(_told, progress, name))
    document = {**stamp(ProfileResult.SCHEMA, "profile", understood, data), **profile_entry(found)}
    return ProfileResult(document, {"profile": _profile_table(found)})


def profile_entry(found: Profile) -> dict[str, Any]:
    """A profile as an entry of a document."""
    return {
        "parameter": found.name,
        "value": found.value,
        "unit": found.unit,
        "ci95": [number(found.low), number(found.high)],
        "fit_ci95": [number(end) for end in found.linear],
        "limit": number(found.limit),
        "words": found.sentence,
    }


def estimated(fit: FitResult) -> Fit:
    """The fit as the estimation package represents it."""
    nodes = fit.tables["nodes"]
    states = [column for column in nodes if str(column).startswith("state ")]
    frame = nodes[["recording", "time", "defect", "misfit", "sound"]]
    return Fit(
        outcome=fit.outcome,
        parameters=tuple(fit.parameters.values()),
        values=fit.values,
        covariance=fit.covariance,
        noise={role: entry["sd"] for role, entry in fit.document["noise"].items()},
        process_noise=fit.process_noise,
        states=nodes[states].to_numpy(dtype=float),
        ties=tuple(fit.document["ties"]),
        certificate=Certificate(frame),
        seconds=fit.document["seconds"],
    )


def _exhibits(
    rig: Rig, found: Fit, train: Sequence[Given], held: Sequence[Given], progress: Progress
) -> list[Exhibit]:
    shown = []
    for use, group in (("training", train), ("held out", held)):
        for one in group:
            progress(0.99, f"predicting {one.recording.name}")
            prediction = predict(rig, one.recording, found.values, found.process_noise)
            shown.append(Exhibit(use, one.recording, prediction, one.remarks))
    return shown


def _profiles(
    rig: Rig, data: Sequence[Any], found: Fit, options: FitOptions, names: Sequence[str], progress: Progress
) -> tuple[list[Profile], list[str]]:
    """The requested profiles, and why others cannot be computed."""
    followed, refused = [], []
    for name in dict.fromkeys(names):
        try:
            tell = partial(_told, progress, f"profile of {name}")
            one = follow(rig, data, found, name, options, tell)
            followed.append(one)
        except NotIdentifiable as error:
            refused.append(f"no profile: {error}")
    return followed, refused


def _told(progress: Progress, words: str, share: float) -> None:
    progress(share, words)


def _result(
    rig: Rig,
    found: Fit,
    exhibits: list[Exhibit],
    profiles: list[Profile],
    refused: list[str],
    missed: Sequence[Miss],
) -> FitResult:
    asked = [freed.name for freed in rig.freed]
    used = {use: [e.prediction for e in exhibits if e.use == use] for use in ("training", "held out")}
    beyond = misses(used["held out"], [one.recording for one in exhibits if one.use == "held out"])
    document = fit_document(found, used["training"], used["held out"], profiles, missed, beyond)
    for one in found.parameters:
        document["parameters"][one.name]["start"] = number(one.start)
    document = {
        **stamp(FitResult.SCHEMA, "fit", rig, [one.recording for one in exhibits]),
        **document,
        "asked": asked,
        "values": {name: number(value) for name, value in found.values.items()},
        "process_noise": [number(float(value)) for value in found.process_noise],
        "horizon": max(one.prediction.horizon for one in exhibits),
        "refused_profiles": refused,
        "about": {
            **about(rig, exhibits),
            "unknowns": [*about_fit(found, asked, exhibits), *about_data(exhibits, rig)],
        },
    }
    tables = {
        "prediction": prediction_table(exhibits),
        "inputs": input_table(rig, exhibits),
        "nodes": _nodes(rig, found, exhibits),
        "covariance": _covariance(found),
        **{f"profile {one.name}": _profile_table(one) for one in profiles},
    }
    values = {p.name: p.value for p in found.parameters}
    own = stated(rig, values, [one.recording.name for one in exhibits])
    return FitResult(document, tables, {RIG: rig_text(rig, values, own)})


def _nodes(rig: Rig, found: Fit, exhibits: list[Exhibit]) -> pd.DataFrame:
    names = [one.recording.name for one in exhibits if one.use == "training"]
    frame = found.certificate.frame.reset_index(drop=True)
    which = [names[n] if isinstance(n, int) else n for n in frame["recording"].tolist()]
    states = {f"state {s.name}": found.states[:, k] for k, s in enumerate(rig.model.states)}
    return frame.assign(recording=which, sound=frame["sound"].astype(bool), **states)


def _covariance(found: Fit) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(np.asarray(found.covariance, dtype=float), columns=[p.name for p in found.parameters])


def _profile_table(found: Profile) -> pd.DataFrame:
    frame = found.others.reset_index(drop=True)
    frame.insert(0, "deviance", found.deviance)
    frame.insert(0, "value", found.values)
    return frame
