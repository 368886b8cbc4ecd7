"""Conversion of units at the interfaces: text such as "7 bar" becomes an SI number, and back.

Pint knows the units; it is imported on first use because it is slow. Nothing here evaluates data: a unit may
hold names, products, quotients and plain exponents, and anything else is refused before pint sees it.
"""

from __future__ import annotations

import functools
import math
import re
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import NDArray

from optid.errors import InputError, RigError, nearest

Array = NDArray[np.float64]

GAUGE = "_gauge"
_LEAST = 1e-60  # size of a unit in SI units: anything smaller, or larger than its reciprocal, is refused
MOST = 400  # characters of "value unit": digits of a gauge pressure near zero are the longest
_NUMBER = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*?)\s*", re.DOTALL)
_UNIT = re.compile(r"[\w\s*/^.()\-+%°·Ωµμ²³⁻¹]{0,60}")
# A power of a number, or an exponent of more than three digits, is not a unit: refused before it is computed.
_RUNAWAY = re.compile(r"(?<![\w.])[\d.]+\s*(?:\*\*|\^)|(?:\*\*|\^)\s*[-+(]*\d{4,}")
# Common spellings, and what they mean here.
_HABITS = {
    "barg": "bar_gauge",
    "bar(g)": "bar_gauge",
    "psig": "psi_gauge",
    "bara": "bar",
    "bar_abs": "bar",
    "psia": "psi",
    "sec": "s",
    "msec": "ms",
}
# Units a rig file is likely to hold: offered when an unknown one is near.
_COMMON = (
    *("Pa", "hPa", "kPa", "MPa", "bar", "mbar", "psi", "bar_gauge", "kPa_gauge", "m", "dm", "cm", "mm", "um"),
    *("inch", "kg", "g", "N", "mN", "kN", "s", "ms", "us", "min", "Hz", "kHz", "K", "degC", "V", "mV", "A"),
    *("mA", "W", "J", "m/s", "mm/s", "L/min", "rad", "deg", "rpm"),
)
# Coherent SI units with a name of their own, in which recorded channels are kept.
_COHERENT = ("1", "V", "A", "Pa", "N", "m", "m/s", "m/s**2", "s", "Hz", "K", "kg", "J", "W", "kg/s", "m**3/s")


@dataclass(frozen=True)
class Conversion:
    """From a unit to SI: ``si = factor * value + offset``; `offset` is a temperature's or a gauge's zero."""

    unit: str
    factor: float
    offset: float = 0.0

    def si(self, values: Array) -> Array:
        """An array in `unit` as SI, same shape; NaN stays NaN."""
        return self.factor * values + self.offset if self.offset else self.factor * values

    def exact(self, number: str, *, difference: bool = False) -> float:
        """A decimal text in `unit` as the nearest SI float ("6.2" mm is 0.0062, not 0.006200000000000001)."""
        try:
            product = Decimal(number) * Decimal(repr(self.factor))
            return float(product if difference else product + Decimal(repr(self.offset)))
        except ArithmeticError:  # an exponent beyond decimals, of a number that a float has as 0
            return self.factor * float(number) + (0.0 if difference else self.offset)

    def text(self, value: float) -> str:
        """An SI number as a decimal text in `unit` that `exact` reads back.

        Near the zero of a shifted scale (an absolute pressure far below the ambient one, as gauge) a float in
        `unit` is too coarse; the text then carries the digits it takes.
        """
        number = (Decimal(repr(value)) - Decimal(repr(self.offset))) / Decimal(repr(self.factor))
        short = repr(float(number))
        return short if not self.offset or self.exact(short) == value else f"{number:f}"


def conversion(
    unit: str,
    si_unit: str,
    *,
    atmospheric: float | None = None,
    where: object = None,
    field: str | None = None,
) -> Conversion:
    """How values in `unit` become values in `si_unit`.

    Args:
        unit: as a user wrote it; a pressure unit may end in ``_gauge``.
        si_unit: the expected SI unit, which fixes the dimension; "1" is a pure number.
        atmospheric: absolute ambient pressure, Pa, which a gauge unit adds.
        where: file the unit stands in, for messages.
        field: field of that file, for messages.

    Raises:
        RigError: unknown unit, wrong dimension, or a gauge unit where none can be.
    """
    base, gauge = (unit[: -len(GAUGE)], True) if unit.endswith(GAUGE) else (unit, False)
    try:
        factor, offset = _factor(base, si_unit)
        if gauge and si_unit != "Pa":
            raise InputError(f'"{unit}": only pressures can be gauge', expected=_expected(si_unit))
        if gauge and atmospheric is None:
            raise InputError(
                f'"{unit}" needs the atmospheric pressure, which is not given',
                expected=f'an absolute pressure such as "1 {base}", or the parameter atmospheric_pressure',
            )
    except InputError as error:
        raise _located(error, where, field) from None
    return Conversion(unit, factor, atmospheric if gauge and atmospheric is not None else offset)


def to_si(
    value: object,
    si_unit: str,
    *,
    atmospheric: float | None = None,
    difference: bool = False,
    where: object = None,
    field: str | None = None,
) -> float:
    """A number (dimensionless) or "value unit" text as an SI float.

    Args:
        value: number or text, e.g. ``0.8``, ``"7 bar"``, ``"6 bar_gauge"``, ``"20 degC"``.
        si_unit: the expected SI unit; "1" is a pure number.
        atmospheric: absolute ambient pressure, Pa; without it gauge pressures are errors.
        difference: a difference rather than a position on the scale ("5 degC" is 5 K): for standard deviations.
        where: file the value stands in, for messages.
        field: field of that file, for messages.

    Raises:
        RigError: no number, no or another unit, infinite or NaN.
    """
    try:
        number, unit = split(value, si_unit)
    except InputError as error:
        raise _located(error, where, field) from None
    rule = conversion(unit, si_unit, atmospheric=atmospheric, where=where, field=field)
    result = rule.exact(number, difference=difference)
    if not math.isfinite(result):
        raise RigError(f"{shown(value)} is not finite", where=where, field=field, expected=_expected(si_unit))
    return result


def split(value: object, si_unit: str) -> tuple[str, str]:
    """The number and the unit of a value, both as text; a bare number has the unit "1".

    Raises:
        InputError: neither a finite number nor "value unit" text, or a unit that is missing.
    """
    expected = _expected(si_unit)
    found = shown(value)
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise InputError(f"found {found}", expected=expected)
    if isinstance(value, str):
        if len(value) > MOST:
            raise InputError(f"a text of {len(value)} characters", expected=expected)
        match = _NUMBER.fullmatch(value)
        if match is None and re.match(r"\s*[-+]?(inf|nan)", value, re.IGNORECASE):
            raise InputError(f"{found} is not finite", expected=expected)
        if match is None:
            raise InputError(f"{found} does not start with a number", expected=expected)
        number, unit = match.group(1), match.group(2) or "1"
        if re.match(r",\d", unit):
            hint = "write decimals with a point"
            raise InputError(f"{found} holds a comma", expected=expected, hint=hint)
    else:
        number, unit = _decimal_text(value), "1"
    if not math.isfinite(float(number)):
        raise InputError(f"{found} is not finite", expected=expected)
    if unit == "1" and si_unit != "1":
        raise InputError(f'{found} has no unit; the unit here is "{si_unit}"', expected=expected)
    return number, unit


def shown(value: object) -> str:
    """A value quoted for a message: text in double quotes, of bounded length."""
    text = f'"{value}"' if isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else f"{text[:56]} ..."


def si_unit_of(unit: str, *, where: object = None, field: str | None = None) -> str:
    """The coherent SI unit of a unit's dimension: "V" for "mV", "Pa" for "bar_gauge", "m" for "mm".

    Raises:
        RigError: unknown unit.
    """
    base = unit.removesuffix(GAUGE)
    try:
        parsed = _parse(base)
        dimension = _dimension(parsed, base)
    except InputError as error:
        raise _located(error, where, field) from None
    registry = _registry()
    for candidate in _COHERENT:
        if dimension == registry.parse_units(candidate).dimensionality:
            return candidate
    try:
        return f"{registry.Quantity(1, parsed).to_base_units().units:~C}"
    except Exception:  # pint and float conversion raise many kinds of exceptions
        raise _located(_inconvertible(unit), where, field) from None


def _decimal_text(value: float) -> str:
    """A TOML number as text; an integer beyond the floats is infinite."""
    try:
        return repr(float(value))
    except OverflowError:
        return "inf"


def _expected(si_unit: str) -> str:
    if si_unit == "1":
        return "a number"
    example = {"Pa": "7 bar", "m": "4 mm", "K": "293 K"}.get(si_unit, f"1 {si_unit}")
    return f'"value unit" such as "{example}"'


def _located(error: InputError, where: object, field: str | None) -> RigError:
    """The same error, with its file and field."""
    return RigError(str(error), where=where, field=field)


@functools.cache
def _registry() -> Any:
    import pint

    return pint.UnitRegistry()


@functools.lru_cache(maxsize=1024)
def _factor(unit: str, si_unit: str) -> tuple[float, float]:
    """Factor and offset from a unit without gauge suffix to SI."""
    parsed, target = _parse(unit), _registry().parse_units(si_unit)
    if _dimension(parsed, unit) != target.dimensionality:
        found = f'"{unit}"' if unit not in ("", "1") else "a pure number"
        raise InputError(f'{found} has the wrong dimension for "{si_unit}"', expected=_expected(si_unit))
    zero, one, two = (_converted(value, parsed, target, unit) for value in (0.0, 1.0, 2.0))
    if abs(two - 2.0 * one + zero) > 1e-9 * abs(two):  # decibels, nepers
        raise _inconvertible(unit)
    # An offset unit (degC) moves zero; its factor is the size of one degree, free of the offset's rounding.
    factor = one if zero == 0.0 else float(Decimal(repr(one)) - Decimal(repr(zero)))
    return float(factor), float(zero)


def _dimension(parsed: Any, unit: str) -> Any:
    try:
        return parsed.dimensionality
    except Exception:  # pint raises many kinds of exceptions
        raise InputError(f'"{unit}" is not a unit that has a dimension') from None


def _converted(value: float, parsed: Any, target: Any, unit: str) -> float:
    """A value in another unit of the same dimension.

    Raises:
        InputError: no factor and offset that a float can hold lead there: a logarithmic unit, or an absurd power.
    """
    try:
        result = float(_registry().Quantity(value, parsed).to(target).magnitude)
    except Exception:  # pint and float conversion raise many kinds of exceptions
        result = math.nan
    if not math.isfinite(result) or (value and not _LEAST < abs(result) < 1.0 / _LEAST):
        raise _inconvertible(unit)
    return result


def _inconvertible(unit: str) -> InputError:
    return InputError(f'"{unit}" does not convert', expected='a unit with a factor, such as "mm" or "bar"')


@functools.lru_cache(maxsize=1024)
def _parse(unit: str) -> Any:
    """Pint's unit for a text.

    Raises:
        InputError: not a unit; names the nearest common one.
    """
    hint = f'did you mean "{_HABITS[unit]}"?' if unit in _HABITS else nearest(unit, _COMMON)
    hint = hint if hint.startswith("did") else 'write it like "bar", "mm", "N s/m" or "J/(kg K)"'
    bad = InputError(f'"{unit}" is not a unit', hint=hint)
    if unit in _HABITS or not _UNIT.fullmatch(unit) or _RUNAWAY.search(unit):
        raise bad
    try:
        return _registry().parse_units(unit)
    except Exception:  # pint raises many kinds of exceptions, among them AssertionError and tokenizer errors
        raise bad from None
