"""Mass flows, chamber balances, and the pressures before and behind the valve."""

import math

from numba import njit

from studies.independent_rig.states import CREEP_A, CREEP_B, PA, PB, PE, PS, TA, TB, V, X
from studies.independent_rig.valve import opening

CHOKED = 0.040418  # sqrt(K (2/(K+1))^((K+1)/(K-1)) / R) of air, for laminar leaks only


@njit(cache=True)
def orifice(rig, area, upstream, downstream):
    """Mass flow from upstream to downstream, kg/s: choked below the critical ratio, isentropic above it."""
    K = rig.heat_ratio
    ratio = downstream / upstream
    critical = (2.0 / (K + 1.0)) ** (K / (K - 1.0))
    if rig.critical_ratio > 0.0:  # the ellipse of ISO 6358
        b = rig.critical_ratio
        share = 1.0 if ratio <= b else max(1.0 - ((ratio - b) / (1.0 - b)) ** 2, 0.0) ** rig.flow_exponent
        psi = math.sqrt(K * (2.0 / (K + 1.0)) ** ((K + 1.0) / (K - 1.0))) * share
    elif ratio <= critical:
        psi = math.sqrt(K * (2.0 / (K + 1.0)) ** ((K + 1.0) / (K - 1.0)))
    else:
        psi = math.sqrt(2.0 * K / (K - 1.0) * max(ratio ** (2.0 / K) - ratio ** ((K + 1.0) / K), 0.0))
    return rig.discharge * area * upstream * psi / math.sqrt(rig.gas_constant * rig.temperature)


@njit(cache=True)
def through(rig, area, P_one, P_two):
    """Flow from one to two, kg/s, negative when it goes back."""
    return orifice(rig, area, P_one, P_two) if P_one >= P_two else -orifice(rig, area, P_two, P_one)


@njit(cache=True)
def leak(rig, area, P_one, P_two):
    """A leak, kg/s: an orifice, or a narrow gap that passes as much choked air at 5 bar."""
    if rig.leak_laminar == 0.0:
        return through(rig, area, P_one, P_two)
    gap = (P_one * P_one - P_two * P_two) / 5e5
    return rig.discharge * area * CHOKED * gap / math.sqrt(rig.temperature)


@njit(cache=True)
def cushioned(rig, area, gap):
    """Area of an exhaust edge in series with the cushion of an end that is `gap` metres away."""
    if rig.cushion_length == 0.0 or gap >= rig.cushion_length or area <= 0.0:
        return area
    free = max(gap, 0.0) / rig.cushion_length
    spear = rig.cushion_area * (1.0 + 15.0 * free * free)  # it tapers
    return area * spear / math.sqrt(area * area + spear * spear)


@njit(cache=True)
def ports(rig, t, s):
    """Pressures at the valve's supply and exhaust ports, Pa."""
    supply, exhaust = rig.supply_pressure, rig.exhaust_pressure
    if rig.reservoir > 0.0:
        supply = s[PS]
    if rig.pulsation > 0.0:
        supply = supply * (1.0 + rig.pulsation * math.sin(2.0 * math.pi * rig.pulsation_frequency * t))
    if rig.silencer > 0.0:
        exhaust = s[PE]
    return supply, exhaust


@njit(cache=True)
def edge_flows(rig, supply, exhaust, spool, P, x, way):
    """Flows into one chamber over its supply and its exhaust edge, kg/s; `way` +1 for A, -1 for B."""
    overlap_s = rig.overlap_supply_a if way > 0.0 else rig.overlap_supply_b
    overlap_e = rig.overlap_exhaust_a if way > 0.0 else rig.overlap_exhaust_b
    lift = spool * rig.spool_travel * way
    if rig.flow_force > 0.0:
        lift *= 1.0 - rig.flow_force * (supply - P) / supply
    fill = rig.port_width * opening(rig, lift, overlap_s)
    vent = rig.port_width * opening(rig, -lift, overlap_e)
    into, out = 0.0, 0.0
    if fill > 0.0:
        into = through(rig, fill, supply, P)
    if vent > 0.0:
        # The chamber that a moving piston empties ends at its own end of the stroke.
        if exhaust < P and rig.cushion_side * way <= 0.0:
            vent = cushioned(rig, vent, rig.stroke / 2.0 + way * x)
        out = through(rig, vent, exhaust, P)
    return into, out


@njit(cache=True)
def chamber_rates(rig, P, T, volume, widening, area, into, out):
    """Pressure (Pa/s) and temperature (K/s) of a chamber with flows in and out (both counted inwards)."""
    K, R = rig.heat_ratio, rig.gas_constant
    if rig.wall_heat == 0.0:
        heat = R * rig.temperature
        return K / volume * (heat * (into + out) - P * widening), 0.0
    enthalpy = 0.0
    for flow in (into, out):
        enthalpy += R * flow * (rig.temperature if flow > 0.0 else T)
    wall = 2.0 * area + math.pi * rig.bore * volume / area
    q = rig.wall_heat * wall * (rig.temperature - T)
    rate = (K * (enthalpy - P * widening) + (K - 1.0) * q) / volume
    warming = T * (rate / P + widening / volume) - R * T * T * (into + out) / (P * volume)
    return rate, warming


@njit(cache=True)
def air_rates(rig, t, spool, s, dy):
    """Balances of both chambers, reservoir, manifold and tube walls; fills its part of `dy`."""
    x, v, Pa, Pb = s[X], s[V], s[PA], s[PB]
    area_a = math.pi / 4.0 * rig.bore**2
    area_b = area_a - math.pi / 4.0 * rig.rod**2
    volume_a = area_a * (rig.stroke / 2.0 + rig.residual_length + x)
    volume_b = area_b * (rig.stroke / 2.0 + rig.residual_length - x)
    supply, exhaust = ports(rig, t, s)
    in_a, out_a = edge_flows(rig, supply, exhaust, spool, Pa, x, 1.0)
    in_b, out_b = edge_flows(rig, supply, exhaust, spool, Pb, x, -1.0)
    from_supply, to_exhaust = in_a + in_b, -(out_a + out_b)
    if rig.leak_cross > 0.0:
        cross = leak(rig, rig.leak_cross, Pa, Pb)
        out_a, in_b = out_a - cross, in_b + cross
    if rig.leak_a > 0.0:
        out_a -= leak(rig, rig.leak_a, Pa, rig.atmospheric_pressure)
    if rig.leak_b > 0.0:
        out_b -= leak(rig, rig.leak_b, Pb, rig.atmospheric_pressure)
    if rig.relief > 0.0:
        share = min(max((Pa - rig.relief_pressure) / 1e5, 0.0), 1.0)
        out_a -= through(rig, rig.relief * share, Pa, rig.atmospheric_pressure)
    widening_a, widening_b = area_a * v, -area_b * v
    if rig.creep > 0.0:
        dy[CREEP_A], dy[CREEP_B] = (Pa - s[CREEP_A]) / rig.creep_time, (Pb - s[CREEP_B]) / rig.creep_time
        widening_a += rig.creep * dy[CREEP_A]
        widening_b += rig.creep * dy[CREEP_B]
    dy[PA], dy[TA] = chamber_rates(rig, Pa, s[TA], volume_a, widening_a, area_a, in_a, out_a)
    dy[PB], dy[TB] = chamber_rates(rig, Pb, s[TB], volume_b, widening_b, area_b, in_b, out_b)
    heat = rig.gas_constant * rig.temperature
    if rig.reservoir > 0.0:
        line = through(rig, rig.line_area, rig.supply_pressure, s[PS])
        dy[PS] = heat / rig.reservoir * (line - from_supply)
    if rig.silencer > 0.0:
        gone = through(rig, rig.silencer, s[PE], rig.exhaust_pressure)
        dy[PE] = heat / rig.manifold * (to_exhaust - gone)
