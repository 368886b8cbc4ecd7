"""What the fleet statistics tell of the nights, beside what is true."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import beta

from optid.fleet.fleetfile import LEVEL, REFERENCE
from optid.fleet.statistics.changes import changes
from optid.fleet.statistics.siblings import levels, pooled, shrunken
from studies.plant.nights import GROWTH, Plant, date, sound, wear_of

LATE = 3  # nights after which a visible wear must be told
PARAMETERS = {
    "discharge_coefficient": "discharge",
    "residual_length": "residual_length",
    "viscous_friction": "viscous",
    "coulomb_friction": "coulomb",
}


def score(folder: Path) -> dict[str, Any]:
    """Wears found in time, what is told falsely with its interval, p-values of sound rigs, and what pooling gains."""
    told = json.loads((folder / "plant.json").read_text(encoding="utf-8"))
    plant = Plant(**{**told, "begins": tuple(told["begins"])})
    files = sorted(folder.glob("rig-*.parquet"))
    measures = pd.concat([pd.read_parquet(file) for file in files], ignore_index=True)
    found = changes(measures, REFERENCE, LEVEL)
    numbers = [int(file.stem.removeprefix("rig-")) for file in files]
    worn = [number for number in numbers if wear_of(plant, number) is not None]
    first = dict(zip(found.told["rig"], found.told["date"], strict=True))
    rows = [_wear(plant, number, first, found.told) for number in worn]
    false = sorted(rig for rig in first if int(rig.removeprefix("rig-")) not in worn)
    early = [row["rig"] for row in rows if row["told"] is not None and row["nights_late"] < -1]
    return {
        "rigs": len(numbers),
        "nights": plant.nights,
        "rows": int(measures.groupby(["rig", "date"]).ngroups),
        "wearing": len(worn),
        "in_time": sum(row["nights_late"] is not None and row["nights_late"] <= LATE for row in rows),
        "wears": rows,
        "told": len(first),
        "false": len(false) + len(early),
        "false_rigs": false + early,
        "false_share": _share(len(false) + len(early), len(first)),
        "night_p": _calibration(found.nights, worn),
        "pooling": _pooling(plant, measures),
        "seconds_a_test": float(measures.groupby(["rig", "date"])["seconds"].first().median()),
    }


def _wear(plant: Plant, number: int, first: dict[str, str], told: pd.DataFrame) -> dict[str, Any]:
    wear = wear_of(plant, number)
    assert wear is not None
    way, begins = wear
    rig = f"rig-{number:03}"
    visible = begins + max(0, math.ceil(GROWTH * way.visible) - 1)
    late = None
    if rig in first:
        late = [date(which) for which in range(plant.nights)].index(first[rig]) - visible
    by = told.loc[told["rig"] == rig, "quantity"]
    return {
        "rig": rig,
        "effect": way.effect,
        "begins": date(begins),
        "visible": date(visible),
        "visible_share_of_medium": way.visible,
        "told": first.get(rig),
        "nights_late": late,
        "by": str(by.iloc[0]) if len(by) else None,
    }


def _share(false: int, told: int) -> dict[str, float | None]:
    """The share of false ones with its 95 % interval (Clopper and Pearson)."""
    if not told:
        return {"share": None, "low": None, "high": None}
    low = float(beta.ppf(0.025, false, told - false + 1)) if false else 0.0
    high = float(beta.ppf(0.975, false + 1, told - false)) if false < told else 1.0
    return {"share": false / told, "low": low, "high": high}


def _calibration(nights: pd.DataFrame, worn: list[int]) -> dict[str, float]:
    """Of sound rigs' nights, the shares with p below some levels: at most these, if the p-values hold."""
    numbers = nights["rig"].str.removeprefix("rig-").astype(int)
    p = nights.loc[~numbers.isin(worn), "p"].to_numpy()
    return {"nights": len(p), **{f"below {a:g}": float(np.mean(p < a)) for a in (0.1, 0.05, 0.01, 0.001)}}


def _pooling(plant: Plant, measures: pd.DataFrame) -> dict[str, Any]:
    """For each fitted parameter the gain that is told, and the one by the truth: error before and after, rms."""
    table = levels(measures, REFERENCE)
    told = pooled(table).set_index("quantity")
    found = {}
    for quantity, field in PARAMETERS.items():
        if quantity not in told.index:
            continue
        one = table[table["quantity"] == quantity]
        truth = np.array([getattr(sound(plant, int(r.removeprefix("rig-"))), field) for r in one["rig"]])
        own = one["value"].to_numpy()
        drawn = shrunken(own, one["variance"].to_numpy())
        before, after = (float(np.std(x - truth)) for x in (own, drawn))
        found[quantity] = {
            "told_gain_of_variance": float(told.loc[quantity, "gain"]),
            "error_sd_alone": before,
            "error_sd_pooled": after,
        }
    return found


def text(found: dict[str, Any]) -> str:
    """The score for a terminal."""
    lines = [f"{found['rigs']} rigs, {found['nights']} nights, {found['rows']} tests"]
    for one in found["wears"]:
        when = (
            "never told"
            if one["told"] is None
            else f"told {one['told']} ({one['nights_late']:+d}) by {one['by']}"
        )
        lines.append(
            f"  {one['rig']} {one['effect']:20} begins {one['begins']} visible {one['visible']} {when}"
        )
    share = found["false_share"]
    lines.append(f"found within {LATE} nights of being visible: {found['in_time']} of {found['wearing']}")
    if share["share"] is not None:
        interval = f"{100 * share['low']:.1f} to {100 * share['high']:.1f} %"
        lines.append(
            f"told {found['told']}, false {found['false']}: {100 * share['share']:.1f} % ({interval})"
        )
    lines.append(f"p-values of sound rigs' nights: {found['night_p']}")
    lines += [f"pooling {k}: {v}" for k, v in found["pooling"].items()]
    lines.append(f"{found['seconds_a_test']:.2f} s of a core a test")
    return "\n".join(lines)
