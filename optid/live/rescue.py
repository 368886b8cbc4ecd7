"""After the guard's own death: whoever is left puts the safe command through a new door."""

from __future__ import annotations

from optid.live.driver import open_driver
from optid.live.plan import Plan
from optid.live.settings import live_settings, wiring_of
from optid.rigs.rigfile import read_rig

NO_RIG = ("simulated", "replay")  # these live in the guard's process and died with it


def rescue(plan: Plan) -> tuple[bool, str]:
    """Open the driver anew and put the safe command; whether it stands, and the words for it."""
    if plan.driver in NO_RIG:
        return True, "the simulated rig died with it"
    try:
        rig = read_rig(plan.rig)
        wiring, settings = wiring_of(rig), live_settings(rig, plan.rate)
        order = {"wiring": wiring, "settings": settings, "recording": None, "seed": plan.seed}
        driver = open_driver(plan.driver, rig, order)
        driver.write(wiring.put(settings.limits.safe), 0.0)
        driver.close()
    except Exception as error:
        return False, f"the safe command could not be put ({type(error).__name__}: {error})"
    return True, "the safe command was put through a new door"
