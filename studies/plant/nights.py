"""Rigs over nights: simulated apart from optid, fitted once, and tested every night."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from optid.api.fitting import fit
from optid.core.recording import Channel, Recording
from optid.fleet.fleetfile import WATCHED
from optid.monitoring.one_step import quantities
from optid.rigs.rigfile import read_rig
from studies.independent_rig import Rig, Sensors, recording, simulate
from studies.references import mixed

ROOT = Path(__file__).parents[2]
SEED = 58
INTERVAL, STEP = 2e-3, 5e-5
GROWTH = 12.0  # nights from nothing to the medium size
FRICTION, SUPPLY = 0.015, 0.005  # by which both wander from night to night, as shares (sd)
TOLD_APART = ROOT / "studies" / "distinguishability.json"


@dataclass(frozen=True)
class Plant:
    """Who is there, and who wears.

    Attributes:
        rigs, nights: how many.
        wearing: rigs that wear: the first ones, in the four ways in turn.
        begins: first and last night, from 0, on which a wear may start.
        seed: of everything.
        seconds: of a night's recording: it holds as many samples as the motions of the table of least sizes.
    """

    rigs: int = 200
    nights: int = 30
    wearing: int = 14
    begins: tuple[int, int] = (8, 16)
    seed: int = SEED
    seconds: float = 24.0


@dataclass(frozen=True)
class Wear:
    """A way to wear: the effect's name, its medium size, and how the rig has it at a size."""

    effect: str
    medium: float

    @property
    def visible(self) -> float:
        """Share of the medium size that the best possible test tells from nothing."""
        table = json.loads(TOLD_APART.read_text(encoding="utf-8"))
        return float(table["rich"]["position only"][self.effect]["alone"])

    def worn(self, rig: Rig, share: float) -> Rig:
        """The rig with the wear at a share of its medium size."""
        size = share * self.medium
        fields: Mapping[str, float] = {
            "valve_deadband": dict.fromkeys(
                ("overlap_supply_a", "overlap_exhaust_a", "overlap_supply_b", "overlap_exhaust_b"), size
            ),
            "cross_leakage": {"leak_cross": size, "leak_laminar": 1.0},
            "stribeck_friction": {"stick_ratio": 1.0 + size, "stribeck_speed": 0.02, "stribeck_form": 1.0},
            "sensor_backlash": {"backlash": size},
        }[self.effect]
        return rig._replace(**fields) if share > 0.0 else rig


# Medium sizes are those of studies/trial/named.py: the geometric mean of each range.
WAYS = (
    Wear("valve_deadband", math.sqrt(5e-3 * 6e-2)),
    Wear("cross_leakage", math.sqrt(2.5e-8 * 4e-7)),
    Wear("stribeck_friction", math.sqrt(0.12 * 0.8)),
    Wear("sensor_backlash", math.sqrt(3e-5 * 4e-4)),
)


def wear_of(plant: Plant, number: int) -> tuple[Wear, int] | None:
    """The wear of a rig (from 1) and the night on which it starts; ``None`` for one that does not."""
    if number > plant.wearing:
        return None
    rng = np.random.default_rng([plant.seed, number, 1])
    return WAYS[(number - 1) % len(WAYS)], int(rng.integers(plant.begins[0], plant.begins[1] + 1))


def sound(plant: Plant, number: int) -> Rig:
    """A rig as it was bought: siblings share a valve type, and so nearly one discharge coefficient."""
    rng = np.random.default_rng([plant.seed, number, 0])
    return Rig(
        viscous=rng.normal(66.0, 6.0),
        coulomb=rng.normal(75.0, 6.0),
        discharge=rng.normal(0.77, 2e-4),
        residual_length=rng.normal(10.5e-3, 0.4e-3),
    )


def night(plant: Plant, number: int, which: int) -> Recording:
    """What a rig records on a night (from 0)."""
    rng = np.random.default_rng([plant.seed, number, 100 + which])
    rig = sound(plant, number)
    wear = wear_of(plant, number)
    if wear is not None:
        rig = wear[0].worn(rig, (which - wear[1] + 1) / GROWTH)
    rig = rig._replace(
        coulomb=rig.coulomb * (1.0 + FRICTION * rng.normal()),
        supply_pressure=rig.supply_pressure * (1.0 + SUPPLY * rng.normal()),
    )
    reference = mixed(plant.seconds, INTERVAL, rng, 0.1)
    run = simulate(rig, reference, rng, sensors=Sensors(), dt=INTERVAL, step=STEP)
    table = recording(run, rng, Sensors())
    channels = {
        "command": Channel("command", "u", "1", table["u"].to_numpy() / 5.0, full_scale=1.0, per_unit=5.0),
        "position": Channel("position", "x", "m", table["x"].to_numpy() * 1e-3),
    }
    return Recording(f"{date(which)}.csv", table["t"].to_numpy(), channels)


def date(which: int) -> str:
    """The date of a night (from 0)."""
    return str((pd.Timestamp("2026-10-01") + pd.Timedelta(days=which)).date())


def nights(plant: Plant, folder: Path, part: tuple[int, int]) -> None:
    """Simulate and test all nights of some rigs; those that are done are left alone."""
    (folder / "plant.json").write_text(json.dumps(asdict(plant)) + "\n", encoding="utf-8")
    for number in range(part[0], min(part[1], plant.rigs) + 1):
        place = folder / f"rig-{number:03}.parquet"
        if not place.is_file():
            began = time.process_time()
            frame = measured(plant, number)
            fresh = place.with_suffix(".new")
            frame.to_parquet(fresh, index=False)
            fresh.replace(place)
            print(f"rig {number}: {time.process_time() - began:.1f} s of a core", flush=True)


def measured(plant: Plant, number: int) -> pd.DataFrame:
    """What the tests of a rig's nights measure: rig, date, quantity, value, sd, job, unit and seconds."""
    rig = read_rig(ROOT / "data" / "bench.toml")
    fitted = fit(rig, night(plant, number, 0))
    rig = replace(rig, parameters={**rig.parameters, **{k: v.value for k, v in fitted.parameters.items()}})
    rows = []
    for which in range(plant.nights):
        recorded = night(plant, number, which)
        began = time.process_time()
        found = quantities(rig, [recorded], WATCHED)
        spent = time.process_time() - began
        name = f"rig-{number:03}"
        rows += [(name, date(which), k, q.value, q.sd, "test", q.unit, spent) for k, q in found.items()]
    return pd.DataFrame(rows, columns=["rig", "date", "quantity", "value", "sd", "job", "unit", "seconds"])
