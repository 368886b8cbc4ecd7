"""From what the diagnosis package holds in memory to the tables of a result: the only module that knows both."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

    from optid.core.model import Array
    from optid.diagnosis.result import Diagnosis, Finding
    from optid.diagnosis.selection.path import Contender, Round

BINS = 60


def tables_of(found: Diagnosis) -> dict[str, pd.DataFrame]:
    """See `DiagnosisResult`."""
    names = [recording.name for recording in found.problem.train]
    tables = {"holdout": _holdout(found)}
    if any(step.contenders for step in found.path.rounds):
        tables["rivals"] = _rivals(found)
    for number, finding in enumerate(found.findings, 1):
        tables[f"map {number}"] = _map(finding, names)
        for signal in finding.shown:
            if signal in finding.region.signals:
                tables[f"state {number} {signal}"] = _over(finding, signal)
        if finding.signal is not None:
            tables[f"signal {number}"] = _signal(finding, names)
    return tables


def _holdout(found: Diagnosis) -> pd.DataFrame:
    """Windows of both models over the recordings held out."""
    import pandas as pd

    before, after = found.test.base, found.test.best
    names = found.holdout
    columns: dict[str, object] = {"recording": [names[k] for k in before.recording], "time": before.time}
    for j, role in enumerate(before.scores):
        columns[role] = before.measured[:, j]
        columns[f"{role}_before"] = before.windows[:, j]
        columns[f"{role}_after"] = after.windows[:, j]
    return pd.DataFrame(columns)


def _rivals(found: Diagnosis) -> pd.DataFrame:
    """Contenders of each round, their scores, and why they were rejected."""
    import pandas as pd

    kept = {effect.name for effect in found.best.effects}
    return pd.DataFrame(
        [
            {
                "round": number,
                "effect": one.effect.name,
                "error_over_noise": float(one.validated.error_over_noise),
                "loss": float(one.validated.windows.sum()),
                "why": _why(one, step, kept),
            }
            for number, step in enumerate(found.path.rounds, 1)
            for one in step.contenders
        ]
    )


def _why(one: Contender, step: Round, kept: Collection[str]) -> str:
    if one is step.taken:
        return "taken"
    later = "; selected later, together with what else was missing"
    return (
        one.why + (later if one.why and one.effect.name in kept else "")
        or "explains less than the one selected"
    )


def _map(finding: Finding, names: list[str]) -> pd.DataFrame:
    """Root of the mismatch's energy over time, one row per slot."""
    import pandas as pd

    region, parts = finding.region, []
    for number, name in enumerate(names):
        mine = region.owner == number
        if not mine.any():
            continue
        begin = float(region.time[mine][0])
        slot = np.floor((region.time[mine] - begin) / region.slot).astype(int)
        energy = np.sqrt(np.bincount(slot, weights=region.energy[mine]))
        time = begin + region.slot * np.arange(len(energy))
        parts.append(pd.DataFrame({"recording": name, "time": time, "mismatch": energy}))
    return pd.concat(parts, ignore_index=True)


def _over(finding: Finding, signal: str) -> pd.DataFrame:
    """Share of the mismatch and of the samples in each bin of a signal, SI; `low` is the bin's lower edge."""
    import pandas as pd

    values, _ = finding.region.signals[signal]
    good = np.isfinite(values)
    low, high = np.quantile(values[good], [0.002, 0.998])
    if high <= low:
        low, high = low - 1.0, high + 1.0
    edges = np.linspace(low, high, BINS + 1)
    mismatch, _ = np.histogram(values[good], edges, weights=finding.region.energy[good])
    samples, _ = np.histogram(values[good], edges)
    return pd.DataFrame(
        {
            "low": edges[:-1],
            "high": edges[1:],
            "samples": samples / max(samples.sum(), 1),
            "mismatch": mismatch / max(mismatch.sum(), 1e-300),
        }
    )


def _signal(finding: Finding, names: list[str]) -> pd.DataFrame:
    """The missing signal at the site, sample by sample, with its sd, the identified law and its likely cause; SI."""
    import pandas as pd

    assert finding.signal is not None
    region = finding.region
    cause = next((name for name in finding.shown if name in region.signals), None)
    columns: dict[str, object] = {
        "recording": [names[k] for k in region.owner],
        "time": region.time,
        "missing": _flat(finding.signal.signal),
        "missing_sd": _flat(finding.signal.signal_sd),
    }
    if finding.law is not None:
        columns["law"] = _flat(finding.law)
    if cause is not None:
        columns["cause"] = region.signals[cause][0]
    return pd.DataFrame(columns)


def _flat(values: Array) -> Array:
    return np.asarray(values, dtype=float).ravel()
