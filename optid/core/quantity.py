"""Readable numbers with units, formatted in the same way for terminals, pages and figures."""

from __future__ import annotations

import math
import re

# SI unit -> (factor, name) from the largest; the first that shows at least 0.1 is taken, else the last.
_NAMES: dict[str, tuple[tuple[float, str], ...]] = {
    "m": ((1.0, "m"), (1e3, "mm"), (1e6, "µm")),
    "m/s": ((1.0, "m/s"), (1e3, "mm/s")),
    "s": ((1.0, "s"), (1e3, "ms"), (1e6, "µs")),
    "Pa": ((1e-5, "bar"),),
    "Pa/s": ((1e-5, "bar/s"),),
    "1/Pa": ((1e5, "1/bar"),),
    "N/Pa": ((1e5, "N/bar"),),
    "m**2": ((1e6, "mm²"),),
    "m**3": ((1e3, "L"), (1e6, "cm³")),
    "m**3/s": ((6e4, "L/min"), (6e7, "mL/min")),
    "m**3/(s Pa)": ((6e9, "L/(min bar)"), (6e12, "mL/(min bar)")),
    "kg/s": ((1e3, "g/s"), (1e6, "mg/s")),
    "1": ((1.0, ""),),
}
_AXES = {
    "m": (1e3, "mm"),
    "m/s": (1e3, "mm/s"),
    "m**2": (1e6, "mm²"),
    "m**3/s": (6e4, "L/min"),
    "kg/s": (1e3, "g/s"),
    "Pa": (1e-5, "bar"),
    "Pa/s": (1e-5, "bar/s"),
    "1": (1.0, ""),
}
_LARGE = {"m": 0.9995, "m/s": 0.9995, "s": 0.9995}  # below, the next smaller name reads better
_POWERS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_ROOT = re.compile(r"(\w+)(?:\*\*|\^)0\.5\b")
_LONG = re.compile(r"\b\d(?:\.\d+)?e\+0[1-5]\b")
_SPELT = (
    (re.compile(r"(?<=[\d ])um\b"), "µm"),
    (re.compile(r"\bmm2\b"), "mm²"),
    (re.compile(r"\b(mm?|s)\^2\b"), r"\1²"),
    (re.compile(r"(?<=\d)%"), " %"),
    (re.compile(r"(?<![\d.])-0(?![\d.])"), "0"),
)


def quantity(value: float, unit: str, digits: int = 3) -> str:
    """A number in the unit that suits its size: ``quantity(45e-6, "m")`` is "45 µm".

    Args:
        value: in `unit`.
        unit: SI, as models and files state it.
        digits: significant ones.
    """
    factor, shown = reading(value, unit)
    return f"{plain(value * factor, digits)} {shown}".rstrip()


def reading(value: float, unit: str) -> tuple[float, str]:
    """Factor and name of the unit in which a value of this size reads best."""
    names = _NAMES.get(unit)
    if names is None:
        return 1.0, unit_name(unit)
    size = abs(value)
    if not math.isfinite(size) or size == 0.0:
        return names[1] if unit in ("m", "m/s") else names[0]
    for factor, name in names[:-1]:
        if size * factor >= (_LARGE.get(unit, 0.1) if factor == 1.0 else 0.1):
            return factor, name
    return names[-1]


def plain(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, never as minus zero, and up to a million without a power of ten."""
    text = f"{value:.{digits}g}"
    if "e+" in text and abs(value) < 1e6:
        text = f"{float(text):.0f}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def friendly(unit: str) -> tuple[float, str]:
    """Factor from an SI unit to the one that the axes of figures have: millimetres, bar, litres a minute."""
    return _AXES.get(unit, (1.0, unit_name(unit)))


def unit_name(unit: str) -> str:
    """A unit in typographic form: "m s**2" is "m s²", "V**0.5" is "√V"; nothing for a pure number."""
    if unit == "1":
        return ""
    unit = _ROOT.sub(r"√\1", unit)
    return re.sub(r"(?:\*\*|\^)(-?\d+)", lambda power: power.group(1).translate(_POWERS), unit)


def typeset(sentence: str) -> str:
    """A sentence with its units written as `quantity` writes them."""
    for written, meant in _SPELT:
        sentence = written.sub(meant, sentence)
    return _LONG.sub(lambda found: plain(float(found.group()), 6), sentence)
