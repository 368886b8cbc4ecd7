"""Numbers with units, one way everywhere."""

import pytest

from optid.core.quantity import plain, quantity, typeset


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (45e-6, "m", "45 µm"),
        (-4.11e-3, "m", "-4.11 mm"),
        (2e-3, "s", "2 ms"),
        (5e5, "Pa", "5 bar"),
        (0.147e-6, "m**2", "0.147 mm²"),
        (-0.0, "m", "0 mm"),
        (1.4e-5, "N/Pa", "1.4 N/bar"),
        (1e-12, "m**3/(s Pa)", "6 mL/(min bar)"),
        (50e-6, "m**3", "50 cm³"),
        (3.3e-4, "m**3/s", "19.8 L/min"),
        (3.0, "kg m**2", "3 kg m²"),
    ],
)
def test_a_number_with_the_unit_that_people_use(value, unit, text):
    assert quantity(value, unit) == text


def test_no_power_of_ten_below_a_million():
    values = (142.0, 4999.0, 0.0123, 3e7, -0.0)
    assert [plain(value, 2) for value in values] == ["140", "5000", "0.012", "3e+07", "0"]


def test_a_sentence_is_typeset():
    assert typeset(
        "it moves by 30 um over 2 mm2 in 1 s^2, -0 N, for 0.09% of the time, from 1.35e+03 on"
    ) == ("it moves by 30 µm over 2 mm² in 1 s², 0 N, for 0.09 % of the time, from 1350 on")
