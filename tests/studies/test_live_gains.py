"""The study's measure: what counts as worse gains."""

from optid.live.loop import Choices
from optid.pid.controller import Gains
from studies.live_gains import LAP, RATE, RIGS, Quiet, itae, run
from studies.live_rig import REAL


def test_three_rigs_and_a_silent_sensor():
    assert len({*RIGS.values()}) == 3
    rig = Quiet(REAL)
    assert [rig.read(1e-3 * n)[0] for n in range(3)] == [rig.read(2e-3)[0]] * 3


def test_slower_gains_cost_more():
    assert LAP == 14.0 and RATE == 500.0
    assert itae(REAL, Gains(12.0), 3.5) > 1.5 * itae(REAL, Gains(20.0), 3.5) > 0.0
    seen = []
    run(Quiet(REAL), Choices(Gains(20.0)), 0.02, lambda loop, time: seen.append(time))
    assert len(seen) == 10
