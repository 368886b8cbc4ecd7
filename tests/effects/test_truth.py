"""Effects held to what is known of them from elsewhere: exact delays, the play operator, laws of conservation."""

import itertools
import math

import casadi as ca
import numpy as np
import pytest

from optid.core.model import CLOCK, INTERVAL
from optid.core.sheet import build
from optid.core.simulation import simulate
from optid.effects.catalogue.exhaust_restriction import behind
from optid.effects.effect import Effect
from optid.effects.library import built_in
from optid.rigs.rigfile import read_rig
from optid.rigs.servo_pneumatic import servo_pneumatic
from tests.effects.excitation import DT, N, inputs_of, run
from tests.effects.plants import DATA, grown

AXIS = "servo-pneumatic"


def simulated(effect, values, u, x, count=3000):
    """States and shown position of the axis with one effect from plain start states x, and its model."""
    plant = grown(AXIS, effect)
    p = plant.vector({f"{effect}.{name}": value for name, value in values.items()})
    start = np.array(plant.model.start(p)[0]).ravel()
    start[plant.shared[0]] = x
    runs = simulate(plant.model, p, start, np.full(count, DT), inputs_of(plant.model, u[:count]))
    return runs.states[0][:, plant.shared[0]], runs.outputs[0, :, 0], plant


@pytest.mark.parametrize("samples", [1, 7, 10])
def test_a_delay_of_whole_samples_is_the_shifted_command(samples):
    X, u = run()
    late = np.r_[np.full(samples, u[0]), u][:N]
    delayed = simulated("input_delay", {"delay": samples * DT}, u, X[0])[0]
    shifted = simulated("input_delay", {"delay": 0.0}, late, X[0])[0]
    assert np.abs(delayed - shifted)[:, 0].max() < 1e-9


@pytest.mark.parametrize("samples", [0.4, 2.5, 7.7, 11.9])
def test_a_delay_inside_a_sample_moves_the_axis_as_a_finer_command_does(samples):
    """Written down as a command ten times as fast, where it changes sign from sample to sample."""
    X, u = run()
    count, finer = 200, 10
    u = u[:count] * np.random.default_rng(5).choice([-1.0, 1.0], count)
    plant, fast = grown(AXIS, "input_delay"), np.repeat(u, finer)
    late = np.r_[np.full(round(samples * finer), fast[0]), fast][: count * finer]
    start = np.array(plant.model.start(plant.vector())[0]).ravel()
    start[plant.shared[0]] = X[0]
    inputs, dt = inputs_of(plant.model, late), np.full(count * finer, DT / finer)
    truth = simulate(plant.model, plant.vector(), start, dt, inputs).states[0, ::finer, 0]
    delayed = simulated("input_delay", {"delay": samples * DT}, u, X[0], count)[0][:, 0]
    assert np.abs(delayed - truth).max() < 1e-9


def test_a_delay_beyond_those_looked_up_one_by_one_is_a_straight_line_between_two():
    X, u = run()
    between = [np.r_[np.full(k, u[0]), u][:N] for k in (12, 16)]
    delayed, _, plant = simulated("input_delay", {"delay": 14.0 * DT}, u, X[0])
    p, rng = plant.vector({"input_delay.delay": 14.0 * DT}), np.random.default_rng(2)
    x, given = plant.states(rng, 1)[0], plant.inputs(rng, 1)[0]
    assert np.abs(np.array(plant.model.halves(x, given, p, 1))).max() < 1e-9  # and not there and back again
    mean = simulated("input_delay", {"delay": 0.0}, (between[0] + between[1]) / 2, X[0])[0]
    assert np.abs(delayed - mean)[:, 0].max() < 1e-8


class Shifted(Effect):
    """The command a little higher, before it comes late."""

    name, sites, equation, parameters = "shifted", ("valve.input",), "3-6", ()
    ahead_of = ("input_delay", "clock_drift")

    def apply(self, site, nominal, near, sheet):
        return nominal + 0.125


def test_delays_add_up():
    """A clock's lateness comes on top of a delay, whichever stands first; what else was done to the command stays."""
    rng = np.random.default_rng(8)
    for names in (("input_delay", "clock_drift"), ("clock_drift", "input_delay")):
        effects = [built_in()[name] for name in names]
        model = build(servo_pneumatic, [*effects, Shifted()])
        values = {"input_delay.delay": 2.25 * DT, "clock_drift.rate": 0.05 * DT, "clock_drift.others": 1.0}
        given = rng.uniform(-1, 1, len(model.inputs))
        ports = [(port.role, port.ago) for port in model.inputs]
        given[ports.index((INTERVAL, 0))], given[ports.index((CLOCK, 0))] = DT, 5.0
        p = model.vector({**read_rig(DATA / "table1.toml").parameters, **values})
        x = np.array(model.start(p)[0]).ravel()
        plain = build(servo_pneumatic)
        q = plain.vector(read_rig(DATA / "table1.toml").parameters)
        own = [[s.name for s in model.states].index(s.name) for s in plain.states]
        for half, ago in ((0, 3), (1, 2)):  # 2.5 samples late in all: both halves of a hold are equally long
            command = [given[ports.index(("command", ago))] + 0.125]
            expected = np.array(plain.rates(x[own], command, q)).ravel()
            assert np.array(model.halves(x, given, p, half)).ravel()[own] == pytest.approx(
                expected, rel=1e-9, abs=1e-9
            )


def played(x, half):
    """The play operator: what trails x by at most `half`."""
    y = np.empty_like(x)
    y[0] = x[0]
    for k in range(1, len(x)):
        y[k] = min(max(y[k - 1], x[k] - half), x[k] + half)
    return y


def test_backlash_is_the_play_operator():
    X, u = run()
    states, shown, _ = simulated("sensor_backlash", {"play": 2e-4}, u, X[0])
    # It catches up in 0.3 ms: where friction lets go at 160 m/s2 the axis moves 14 um in that time.
    assert np.abs(shown - played(states[:, 0], 2e-4)).max() < 14e-6
    assert np.abs(shown - states[:, 0]).max() == pytest.approx(2e-4, rel=1e-3)


def ordered(*names):
    """The axis with these effects as given, and with table 1's parameters."""
    model = build(servo_pneumatic, [built_in()[name] for name in names])
    return model, read_rig(DATA / "table1.toml").parameters


@pytest.mark.parametrize("names", [("sensor_backlash", "sensor_lag"), ("sensor_lag", "sensor_backlash")])
def test_a_sensors_filter_takes_up_what_its_gear_shows(names):
    """Whichever was found first; a gear behind the filter would show up to 0.28 mm else at reversals."""
    model, parameters = ordered(*names)
    X, u = run()
    play, tau, finer = 2e-4, 8e-3, 10
    p = model.vector(
        {**parameters, "sensor_backlash.play": play, "sensor_lag.time_constant": tau, "sensor_lag.second": 0}
    )
    start = np.array(model.start(p)[0]).ravel()
    every = [state.name for state in model.states]
    for name, value in zip(("position", "velocity", "pressure_a", "pressure_b"), X[0], strict=False):
        start[every.index(name)] = value
    runs = simulate(model, p, start, np.full(2000 * finer, DT / finer), np.repeat(u[:2000], finer)[:, None])
    gear = played(runs.states[0, :, every.index("position")], play)
    shown, keep = np.empty_like(gear), math.exp(-DT / finer / tau)
    shown[0] = gear[0]
    for k in range(1, len(gear)):
        shown[k] = gear[k] + (shown[k - 1] - gear[k]) * keep
    assert np.abs(runs.outputs[0, :, 0] - shown)[500 * finer :].max() < 5e-5


def test_a_valves_memory_comes_before_its_lag_and_its_stops():
    """A step beyond the stop: the plays take their width off the command, the lag nears that, the stop cuts it."""
    for names in itertools.permutations(("valve_hysteresis", "valve_lag", "valve_saturation")):
        model, parameters = ordered(*names)
        values = {
            "valve_hysteresis.width": 0.05,
            "valve_lag.time_constant": 5e-3,
            "valve_saturation.loss": 1.0,
            "valve_saturation.limit": 0.3,
            "valve_saturation.skew": 0.0,
        }
        p = model.vector({**parameters, **values})
        start = np.array(model.start(p)[0]).ravel()
        states = simulate(model, p, start, np.full(120, DT), np.full((120, 1), 0.8)).states[0]
        lagged = states[:, [state.name for state in model.states].index("valve_lag.spool")]
        assert lagged[-1] == pytest.approx(0.75, abs=2e-3), names
        plain = build(servo_pneumatic)
        stopped = simulate(
            plain, plain.vector(parameters), states[50, :5], np.full(2, DT), np.full((2, 1), 0.3)
        ).states
        assert states[51, :4] == pytest.approx(stopped[0, 1, :4], rel=1e-5), names


@pytest.mark.parametrize(("spread", "bend"), [(0.0, 0.0), (0.6, 0.0), (0.8, 0.2)])
def test_hysteresis_of_a_slow_command_is_six_plays_in_parallel(spread, bend):
    plant = grown(AXIS, "valve_hysteresis")
    X, _ = run()
    t = np.arange(3000) * DT
    u = 0.05 * np.sin(2 * np.pi * 0.8 * t)
    values = {"width": 0.01, "spread": spread, "bend": bend}
    p = plant.vector({f"valve_hysteresis.{name}": value for name, value in values.items()})
    start = np.array(plant.model.start(p)[0]).ravel()
    start[plant.shared[0]] = X[0]
    states = simulate(plant.model, p, start, np.full(3000, DT), u[:, None]).states[0]
    names = [s.name for s in plant.model.states]
    side = np.array([-5, -3, -1, 1, 3, 5]) / 5
    widths = 0.01 * (1 + spread * side + bend * (side**2 - 70 / 150))
    assert widths.mean() == pytest.approx(0.01)
    for number, width in enumerate(widths, 1):
        memory = states[1:, names.index(f"valve_hysteresis.play_{number}")]
        assert np.abs(memory - played(u, width)[:-1]).max() < 4e-4


@pytest.mark.parametrize("m", [0.45, 0.5, 0.58])
def test_the_flow_with_another_critical_ratio_is_that_of_the_standard(m):
    """ISO 6358-1: (1 - ((r - b) / (1 - b))^2)^m of the choked flow beyond the critical ratio b."""
    plant, b = grown(AXIS, "critical_pressure_ratio"), 0.35
    name = "critical_pressure_ratio"
    p = plant.vector({f"{name}.shift": b - 0.5282818, f"{name}.subsonic_index": m})
    x = np.zeros(len(plant.model.states))
    names = [state.name for state in plant.model.states]

    def filling(ratio):
        """Flow into chamber A from supply, to within a constant: the piston stands still."""
        x[names.index("pressure_a")], x[names.index("pressure_b")] = 7e5 * ratio, 5e5
        return float(plant.model.rates(x, [0.5], p)[names.index("pressure_a")])

    for ratio in (0.3, 0.45, 0.6, 0.8, 0.95):
        standard = (1 - (max(ratio - b, 0) / (1 - b)) ** 2) ** m
        assert filling(ratio) / filling(0.2) == pytest.approx(standard, abs=2e-4)


def test_the_walls_of_the_other_chamber_may_take_another_share_of_heat():
    """Closed and at rest, with air 30 K too warm: P' = (K - 1) h A_w (T_w - T) / V."""
    plant, h, ratio = grown(AXIS, "heat_transfer"), 40.0, 1.7
    values = {"heat_transfer_coefficient": h, "b_over_a": ratio}
    p = plant.vector({f"heat_transfer.{k}": v for k, v in values.items()})
    names = [state.name for state in plant.model.states]
    x = np.zeros(len(names))
    for name, value in {"pressure_a": 4e5, "pressure_b": 4e5}.items():
        x[names.index(name)] = value
    for name in ("heat_transfer.temperature_a", "heat_transfer.temperature_b"):
        x[names.index(name)] = 323.0
    rates = np.array(plant.model.rates(x, [0.0], p)).ravel()
    bore, length = np.pi / 4 * 0.042**2, 0.13 + 0.005
    for chamber, area, share in (("a", bore, 1.0), ("b", bore - np.pi / 4 * 0.016**2, ratio)):
        wall = 2 * area + 2 * np.sqrt(np.pi * area) * length
        expected = 0.4 * share * h * wall * (293.0 - 323.0) / (area * length)
        assert rates[names.index(f"pressure_{chamber}")] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("u", [-0.4, 0.0, 0.3])
def test_a_chamber_with_heat_transfer_keeps_mass_and_energy(u):
    """m = P V / (R T) grows by what flows in, and m c_v T by enthalpy, work and heat, at any size worth a name."""
    h, plant, rng = 8.0, grown(AXIS, "heat_transfer"), np.random.default_rng(8)
    p = plant.vector({"heat_transfer.heat_transfer_coefficient": h})
    names, K, R, T_s = [s.name for s in plant.model.states], 1.4, 287.0, 293.0
    area, c_v = np.pi / 4 * 0.042**2, R / 0.4
    for x in plant.states(rng, 20):
        dx = np.array(plant.model.rates(x, [u], p)).ravel()
        value, rate = dict(zip(names, x, strict=True)), dict(zip(names, dx, strict=True))
        plain = np.array(plant.plain.rates(x[plant.shared[0]], [u], plant.plain.vector(plant.values))).ravel()
        P, T = value["pressure_a"], value["heat_transfer.temperature_a"]
        length = 0.13 + value["position"] + 0.005
        V, V_rate = area * length, area * value["velocity"]
        flow = (plain[2] * length / K + P * value["velocity"]) * area / (R * T_s)  # eq. 9 backwards
        m = P * V / (R * T)
        m_rate = m * (rate["pressure_a"] / P + V_rate / V - rate["heat_transfer.temperature_a"] / T)
        power = c_v / R * (rate["pressure_a"] * V + P * V_rate)  # d(m c_v T)/dt
        wall = h * (2 * area + np.pi * 0.042 * length) * (T_s - T)
        enthalpy = K * c_v * (max(flow, 0) * T_s - max(-flow, 0) * T)
        size = abs(enthalpy) + abs(wall) + abs(P * V_rate)
        assert power == pytest.approx(enthalpy - P * V_rate + wall, abs=5e-3 * size)
        assert m_rate == pytest.approx(flow, abs=5e-3 * (abs(flow) + size / (c_v * T)))


def test_two_masses_share_the_force():
    plant, rng, share = grown(AXIS, "compliant_load"), np.random.default_rng(9), 0.6
    values = {"load_share": share, "frequency": 25.0, "damping_ratio": 0.1}
    p = plant.vector({f"compliant_load.{name}": value for name, value in values.items()})
    names = [state.name for state in plant.model.states]
    v, load = names.index("velocity"), names.index("compliant_load.load_speed")
    for x in plant.states(rng, 20):
        both = np.array(plant.model.rates(x, [0.1], p)).ravel()
        stiff = np.array(
            plant.plain.rates(x[plant.shared[0]], [0.1], plant.plain.vector(plant.values))
        ).ravel()[1]
        assert (1 - share) * both[v] + share * both[load] == pytest.approx(stiff, rel=1e-9)


def test_a_spool_that_overshoots_opens_no_more_than_its_stops_let_it():
    plant = grown(AXIS, "valve_lag")
    p = plant.vector({"valve_lag.time_constant": 3e-3, "valve_lag.damping_ratio": 0.3})
    names = [state.name for state in plant.model.states]
    x = np.array(plant.model.start(p)[0]).ravel()
    u = inputs_of(plant.model, np.ones(1))[0]
    rises = []
    for spool in (0.9, 1.0, 1.4):
        x[names.index("valve_lag.spool")] = spool
        rises.append(float(plant.model.rates(x, u, p)[names.index("pressure_a")]))
    assert rises[0] < 0.95 * rises[1] and rises[2] == pytest.approx(rises[1], rel=1e-3)


def test_a_spool_far_behind_moves_at_its_fastest():
    """Written down anew: at 2 z t s' = e the speed is e / (2 z t), and no more than the linear range lets it be."""
    plant = grown(AXIS, "valve_lag")
    time, damping, reach = 8e-3, 2.5, 0.3
    shape = {"time_constant": time, "damping_ratio": damping, "linear_range": reach}
    p = plant.vector({f"valve_lag.{name}": value for name, value in shape.items()})
    start = np.array(plant.model.start(p)[0]).ravel()
    held = np.full(100, DT / 5)
    run = simulate(plant.model, p, start, held, inputs_of(plant.model, np.ones(100))).states[0]
    spool = run[:, [state.name for state in plant.model.states].index("valve_lag.spool")]
    pace = np.diff(spool)[-40:] / (DT / 5)
    assert spool[-1] < 1.0 - reach  # still far behind
    assert pace == pytest.approx(reach / (2 * damping * time), rel=0.01)


def test_a_cushion_at_one_end_leaves_the_other_alone():
    X, u = run()
    none, far, near = (
        simulated("end_cushioning", {"throttling": t, "length": 0.1, "side": side}, u, X[0])[0]
        for t, side in ((0.0, 0.0), (50.0, 1.0), (50.0, -1.0))
    )
    inside = none[:, 0] > 0.03  # from the far end's side of the middle on, its cushion may work
    first = int(np.argmax(inside))
    assert inside.any() and np.abs(far - none)[:first, 0].max() < 1e-9
    assert np.abs(near - none)[:, 0].max() > 1e-4


def test_a_drift_settles_at_its_rate_times_its_time():
    X, u = run()
    states, shown, _ = simulated("sensor_drift", {"rate": 1e-3, "settling_time": 0.5}, u, X[0])
    time = (np.arange(len(shown)) + 0.5) * DT  # a sample shows the middle of its interval
    assert shown - states[:, 0] == pytest.approx(5e-4 * (1 - np.exp(-time / 0.5)), abs=1e-9)


def at_of(values, time, rate):
    """What a channel shows whose clock runs otherwise."""
    return np.interp(time * (1 - rate), time, values)


@pytest.mark.parametrize(
    ("rate", "others", "error"), [(2e-3, 1.0, 0.05), (2e-3, 0.5, 0.05), (2e-3, 0.0, 0.004), (-2e-3, 1.0, 0.2)]
)
def test_a_clock_that_drifts_shows_the_motion_of_another_time(rate, others, error):
    X, u = run()
    plain, shown, _ = simulated("clock_drift", {"rate": 0.0}, u, X[0])
    states, drifted, _ = simulated("clock_drift", {"rate": rate, "others": others}, u, X[0])
    time = np.arange(len(shown)) * DT
    whole = slice(200, -200)
    at = at_of(shown, time, rate)
    moved = np.abs(at - shown)[whole].max()
    # Late with the others it is exact but for the lines between held commands; alone and late it is what it moved
    # meanwhile; alone and early it is carried on.
    assert np.abs(drifted - at)[whole].max() < error * moved
    then = at_of(plain[:, 2], time, max(rate, 0.0) * others)
    assert (
        np.abs(states[:, 2] - then)[whole].max()
        < 0.1 * np.abs(plain[:, 2] - at_of(plain[:, 2], time, 2e-3)).max()
    )


def test_a_bend_of_the_sensor_is_the_sum_of_its_shapes():
    X, u = run()
    sizes = {"zero": 1e-3, "slope": -5e-4, "bow": 3e-4, "curl": -2e-4}
    sizes |= {f"{name}_{k}": 1e-4 * k * sign for k in (2, 3, 4) for name, sign in (("bow", 1), ("curl", -1))}
    states, shown, _ = simulated("sensor_nonlinearity", sizes, u, X[0])
    way = states[:, 0] / 0.26
    bent = sizes["zero"] + sizes["slope"] * 2 * way
    for k in (1, 2, 3, 4):
        end = "" if k == 1 else f"_{k}"
        bent = bent + sizes[f"bow{end}"] * np.cos((2 * k - 1) * np.pi * way)
        bent = bent + sizes[f"curl{end}"] * np.sin(2 * k * np.pi * way)
    assert shown - states[:, 0] == pytest.approx(bent, abs=1e-12)
    assert np.ptp(bent) > 5e-4


def test_a_conical_spear_throttles_less_before_it_is_home():
    X, u = run()
    none, straight, conical = (
        simulated("end_cushioning", {"throttling": t, "length": 0.1, "side": 0.0, "taper": taper}, u, X[0])[0]
        for t, taper in ((0.0, 0.0), (50.0, 0.0), (50.0, 50.0))
    )
    away = [np.abs(one - none)[:, 0].max() for one in (straight, conical)]
    assert 0.0 < away[1] < 0.8 * away[0]


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_a_supply_sags_by_a_power_of_what_is_drawn(power):
    """Flow into a chamber is choked: as much less as the supply pressure is."""
    plant = grown(AXIS, "supply_droop")
    names = [state.name for state in plant.model.states]
    drawn, at = 5e-3, names.index("supply_droop.flow")
    rises = []
    for droop in (0.0, 1e5):
        p = plant.vector({"supply_droop.droop": droop, "supply_droop.exponent": power})
        x = np.array(plant.model.start(p)[0]).ravel()
        x[names.index("pressure_a")], x[at] = 1.2e5, drawn
        u = inputs_of(plant.model, np.full(1, 0.5))[0]
        rises.append(float(plant.model.rates(x, u, p)[names.index("pressure_a")]))
    supply = plant.values["supply_pressure"]
    assert 1 - rises[1] / rises[0] == pytest.approx(1e5 * 0.5**power / supply, rel=1e-3)


def pushed(effect, values, x=0.0, v=0.0, pressures=4e5, clock=0.0):
    """Force that an effect adds to the axis, N; its own states stand where a record begins."""
    plant = grown(AXIS, effect)
    names, found = [state.name for state in plant.model.states], []
    u = [clock if port.role == CLOCK else 0.0 for port in plant.model.inputs]
    for chosen in (values, {}):
        p = plant.vector({f"{effect}.{name}": value for name, value in chosen.items()})
        state = np.array(plant.model.start(p)[0]).ravel()
        for name, value in (("position", x), ("velocity", v), ("bristle", np.sign(v))):
            state[names.index(name)] = value
        state[names.index("pressure_a")] = state[names.index("pressure_b")] = pressures
        found.append(float(plant.model.rates(state, u, p)[names.index("velocity")]))
    return (found[0] - found[1]) * plant.values["payload_mass"]


def test_a_swinging_force_has_its_third_harmonic():
    values = {"amplitude": 7.0, "frequency": 3.0, "phase": 0.4, "third_in_phase": 0.2, "third_across": -0.1}
    for time in (0.0, 0.03, 0.11, 0.27):
        turn = 2 * np.pi * 3.0 * time + 0.4
        force = 7.0 * (np.sin(turn) + 0.2 * np.sin(3 * turn) - 0.1 * np.cos(3 * turn))
        assert pushed("periodic_disturbance", values, clock=time) == pytest.approx(force, rel=1e-6)


def test_friction_may_rise_from_a_place_on():
    place, ahead, behind = 0.02, 4.0, -1.5
    values = {"rise": 0.0, "place": place, "width": 0.03, "slope_ahead": ahead, "slope_behind": behind}
    full = grown(AXIS, "position_dependent_friction").values["coulomb_friction"]
    for x in (-0.1, 0.0, 0.05, 0.12):
        share = ahead * max(x - place, 0.0) + behind * max(place - x, 0.0)
        for v in (0.3, -0.3):
            force = pushed("position_dependent_friction", values, x=x, v=v)
            assert force == pytest.approx(-np.sign(v) * full * share, rel=1e-6, abs=1e-9)


def test_a_tight_spot_may_have_an_edge():
    """Of free ending it follows an arch of cosine to half a percent, and becomes a bell where it has no edge."""
    full = grown(AXIS, "position_dependent_friction").values["coulomb_friction"]
    for width, ending, expected in (
        (0.6415, 2.632, lambda z: 0.5 + 0.5 * np.cos(np.pi * z) if abs(z) < 1 else 0.0),
        (1.0, 50.0, lambda z: np.exp(-(z**2))),
    ):
        values = {"rise": 0.5, "place": -0.02, "width": 0.03 * width, "ending": ending}
        for z in (-1.6, -0.99, -0.5, 0.0, 0.2, 0.8, 1.01):
            force = pushed("position_dependent_friction", values, x=-0.02 + 0.03 * z, v=0.3)
            assert force == pytest.approx(-full * 0.5 * expected(z), abs=0.006 * full * 0.5)


@pytest.mark.full
def test_a_seal_that_slips_part_by_part_remembers_an_inner_reversal():
    """Friction of parts drawn to and fro, beside elements that are elastic until they slip (Iwan's, written anew)."""
    plant, distance, step = grown(AXIS, "presliding"), 2e-4, 1e-4
    values = {"distance": distance, "spread": 0.6, "bend": 0.2, "micro_damping": 0.0}
    p = plant.vector(
        {f"presliding.{name}": value for name, value in values.items()} | {"bristle_damping": 0.0}
    )
    names, u = [state.name for state in plant.model.states], inputs_of(plant.model, np.zeros(1))[0]
    speed = names.index("velocity")
    mine = [names.index(f"presliding.part_{number}") for number in range(1, 7)]
    sides = np.array([-1, -0.6, -0.2, 0.2, 0.6, 1])
    yields = distance * (1 + 0.6 * sides + 0.2 * (sides**2 - np.mean(sides**2)))
    ways = np.interp(np.arange(0, 6.0, step), [0, 1, 2, 3, 4, 6], [0, 4e-4, 1e-4, 2.5e-4, 1e-4, 6e-4])
    x, z, worst = np.array(plant.model.start(p)[0]).ravel(), np.zeros(6), 0.0
    free = x.copy()
    for before, after in itertools.pairwise(ways):
        x[speed] = free[speed] = (after - before) / step
        rates, without = (np.array(plant.model.rates(at, u, p)).ravel() for at in (x, free))
        held = (
            (without[speed] - rates[speed]) * plant.values["payload_mass"] / plant.values["coulomb_friction"]
        )
        worst = max(worst, abs(held - z.mean()))
        x[mine] += step * rates[mine]
        z = np.clip(z + (after - before) / yields, -1.0, 1.0)
    assert z == pytest.approx(1.0) and worst < 1e-3


@pytest.mark.parametrize(("bent_by", "damped"), [(0.0, 1.0), (1e-3, 0.0)])
def test_a_seal_is_damped_while_it_holds_and_not_while_it_slips(bent_by, damped):
    plant, speed = grown(AXIS, "presliding"), 0.02
    names, u = [state.name for state in plant.model.states], inputs_of(plant.model, np.zeros(1))[0]
    x = np.array(plant.model.start(plant.vector({}))[0]).ravel()
    x[names.index("velocity")] = speed
    for number in range(1, 7):
        x[names.index(f"presliding.part_{number}")] = bent_by
    without, rates = (
        np.array(
            plant.model.rates(
                x, u, plant.vector({"presliding.distance": 2e-4, "presliding.micro_damping": much})
            )
        ).ravel()[names.index("velocity")]
        for much in (0.0, 500.0)
    )
    force = (without - rates) * plant.values["payload_mass"]
    assert force == pytest.approx(damped * 500.0 * speed, abs=1e-9)


def test_a_recording_may_have_its_own_phase_of_a_disturbance():
    plant = grown(AXIS, "periodic_disturbance")
    names = [state.name for state in plant.model.states]
    u = inputs_of(plant.model, np.zeros(1))[0]

    def push(phase, sine, cosine):
        p = plant.vector(
            {
                f"periodic_disturbance.{n}": v
                for n, v in (("amplitude", 7.0), ("frequency", 3.0), ("phase", phase))
            }
        )
        x = np.array(plant.model.start(p)[0]).ravel()
        x[names.index("periodic_disturbance.sine")] = sine
        x[names.index("periodic_disturbance.cosine")] = cosine
        return float(plant.model.rates(x, u, p)[names.index("velocity")])

    turned = push(1.0, np.cos(2.2) - np.cos(1.0), np.sin(2.2) - np.sin(1.0))
    assert turned == pytest.approx(push(2.2, 0.0, 0.0), rel=1e-12)
    assert turned != pytest.approx(push(1.0, 0.0, 0.0), rel=1e-3)


@pytest.mark.parametrize("second", [0.0, 1.0])
def test_a_lagging_sensor_is_a_filter_of_first_or_second_order(second):
    time = 8e-3
    X, u = run()
    states, shown, _ = simulated("sensor_lag", {"time_constant": time, "second": second}, u, X[0])
    want, fine = states[:, 0], 50
    for constant in (time, second * time):
        if constant > 0.0:  # the motion is smooth: straight lines between samples, in fine steps
            at = np.interp(np.arange(fine * len(want)) / fine, np.arange(len(want)), want)
            lagged, keep = np.empty_like(at), np.exp(-DT / fine / constant)
            lagged[0] = at[0]
            for k in range(1, len(at)):
                lagged[k] = keep * lagged[k - 1] + (1 - keep) * at[k]
            want = lagged[::fine]
    after = slice(200, None)  # the start is forgotten
    assert np.abs(shown - want)[after].max() < 0.02 * np.abs(shown - states[:, 0])[after].max()
    assert np.abs(shown - states[:, 0])[after].max() > 1e-4


EDGES = {"forwards_wider": 0.1, "supply_wider": -0.2, "chamber_a_wider": 0.15}
OVERLAPS = {
    "supply_a": 1.05,
    "exhaust_b": 1.15,
    "supply_b": 0.55,
    "exhaust_a": 1.25,
}  # 1 +- each share of EDGES


def edge_openings(effect, values, spool):
    """What each chamber's flow says of its open edge, as a way of the spool: chokes at 7 to 1 bar, so goes with it."""
    plant = grown(AXIS, effect)
    names = [state.name for state in plant.model.states]
    x = np.zeros(len(names))

    def rates(u, p):
        found = plant.model.rates(x, [u], p)
        return np.array([float(found[names.index(name)]) for name in ("pressure_a", "pressure_b")])

    x[names.index("pressure_a")], x[names.index("pressure_b")] = 3e5, 3e5
    plain = plant.vector()
    per_way = {way: rates(way * 0.5, plain) / 0.5 for way in (1.0, -1.0)}
    way = 1.0 if spool > 0 else -1.0
    p = plant.vector({f"{effect}.{name}": value for name, value in values.items()})
    return rates(spool, p) / per_way[way]


@pytest.mark.parametrize("spool", [0.035, 0.045, 0.2, -0.03, -0.045, -0.2])
def test_every_edge_of_a_dead_band_opens_at_its_own_place(spool):
    found = edge_openings("valve_deadband", {"width": 0.04, **EDGES}, spool)
    of_a, of_b = ("supply_a", "exhaust_b") if spool > 0 else ("exhaust_a", "supply_b")
    for opening, name in zip(found, (of_a, of_b), strict=True):
        assert opening == pytest.approx(max(abs(spool) - 0.04 * OVERLAPS[name], 0.0), abs=1e-9)


def test_a_rounded_edge_opens_gradually_and_then_lags_by_its_rounding():
    """By a parabola that ends in the straight line of its slope, by z^2 / (z + r), or half of each."""
    lag = 0.5 * 0.04
    for beyond in (0.001, 0.01, 0.03, 0.06, 0.4):
        slopes = np.minimum(np.linspace(0.0, beyond, 100001) / (2 * lag), 1.0)
        arc, worn = float(np.mean(slopes) * beyond), beyond**2 / (beyond + lag)
        for tail, opening in ((0.0, arc), (1.0, worn), (0.5, (arc + worn) / 2)):
            values = {"width": 0.04, "rounding": 0.5, "rounding_tail": tail}
            found = edge_openings("valve_deadband", values, 0.04 + beyond)
            assert found[0] == pytest.approx(opening, rel=1e-4)


@pytest.mark.parametrize(("fading", "passes"), [(0.0, "sum"), (1.0, "diagonal")])
def test_an_edge_leaks_beside_its_opening_or_by_a_clearance_across_it(fading, passes):
    plant = grown(AXIS, "valve_underlap")
    wide, discharge = plant.values["port_width"], plant.values["discharge_coefficient"]
    leak = 2e-7
    gap = leak / discharge / (wide * plant.values["spool_travel"])  # as a share of the spool's travel
    values = {"null_leakage": leak, "leak_fading": fading}
    for spool in (0.01, 0.3):
        found = edge_openings("valve_underlap", values, spool)
        # At 3 bar both ports are choked: supply passes 7 / 3 as much as exhaust, per opening.
        into = spool + gap if passes == "sum" else math.hypot(spool, gap)
        assert found[0] == pytest.approx(into - gap * 3 / 7, rel=2e-3)


@pytest.mark.parametrize("exponent", [1.75, 2.0, 2.5])
def test_a_drag_grows_with_a_power_of_the_speed(exponent):
    plant = grown(AXIS, "quadratic_drag")
    names = [state.name for state in plant.model.states]
    values = {"quadratic_drag.drag": 40.0, "quadratic_drag.exponent": exponent}
    for v in (0.2, 1.0, -0.7):
        x = np.zeros(len(names))
        x[names.index("pressure_a")] = x[names.index("pressure_b")] = 3e5
        x[names.index("velocity")] = v
        with_it, plain = (
            float(plant.model.rates(x, [0.0], p)[names.index("velocity")])
            for p in (plant.vector(values), plant.vector())
        )
        force = plant.values["payload_mass"] * (with_it - plain)
        assert force == pytest.approx(-40.0 * np.sign(v) * abs(v) ** exponent, rel=2e-3)


def test_every_edge_of_an_underlap_closes_at_its_own_place():
    """At a spool that still overlaps both ways: supply and exhaust of chamber A are open by w f + s and w f - s."""
    width, spool = 0.02, 0.005
    found = edge_openings("valve_underlap", {"width": width, **EDGES}, spool)
    plant = grown(AXIS, "valve_underlap")
    names = [state.name for state in plant.model.states]
    x = np.zeros(len(names))
    x[names.index("pressure_a")], x[names.index("pressure_b")] = 3e5, 3e5
    filling = float(plant.model.rates(x, [0.5], plant.vector())[names.index("pressure_a")]) / 0.5
    venting = float(plant.model.rates(x, [-0.5], plant.vector())[names.index("pressure_a")]) / 0.5
    net = (spool + width * OVERLAPS["supply_a"]) * filling + (width * OVERLAPS["exhaust_a"] - spool) * venting
    assert found[0] * filling == pytest.approx(net, rel=1e-6)


@pytest.mark.parametrize(("u", "passes"), [(0.5, 0.44), (-0.5, -0.36), (0.43, 0.43), (-0.35, -0.35)])
def test_a_spool_has_a_stop_at_either_end(u, passes):
    plant = grown(AXIS, "valve_saturation")
    values = {"loss": 1.0, "limit": 0.4, "skew": 0.1}
    p, plain = plant.vector({f"valve_saturation.{k}": v for k, v in values.items()}), plant.vector()
    x = np.array(plant.model.start(plain)[0]).ravel()
    np.testing.assert_allclose(plant.model.rates(x, [u], p), plant.model.rates(x, [passes], plain), rtol=1e-9)


def test_a_spring_hardens_by_the_cube_and_steepens_beyond():
    plant = grown(AXIS, "spring_load")
    values = {"stiffness": 200.0, "relaxed_position": 0.02, "hardening": 1.5, "steepening": 0.04}
    p, plain = plant.vector({f"spring_load.{k}": v for k, v in values.items()}), plant.vector()
    x = np.array(plant.model.start(plain)[0]).ravel()
    names = [state.name for state in plant.model.states]
    for place in (-0.08, 0.02, 0.07):
        x[names.index("position")] = place
        change = plant.model.rates(x, [0.0], p) - plant.model.rates(x, [0.0], plain)
        drawn = place - 0.02
        force = -200.0 * drawn * (1 + 1.5 * (drawn / 0.1) ** 2 + 0.04 * (drawn / 0.1) ** 4)
        mass = plain[plant.model.index("payload_mass")]
        assert float(change[names.index("velocity")]) == pytest.approx(force / mass, abs=1e-9)


@pytest.mark.parametrize("b", [0.2, 0.5, 0.55])
@pytest.mark.parametrize("flow", [0.0, 1e-3, 4e-3, 8e-3, 0.02])
def test_the_pressure_behind_a_restriction_drives_the_standards_flow(b, flow):
    """ISO 6358-1, P / R sqrt(1 - ((P_e / P - b) / (1 - b))^2), from the pressure back to the flow."""
    resistance, ahead = 3e7, 1e5
    P, slope = (float(v) for v in behind(ca.DM(flow), ca.DM(resistance), ca.DM(b), ca.DM(ahead)))
    subsonic = max((ahead / P - b) / (1 - b), 0.0)
    assert P / resistance * np.sqrt(1 - subsonic**2) == pytest.approx(flow, rel=1e-9, abs=1e-9)
    further = float(behind(ca.DM(flow + 1e-8), ca.DM(resistance), ca.DM(b), ca.DM(ahead))[0])
    assert (further - P) / 1e-8 == pytest.approx(slope, rel=1e-4, abs=500.0)  # Pa s/kg; a resistance is 3e7


def test_a_manifold_keeps_its_mass():
    """V / (R T) dP/dt is what the valve lets out less what the restriction lets out, beside a lag of 1 ms."""
    plant, volume = grown(AXIS, "exhaust_restriction"), 4e-5
    values = {"back_pressure": 4e5, "critical_ratio": 0.4, "manifold": volume}
    p = plant.vector({f"exhaust_restriction.{k}": v for k, v in values.items()})
    names = [state.name for state in plant.model.states]
    x = np.zeros(len(names))
    x[names.index("pressure_a")], x[names.index("pressure_b")] = 5e5, 3e5
    m = names.index("exhaust_restriction.flow")
    x[m] = 3e-3
    P, slope = (float(v) for v in behind(ca.DM(x[m]), ca.DM(4e7), ca.DM(0.4), ca.DM(1e5)))
    rate = float(plant.model.rates(x, [-0.3], p)[m])  # A is vented, and choked: it does not see P
    C_0 = np.sqrt(1.4 / 287 * (2 / 2.4) ** (2.4 / 0.4))
    q = {
        name: float(p[plant.model.index(name)])
        for name in ("port_width", "spool_travel", "discharge_coefficient")
    }
    out = q["discharge_coefficient"] * C_0 * 5e5 / np.sqrt(293.0) * q["port_width"] * 0.3 * q["spool_travel"]
    assert 1e5 < P < 0.5 * 5e5
    assert rate * (1e-3 + volume / 84e3 * slope) == pytest.approx(out - x[m], rel=1e-5)


@pytest.mark.parametrize(("exponent", "times"), [(1.0, 1.0), (2.0, 0.5)])
def test_a_volume_behind_a_line_fills_by_the_slope_of_the_lines_law(exponent, times):
    """At half the flow of 10 g/s a law of power 2 is half as steep, and the lag half as long; 2.2 ms come on top."""
    plant, recovery = grown(AXIS, "supply_droop"), 0.05
    values = {"droop": 1e4, "recovery_time": recovery, "exponent": exponent}
    p = plant.vector({f"supply_droop.{k}": v for k, v in values.items()})
    names = [state.name for state in plant.model.states]
    x = np.zeros(len(names))
    x[names.index("pressure_a")], x[names.index("pressure_b")] = 3e5, 3e5
    x[names.index("supply_droop.flow")] = 5e-3
    closed = float(plant.model.rates(x, [0.0], p)[names.index("supply_droop.flow")])
    sag, choking = 1e4 * 0.5**exponent, 0.5 * 7e5
    delivered = 5e-3 * (1 - sag / (2 * choking)) ** (1 / exponent)
    assert closed == pytest.approx(-delivered / (2.2e-3 + times * recovery), rel=1e-4)


@pytest.mark.parametrize("b", [0.2, 0.5])
@pytest.mark.parametrize("sag", [1e3, 1e5, 2.5e5, 4.5e5])
def test_a_line_delivers_the_standards_flow(b, sag):
    """ISO 6358-1, P_s C sqrt(1 - ((P / P_s - b) / (1 - b))^2) above b, P_s C below; no air is drawn."""
    plant, droop = grown(AXIS, "supply_droop"), 3e5
    values = {"droop": droop, "recovery_time": 0.05, "exponent": 2.0, "critical_ratio": b}
    p = plant.vector({f"supply_droop.{k}": v for k, v in values.items()})
    names = [state.name for state in plant.model.states]
    x, q = np.zeros(len(names)), 0.01 * np.sqrt(sag / droop)
    x[names.index("pressure_a")], x[names.index("pressure_b")] = 3e5, 3e5
    x[names.index("supply_droop.flow")] = q
    rate = float(plant.model.rates(x, [0.0], p)[names.index("supply_droop.flow")])
    choked = 0.01 * np.sqrt((1 - b) * 7e5 / (2 * droop))
    exact = choked * np.sqrt(1 - max(((7e5 - sag) / 7e5 - b) / (1 - b), 0.0) ** 2)
    assert -rate * (2.2e-3 + 0.05 * q / 0.01) == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize(
    ("exponent", "tail", "curve"),
    [
        (1.0, 0.01, lambda z: np.exp(-z)),
        (2.0, 0.01, lambda z: np.exp(-(z**2))),
        (2.0, 1.0, lambda z: 1 / (1 + z**2)),
    ],
)
def test_friction_of_steady_sliding_falls_along_the_stribeck_curve(exponent, tail, curve):
    """Friction of steady sliding over the level far from rest, with the bristle where it then stands."""
    plant, ratio, speed = grown(AXIS, "stribeck_friction"), 1.6, 0.02
    values = {"breakaway_ratio": ratio, "stribeck_speed": speed, "exponent": exponent, "tail": tail}
    p = plant.vector({f"stribeck_friction.{k}": v for k, v in values.items()})
    names = [state.name for state in plant.model.states]
    q = {
        name: float(p[plant.model.index(name)])
        for name in ("coulomb_friction", "viscous_friction", "payload_mass")
    }
    for v in (5e-3, 0.02, 0.06):
        share = 1 + (ratio - 1) * curve(v / speed)
        x = np.zeros(len(names))
        x[names.index("pressure_a")], x[names.index("pressure_b")] = 4e5, 4e5
        sliding = []
        for speed_now, bristle in ((v, share), (-v, -share)):  # the pressures' force goes out
            x[names.index("velocity")], x[names.index("bristle")] = speed_now, bristle
            sliding.append(float(plant.model.rates(x, [0.0], p)[names.index("velocity")]) * q["payload_mass"])
        drag = (sliding[1] - sliding[0]) / 2 - q["viscous_friction"] * v
        assert drag / q["coulomb_friction"] == pytest.approx(share, rel=2e-3)


@pytest.mark.parametrize(("power", "grown_by"), [(1.0, 0.5), (2.0, 0.25)])
def test_a_needle_grows_by_the_power_of_the_distance(power, grown_by):
    """Half way into the cushion of a chamber that vents, choked: valve and needle in series."""
    plant, throttling, taper, length = grown(AXIS, "end_cushioning"), 30.0, 8.0, 0.02
    values = {"throttling": throttling, "length": length, "taper": taper, "taper_power": power}
    p = plant.vector({f"end_cushioning.{k}": v for k, v in values.items()})
    names = [state.name for state in plant.model.states]
    middle = float(p[plant.model.index("stroke")]) / 2 - length / 2
    at, free = (vented(plant, names, middle, q) for q in (p, plant.vector()))
    in_series = 1 / np.sqrt(1 + (throttling * 0.5 / (1 + taper * grown_by)) ** 2)
    assert at / free == pytest.approx(in_series, rel=1e-3)


@pytest.mark.parametrize("entry", [5e-4, 4e-3])
def test_a_spear_closes_its_bore_over_its_entry(entry):
    """Half way through, half of the throttling is there, be the entry sharp or long."""
    plant, throttling, length = grown(AXIS, "end_cushioning"), 30.0, 0.02
    values = {"throttling": throttling, "length": length, "taper": 0.0, "entry": entry}
    p = plant.vector({f"end_cushioning.{k}": v for k, v in values.items()})
    names, half = [state.name for state in plant.model.states], float(p[plant.model.index("stroke")]) / 2
    for inside, share in ((0.0, 0.0), (0.5, 0.5), (1.0, 1.0)):
        in_series = 1 / np.sqrt(1 + (throttling * share * 0.5) ** 2)
        at, free = (vented(plant, names, half - length + inside * entry, q) for q in (p, plant.vector()))
        assert at / free == pytest.approx(in_series, rel=1e-6)


def vented(plant, names, position, p):
    """Rate of a chamber's pressure that vents, choked, at half of full command."""
    x = np.zeros(len(names))
    x[names.index("position")] = position
    x[names.index("pressure_a")], x[names.index("pressure_b")] = 4e5, 4e5
    return float(plant.model.rates(x, [0.5], p)[names.index("pressure_b")])


@pytest.mark.parametrize("settling", [2.0, 1e4])
def test_friction_drifts_by_itself_or_by_its_logarithm(settling):
    plant, rate = grown(AXIS, "friction_drift"), -0.05
    names = [state.name for state in plant.model.states]
    clock = [port.role for port in plant.model.inputs].index("clock")
    x = np.zeros(len(names))
    x[names.index("pressure_a")], x[names.index("pressure_b")] = 4e5, 4e5
    x[names.index("velocity")], x[names.index("bristle")] = 0.1, 1.0
    for t in (0.5, 3.0, 8.0):
        e = rate * settling * (1 - np.exp(-t / settling))
        for straightness, expected in ((1.0, 1 + e), (0.05, np.exp(e))):
            lost = []
            for r in (0.0, rate):
                p = plant.vector(
                    {
                        "friction_drift.rate": r,
                        "friction_drift.settling_time": settling,
                        "friction_drift.straightness": straightness,
                    }
                )
                u = np.zeros(len(plant.model.inputs))
                u[clock] = t
                lost.append(float(plant.model.rates(x, u, p)[names.index("velocity")]))
            coulomb, mass = p[plant.model.index("coulomb_friction")], p[plant.model.index("payload_mass")]
            assert 1 - (lost[1] - lost[0]) * mass / coulomb == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(("samples", "interval"), [(3.0, 0.0), (1.5, 2 * DT)])
def test_an_input_comes_late_exactly_whatever_the_rate_it_was_counted_at(samples, interval):
    plant = grown("emps", "delay@drive.command")
    assert plant.model.states == plant.plain.states  # no lags stand in for it
    u = np.random.default_rng(7).choice([-5.0, 5.0], 400)
    late = np.r_[np.full(3, u[0]), u][:400]
    own = {"delay@drive.command.samples": samples, "delay@drive.command.interval": interval}
    p, plain = plant.vector(own), plant.plain.vector(plant.values)
    start, dt = np.array(plant.plain.start(plain)[0]).ravel(), np.full(400, DT)
    delayed = simulate(plant.model, p, start, dt, inputs_of(plant.model, u)).states
    shifted = simulate(plant.plain, plain, start, dt, inputs_of(plant.plain, late)).states
    assert delayed == pytest.approx(shifted, abs=1e-5)  # steps of the integrator differ
    assert (
        np.abs(shifted - simulate(plant.plain, plain, start, dt, inputs_of(plant.plain, u)).states).max()
        > 0.1
    )
