"""Units at the doors: what parses, what is refused, and that nothing is lost on the way."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from optid.core.units import conversion, si_unit_of, to_si
from optid.errors import RigError

PAIRS = [
    ("bar", "Pa"),
    ("kPa", "Pa"),
    ("psi", "Pa"),
    ("bar_gauge", "Pa"),
    ("mm", "m"),
    ("inch", "m"),
    ("N/(mm/s)", "N s/m"),
    ("g", "kg"),
    ("ms", "s"),
    ("kHz", "Hz"),
    ("mV", "V"),
    ("J/(kg K)", "J/(kg K)"),
    ("N/m**1.5", "N/m**1.5"),
    ("degC", "K"),
    ("%", "1"),
    ("1", "1"),
]


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        ("7 bar", "Pa", 7e5),
        ("6.2 mm", "m", 0.0062),  # exactly the nearest float, as if written in metres
        ("6.2mm", "m", 0.0062),
        ("78 N s/m", "N s/m", 78.0),
        ("78 N*s/m", "N s/m", 78.0),
        ("0.078 N s/mm", "N s/m", 78.0),
        ("287 J/(kg K)", "J/(kg K)", 287.0),
        ("0.287 kJ/kg/K", "J/(kg K)", 287.0),
        ("1e8 N/m**1.5", "N/m**1.5", 1e8),
        ("1e8 N/m^1.5", "N/m**1.5", 1e8),
        ("20 degC", "K", 293.15),
        ("20 °C", "K", 293.15),
        ("293 K", "K", 293.0),
        ("5 m/s²", "m/s**2", 5.0),
        ("10 µm", "m", 1e-5),
        ("80 %", "1", 0.8),
        ("0.8", "1", 0.8),
        (0.8, "1", 0.8),
        (3, "1", 3.0),
        ("-.5e-3 V", "V", -5e-4),
        ("6 bar_gauge", "Pa", 7.013e5),
        ("600 kPa_gauge", "Pa", 7.013e5),
    ],
)
def test_known_values(value, unit, expected):
    assert to_si(value, unit, atmospheric=1.013e5) == expected


def test_differences_ignore_the_zero_of_a_scale():
    assert to_si("5 degC", "K", difference=True) == 5.0
    assert to_si("0.1 bar_gauge", "Pa", atmospheric=1e5, difference=True) == 1e4


@pytest.mark.parametrize(
    ("value", "unit", "fragments"),
    [
        ("7 bar", "m", ("bar", "dimension", "4 mm")),
        (7.0, "Pa", ("no unit", "Pa")),
        ("7", "Pa", ("no unit",)),
        ("7 Bar", "Pa", ('"Bar"', '"bar"')),
        ("7 metrs", "m", ('"metrs"',)),
        ("mm", "m", ("number",)),
        ("", "m", ("number",)),
        ("nan mm", "m", ("not finite",)),
        ("-inf", "1", ("not finite",)),
        ("1e999", "1", ("not finite",)),
        ("1e300 Tm", "m", ("not finite",)),
        (math.nan, "1", ("not finite",)),
        (10**400, "1", ("not finite",)),
        ("1,5 mm", "m", ("comma",)),
        (None, "m", ("None",)),
        (False, "1", ("False",)),
        ("6 bar_gauge", "Pa", ("atmospheric",)),
        ("6 m_gauge", "m", ("gauge",)),
        ("1 m**9**9**9**9", "m", ("not a unit",)),
        ("1 (2)**99999999", "1", ("not a unit",)),
        ("1 exit()", "1", ("not a unit",)),
    ],
)
def test_refusals_say_why(value, unit, fragments):
    with pytest.raises(RigError) as caught:
        to_si(value, unit, where="rig.toml", field="parameters.p")
    message = str(caught.value)
    assert message.startswith("rig.toml: parameters.p: ")
    assert len(message) < 300
    assert all(fragment in message for fragment in fragments)


@given(
    st.sampled_from(PAIRS),
    st.floats(1e-9, 1e9).flatmap(lambda size: st.sampled_from([size, -size])),
)
def test_round_trip(pair, value):
    unit, si = pair
    rule = conversion(unit, si, atmospheric=101325.0)
    text = f"{rule.text(value)} {unit}"
    assert to_si(text, si, atmospheric=101325.0) == pytest.approx(value, rel=1e-12)


@given(st.text(max_size=30))
def test_any_text_is_a_number_or_a_rig_error(text):
    try:
        assert math.isfinite(to_si(text, "m"))
    except RigError as error:
        assert "\n" not in str(error)


def test_arrays_keep_missing_samples():
    values = conversion("bar_gauge", "Pa", atmospheric=1e5).si(np.array([0.0, 6.0, np.nan]))
    np.testing.assert_array_equal(values, [1e5, 7e5, np.nan])


@pytest.mark.parametrize(
    ("unit", "expected"),
    [("mV", "V"), ("mm", "m"), ("bar_gauge", "Pa"), ("%", "1"), ("degC", "K"), ("mm/s", "m/s"), ("mA", "A")],
)
def test_si_unit_of_a_channel(unit, expected):
    assert si_unit_of(unit) == expected


@pytest.mark.parametrize(
    "text", ["1 dB", "1 dBm", "1 Np", "1 Ym^14 m^-13", "3 ym^9 m^-8", "1 m^400 m^-399 Ym^9", "1 octave"]
)
def test_a_unit_without_a_factor_is_refused(text):
    for unit in ("1", "m", "W"):
        with pytest.raises(RigError):
            to_si(text, unit)


@pytest.mark.parametrize("unit", ["Ym^14", "Ym^90", "m^200 kg^150"])
def test_a_unit_beyond_the_floats_has_no_coherent_one(unit):
    with pytest.raises(RigError):
        si_unit_of(unit)


def test_a_long_text_is_refused_at_once():
    with pytest.raises(RigError, match="1000002 characters"):
        to_si("1" + " " * 1_000_000 + "x", "m")


@pytest.mark.parametrize(
    "text", ["1e-99999999999999999999 mm", "0e99999999999999999999 m", "-1e-999999999999999999999 m"]
)
def test_an_exponent_beyond_decimals_is_zero(text):
    assert to_si(text, "m") == 0.0
