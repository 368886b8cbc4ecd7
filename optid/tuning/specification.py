"""The specification of a tuning, in SI."""

from __future__ import annotations

from dataclasses import dataclass, field

from optid.core.model import Array
from optid.pid.controller import AntiWindup, Notch
from optid.tuning.criterion import Criterion
from optid.tuning.integrator import Integrator
from optid.tuning.margins import Required
from optid.tuning.task import Aggregation


@dataclass(frozen=True)
class TuningSpec:
    """The user's requirements, SI; empty or None is replaced by a default for the model.

    Attributes:
        order: na of the model to take; the recommended one.
        setpoints: steps from rest, each an episode.
        disturbances: load steps, each a further episode.
        profiles: name and path (samples,), each an episode.
        low, high, rate, resolution, deadband, anti_windup: of the controller's command.
        horizon: s of every episode.
        sample_time: s at which the controller runs; must be the model's.
        criterion, required, over: see `Task`.
        scenarios: plants drawn from the model's covariance, including the model itself.
        integrator: whether the pole nearest to 1 is replaced by exactly 1.
        dead_zone: (low, high) of the valve, part of the plant; command's unit.
        notch: of the command.
        acceleration: feed-forward, command per acceleration of the set-point.
        compensate: whether the controller compensates friction and dead band of the rig's model.
        usual_sensitivity: no bound on the maximum sensitivity was given: the default of the judging model is used.
    """

    order: int | None = None
    setpoints: tuple[float, ...] = ()
    disturbances: tuple[float, ...] = ()
    profiles: tuple[tuple[str, Array], ...] = ()
    low: float | None = None
    high: float | None = None
    rate: float | None = None
    resolution: float = 0.0
    deadband: tuple[float, float, float] = (0.0, 0.0, 0.0)
    anti_windup: AntiWindup = AntiWindup.CLAMPING
    horizon: float | None = None
    sample_time: float | None = None
    criterion: Criterion = field(default_factory=Criterion)
    required: Required = field(default_factory=Required)
    over: Aggregation = Aggregation.WORST
    scenarios: int = 1
    integrator: Integrator = Integrator.AUTO
    dead_zone: tuple[float, float] = (0.0, 0.0)
    notch: Notch | None = None
    acceleration: float = 0.0
    compensate: bool = False
    usual_sensitivity: bool = False
