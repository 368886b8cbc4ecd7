"""Dry friction of an axis: one law for every plant that slides.

Two smooth approximations of the jump of Coulomb's law at rest. "bristle" sticks: Dahl's law lets the contact move
elastically by `presliding_length` before it slides, `presliding_shape` says how abruptly. "smooth" creeps: tanh over
`friction_width`.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from optid.core.parameter import Nuisance, Parameter
from optid.core.sheet import Sheet

COULOMB_FRICTION = Parameter(
    "coulomb_friction",
    "N",
    80.0,
    "dry friction F_r, called static in table 1",
    "paper, table 1",
    bounds=(0.0, 1e6),
)
PRESLIDING_LENGTH = Parameter(
    "presliding_length",
    "m",
    2e-5,
    "elastic motion before dry friction slips",
    # No position sensor of such an axis resolves less than 0.3 um, which would only make rest stiff: 20 000 1/s.
    "seals slide after 0.01 to 1 mm; Dahl's law",
    2e-5,
    (3e-7, 5e-3),
    logarithmic=True,
    # Surfaces in contact give by micrometres before they slide; an eighth of the smallest yielding worth a name
    # (optid/effects/catalogue/presliding.py) belongs to the law.
    leeway=5e-6,
    starts=(2e-5, 3e-7),  # a contact that yields, and one that sticks
    # A smaller value doubles the time of searches, as the equations at rest become stiff; a fit ends below it.
    nuisance=Nuisance(2e-6, 6e-5),
)
PRESLIDING_SHAPE = Parameter(
    "presliding_shape",
    "1",
    1.0,
    "from dry friction that yields long before it slides (0) to one that holds until it slides (1)",
    # Dahl's law releases elastic energy at break-away, which true stiction does not have: on a rig with true
    # stick viscous friction comes out 0.13 % low at 0, 0.03 % at 1 (studies/interval_coverage.py).
    "Bouc and Wen's law with n = 1, which is Dahl's, and n = 5 (Wen 1976)",
    0.0,
    (0.0, 1.0),
    starts=(0.0, 1.0),
    nuisance=Nuisance(),
)
BRISTLE_LAG = Parameter(
    "bristle_lag",
    "s",
    2e-4,
    "shortest time in which dry friction builds up at speed; keeps the equations from becoming stiff",
    "numerical; studies/smoothing.py states its error",
    2e-4,
    (1e-7, 1.0),
)
BRISTLE_DAMPING = Parameter(
    "bristle_damping",
    "s",
    2e-4,
    "damping of the elastic motion at rest as a time: sigma_1 / sigma_0 of the LuGre law",
    "Canudas de Wit et al., IEEE Trans. Automatic Control 40(3), 1995: 3 ms; pneumatic seals less",
    2e-4,
    (0.0, 1.0),
    starts=(2e-4,),
    nuisance=Nuisance(high=2e-2, sd=5e-3, by_filter=True),
)
BRISTLE_FADING = Parameter(
    "bristle_fading",
    "m/s",
    0.02,
    "speed at which that damping has fallen to half",
    # Constant damping would make the law active at speed.
    "Olsson et al., European Journal of Control 4(3), 1998: sigma_1 falls with speed",
    50.0,
    (1e-4, 1e3),
    logarithmic=True,
    starts=(0.02,),  # at its default the decay hardly shows
    nuisance=Nuisance(2e-3, 0.5, by_filter=True),
)
# Dahl's law returns elastic energy that true stiction does not have; fits compensate by the other parameters. What is
# left of that when the contact is short and abrupt, as a share of each: the standard deviation with which intervals
# hold the truth of a rig with true stiction in 95 % of fits (studies/interval_coverage.py, 56 to 100 fits a plant,
# seed 1995). Plants whose parameters other than friction are affected state them beside their own.
STICK_BIAS = {"viscous_friction": 4e-4}
FRICTION_WIDTH = Parameter(
    "friction_width",
    "m/s",
    3e-3,
    "speed over which smooth dry friction changes sign",
    "numerical; studies/smoothing.py states its error",
    3e-3,
    (1e-6, 1.0),
    logarithmic=True,
    nuisance=Nuisance(),
)


def sliding(s: Sheet, v: Any, kind: str) -> Any:
    """Dry friction at speed v (m/s) as a share of its full value: -1 to 1, dimensionless.

    Args:
        s: sheet that receives the bristle's state and the settings of the chosen kind.
        v: speed of the contact, m/s.
        kind: "bristle", "smooth" or "constant" (always 1, for any direction of motion).
    """
    if kind == "constant":
        return 1.0
    # The limit of steady sliding at this speed: above 1 near rest it is Stribeck's curve.
    most = s.site("force.breakaway", 1.0, unit="1", v=v)
    if kind == "smooth":
        return most * ca.tanh(v / s.param(s.sized(FRICTION_WIDTH)))
    s.biased(**STICK_BIAS)
    # Bouc and Wen's law for the bristles' deflection z = F/F_r, with bounded build-up rate at speed; its exponent
    # runs from 1, which is Dahl's law, to 5.
    z = s.state("bristle", "1", 1.0, spread=1.0)
    lag = s.param(s.sized(BRISTLE_LAG))
    contact = s.sized(PRESLIDING_LENGTH)
    length = s.site("force.presliding", s.param(contact), unit=contact.unit, v=v, z=z, most=most)
    share = z / most
    squared = share * share  # without a power, which would be the most expensive term of the plant
    yielding = 1 + s.param(s.sized(PRESLIDING_SHAPE)) * (squared * squared - 1)
    # The longer one counts: at speeds where Stribeck's curve bends, the lag must not lengthen the contact.
    reach = ca.sqrt(length**2 + (lag * v) ** 2)
    z_dot = (v - ca.fabs(v) * share * yielding) / reach
    s.rate(z, z_dot)
    damping = s.param(s.sized(BRISTLE_DAMPING)) / (1 + (v / s.param(s.sized(BRISTLE_FADING))) ** 2)
    return z + damping * z_dot


def dry_friction(s: Sheet, v: Any, kind: str, **near: Any) -> Any:
    """F_r of eq. 11, N: the level of dry friction, `coulomb_friction`, times `sliding`.

    The site `force.coulomb` offers the level, N, with the speed, the sliding share and the signals in `near`.

    Parameters
    ----------
    s : Sheet
        of the plant.
    v : Any
        speed of the contact, m/s.
    kind : str
        "bristle", "smooth" or "constant".
    **near : Any
        signals that effects at the friction's sites may need.

    Returns
    -------
    Any
        friction force against positive motion, N.
    """
    share = sliding(s, v, kind)
    s.scalable("force.coulomb")
    level = s.sized(COULOMB_FRICTION)
    return s.site("force.coulomb", s.param(level), unit=level.unit, v=v, share=share, **near) * share
