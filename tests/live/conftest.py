"""A rig to run live, and a session of it in this process."""

from pathlib import Path

import pytest

from optid.live.driver import open_driver
from optid.live.lockstep import run_lockstep
from optid.live.log import Layout, Log
from optid.live.loop import Choices, Loop
from optid.live.reference import tour
from optid.live.settings import live_settings, wiring_of
from optid.pid.controller import Gains
from optid.rigs.rigfile import read_rig

BENCH = Path(__file__).resolve().parents[2] / "data" / "bench.toml"


@pytest.fixture
def bench():
    return read_rig(BENCH)


@pytest.fixture
def patient(tmp_path):
    """The same rig file for sessions in real time on a machine that may be busy: the watchdog waits long."""
    path = tmp_path / "patient.toml"
    path.write_text(BENCH.read_text(encoding="utf-8") + '\n[live]\nwatchdog = "60 s"\n', encoding="utf-8")
    return path


@pytest.fixture
def run_live(tmp_path):
    """Run a rig against a loop in this process; returns the end, the loop and the log's path."""

    def run(rig, driver="simulated", seconds=4.0, recording=None, seed=0, choices=None, reference=None):
        settings, wiring = live_settings(rig), wiring_of(rig)
        choices = choices or Choices(Gains(20.0))
        loop = Loop(rig, settings, wiring, reference or tour(settings.limits), choices)
        order = {"wiring": wiring, "settings": settings, "recording": recording, "seed": seed}
        driver = open_driver(driver, rig, order)
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.csv"
        log = Log(path, Layout(wiring).columns)
        try:
            return run_lockstep(driver, loop, log, seconds), loop, path
        finally:
            driver.close()
            log.close()

    return run
