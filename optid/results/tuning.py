"""Tuned gains, in the form of pid.json."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from optid.core.quantity import plain, unit_name
from optid.pid.controller import Controller
from optid.results.result import Result
from optid.results.words import table
from optid.tuning.files import controller_of

if TYPE_CHECKING:
    import control
    import pandas as pd

GAINS = ("kp", "ki", "kd", "derivative_filter", "setpoint_weight")


class TuningResult(Result):
    """Tuned gains, their cost, and the cost of other tuning rules.

    `tables["responses"]`: episode, time (s), reference, output and command (SI) on the identified model.
    `tables["loop"]`: numerator and denominator of the identified plant in falling powers of z.
    """

    FILE: ClassVar[str] = "pid.json"
    SCHEMA: ClassVar[str] = "optid.pid/1"
    FILES: ClassVar[tuple[str, ...]] = ("report.html", "pid.h", "pid.st")

    @property
    def gains(self) -> Mapping[str, float]:
        """Gains by name, SI: u = kp (b r - y) + integral of ki (r - y) + kd d(c r - y)/dt, the derivative lagged."""
        return dict(self.document["gains"])

    @property
    def controller(self) -> Controller:
        """A running controller with these gains and limits."""
        return controller_of(dict(self.document), Path(self.FILE))

    def to_control(self) -> dict[str, control.TransferFunction]:
        """Controller, plant, loop and closed loop as named discrete systems of python-control, without limits.

        Returns
        -------
        dict[str, control.TransferFunction]
            "controller" (error to command), "plant", "loop" (their product) and "closed_loop" (reference to output for
            a set-point weight of 1).
        """
        import control

        from optid.armax.loop import Gains

        g, dt = self.gains, float(self.document["sample_time"])
        feedback = Gains(g["kp"], g["ki"], g["kd"], g["derivative_filter"])
        C = control.TransferFunction(*feedback.polynomials(dt), dt, name="controller")
        frame = self.tables["loop"]
        P = control.TransferFunction(
            frame["numerator"].to_numpy(), frame["denominator"].to_numpy(), dt, name="plant"
        )
        L = C * P
        T = control.feedback(L, 1)
        for system, name in ((L, "loop"), (T, "closed_loop")):
            system.name = name
        return {"controller": C, "plant": P, "loop": L, "closed_loop": T}

    def summary(self) -> str:
        """The gains with their units, and their cost compared with the baselines.

        Returns
        -------
        str
            a few lines.
        """
        d = self.document
        gains = [(name, plain(self.gains[name], 6), unit_name(d["units"][name])) for name in GAINS]
        everyone = {"tuned": d["cost"], **d["baselines"]}
        costs = [(name.replace("_", " "), _cost(one.get("itae"))) for name, one in everyone.items()]
        unit = unit_name(d["units"]["itae"])
        return "\n".join([*table(("gain", "value", "unit"), gains), *table(("", f"ITAE ({unit})"), costs)])

    def to_frame(self) -> pd.DataFrame:
        """One row per way to choose gains: name, kp, ki, kd (SI), itae.

        Returns
        -------
        pd.DataFrame
            SI units, unless a column says otherwise.
        """
        import pandas as pd

        d = self.document
        everyone = {"tuned": {**d["cost"], "gains": d["gains"]}, **d["baselines"]}
        rows = [
            (name, *((one.get("gains") or {}).get(gain) for gain in GAINS[:3]), one.get("itae"))
            for name, one in everyone.items()
        ]
        return pd.DataFrame(rows, columns=["name", *GAINS[:3], "itae"])


def _cost(value: float | None) -> str:
    return "unstable" if value is None else plain(value, 4)
