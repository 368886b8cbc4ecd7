"""Fleets: many rigs and recordings, on any executor, with folders of results as the only state.

    import optid
    result = optid.fleet.run("fleet.toml", "out/fleet", executor=client.get_executor())

The way of the data: `fleetfile` (fleet.toml) -> `job` -> `running` (executor) -> `row` (a folder, `run.json`) ->
`process` (bounded, killed for good) -> `table` -> `statistics` -> `conclude` -> report.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from optid.fleet.fleet import conclude as conclude
    from optid.fleet.fleet import run as run
    from optid.fleet.fleetfile import Fleet as Fleet
    from optid.fleet.fleetfile import Nightly as Nightly
    from optid.fleet.fleetfile import read_fleet as read_fleet
    from optid.fleet.job import Job as Job
    from optid.fleet.job import Limits as Limits
    from optid.fleet.night import night_test as night_test
    from optid.fleet.progress import status as status

# Public name -> the module that holds it: the process of a job imports this package, and must be there at once.
_HOMES = {
    **dict.fromkeys(("run", "conclude"), "optid.fleet.fleet"),
    **dict.fromkeys(("Fleet", "Nightly", "read_fleet"), "optid.fleet.fleetfile"),
    **dict.fromkeys(("Job", "Limits"), "optid.fleet.job"),
    "night_test": "optid.fleet.night",
    "status": "optid.fleet.progress",
}
__all__ = [*_HOMES]

if not TYPE_CHECKING:

    def __getattr__(name: str) -> Any:
        """Import a public name when it is first asked for."""
        if name in _HOMES:
            return getattr(importlib.import_module(_HOMES[name]), name)
        raise AttributeError(f"module 'optid.fleet' has no attribute {name!r}")
