"""After the guard's own death: a remaining process writes the safe command through a new connection."""

from __future__ import annotations

import contextlib

from optid.live.driver import VIRTUAL, open_driver
from optid.live.failsafe import Failsafe
from optid.live.plan import Plan, session_settings
from optid.live.settings import wiring_of
from optid.rigs.rigfile import read_rig


def rescue(plan: Plan) -> tuple[float | None, str]:
    """Open the driver again and write the safe command, with retries for the safe time.

    Returns:
        s until it was written, ``None`` if it could not be; and the message.
    """
    if plan.driver in VIRTUAL:  # it is part of the guard's process
        return 0.0, "the simulated rig ended with it"
    try:
        rig = read_rig(plan.rig)
        wiring, settings = wiring_of(rig), session_settings(plan, rig)
    except Exception as error:
        return None, f"the safe command could not be written ({type(error).__name__}: {error})"
    order = {"wiring": wiring, "settings": settings, "recording": None, "seed": plan.seed}
    failsafe = Failsafe(settings.safe_time, lambda: open_driver(plan.driver, rig, order))
    safe = wiring.put(settings.limits.safe)
    done = failsafe.put(None, lambda driver: driver.write(safe, 0.0))
    if done.driver is not None:
        with contextlib.suppress(Exception):
            done.driver.close()
    if done.seconds is None:
        return None, f"the safe command could not be written ({done.error})"
    return done.seconds, f"the safe command was written through a new connection after {done.seconds:.2g} s"
