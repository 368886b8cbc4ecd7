"""Narrow gaps, whose flow stays laminar where an orifice's would choke."""

from __future__ import annotations

from typing import Any

import casadi as ca

from optid.core.parameter import Parameter
from optid.core.sheet import Sheet

ALIKE = 5e5  # Pa: absolute pressure at which gap and orifice of one area pass the same into a vacuum
LAMINAR = Parameter(
    "laminar_share",
    "1",
    1.0,
    "0: an orifice, whose choked flow goes with P; 1: a narrow gap, whose flow goes with P^2",
    "Poiseuille's law for a gas between plates; seals are in between",
    0.0,
    (0.0, 1.0),
)


def laminar_flux(sheet: Sheet, P_from: Any, P: Any) -> Any:
    """Flow per effective area through a narrow gap into a chamber at P, kg/(s m2)."""
    K, R = sheet.plant_param("specific_heat_ratio"), sheet.plant_param("gas_constant")
    C_0 = ca.sqrt(K / R * (2 / (K + 1)) ** ((K + 1) / (K - 1)))
    return C_0 * (P_from**2 - P**2) / ALIKE / ca.sqrt(sheet.plant_param("chamber_temperature"))
