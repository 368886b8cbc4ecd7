"""One stamp as loggers write it: a time of day, a date with one, or a duration; in a dozen orders and languages."""

from __future__ import annotations

import re

import numpy as np

DAY = 86_400 * 10**9  # ns
LONGEST = 80  # characters of a cell that can be a stamp: no pattern sees longer ones
_MONTHS = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
# Other languages' first letters: German, French, Italian, Spanish, Portuguese, Dutch, Polish, Swedish.
_LETTERS = (
    "ene gen sty",
    "fév fev lut",
    "mär mrz maa mrt",
    "avr abr kwi",
    "mai mag maj mei",
    "giu cze juin",
    "juil lug lip",
    "aoû aou ago sie",
    "set wrz",
    "okt ott out paź",
    "lis",
    "dez dic déc gru",
)
_ELSEWHERE = {name: month for month, names in enumerate(_LETTERS, 1) for name in names.split()}
_NAME = r"[^\W\d_]{3,10}\.?"
_DATES = (
    r"\d{4}[-/. ]\d{1,2}[-/. ]\d{1,2}",
    r"\d{1,2}[-/. ]\d{1,2}[-/. ]\d{2,4}",
    r"\d{8}",
    r"\d{4}-\d{3}",
    r"\d{4}年\d{1,2}月\d{1,2}日",
    rf"\d{{1,2}}\.?[-/ ]?{_NAME}[-/ ,]+\d{{2,4}}",
    rf"{_NAME} +\d{{1,2}},? +\d{{4}}",
)
_CLOCKS = (
    r"(?P<h>\d{1,6}):(?P<m>\d{2})(?::(?P<s>\d{2}))?(?:[.,:;](?P<f>\d{1,12}))?",
    r"(?P<h>\d{1,6})h ?(?P<m>\d{1,2})m(?:in)? ?(?P<s>\d{1,2})(?:[.,](?P<f>\d{1,12}))?s?",
)
# Behind a date only.
_BARE_CLOCK = r"(?P<h>\d{2})(?P<d>[-_.]?)(?P<m>\d{2})(?P=d)(?P<s>\d{2})(?:[-.,](?P<f>\d{1,12}))?"
_HALF = r"(?:\s*(?P<half>[AaPp]\.?\s?[Mm]\.?|vorm\.|nachm\.|上午|下午))?"
_ZONE = r"(?:\s*(?:[A-Z]{1,5})?(?P<zone>[-+]\d{2}(?::?\d{2})?)?)(?:\[[\w/+-]+\])?"
_FORMS = (
    *(
        re.compile(
            rf"(?:[^\W\d_]{{2,12}}\.?,?\s+)?(?P<date>{'|'.join(_DATES)})[T_ \t:,-]\s*{clock}{_HALF}{_ZONE}"
        )
        for clock in (*_CLOCKS, _BARE_CLOCK)
    ),
    *(re.compile(rf"(?P<date>){clock}{_HALF}{_ZONE}") for clock in _CLOCKS),
    re.compile(rf"(?:{_NAME} +)?(?P<date>{_NAME} +\d{{1,2}}) +{_CLOCKS[0]}{_HALF}{_ZONE} +(?P<year>\d{{4}})"),
)
_PLC = re.compile(r"^(?:L?DT|L?DATE_AND_TIME|L?TOD|L?TIME_OF_DAY)#", re.IGNORECASE)
_LONG = re.compile(r"(?P<sign>-)?(?P<days>\d+) days?,?\s*(?:\+?(?P<rest>\d{1,2}:.*))?")
_DURATIONS = (
    re.compile(
        r"L?T(?:IME)?#(-)?(?:(\d+)d_?)?(?:(\d+)h_?)?(?:(\d+)m(?!s)_?)?(?:([\d.]+)s_?)?(?:([\d.]+)ms_?)?"
        r"(?:([\d.]+)us_?)?(?:(\d+)ns)?",
        re.IGNORECASE,
    ),
    re.compile(r"(-)?P(?:(\d+)D)?(?:T(?:(\d+)H)?(?:(\d+)M)?(?:([\d.]+)S)?)?"),
)
_SIZES = (DAY, 3600 * 10**9, 60 * 10**9, 10**9, 10**6, 10**3, 1)


def parsed(text: str) -> tuple[str, int] | None:
    """The date's text (empty if none) and ns since midnight or of a duration; None if it is no stamp.

    The offset of a time zone is taken out. A date without a time of day is none.
    """
    if len(text) > LONGEST or not text[-1:].strip():
        return None
    text = _PLC.sub("", text[1:].split("]")[0] if text[:1] == "[" else text)
    sign, days = 1, 0
    if match := _LONG.fullmatch(text):
        days, text = int(match["days"]), match["rest"] or "0:00"
        sign = -1 if match["sign"] else 1
    elif text[:1] == "-":
        sign, text = -1, text[1:]
    for form in _FORMS:
        if match := form.fullmatch(text):
            clock = _of_clock(match)
            date = match["date"] + (f", {match['year']}" if "year" in form.groupindex else "")
            # pandas writes "-1 days +23:59:59": the days alone are negative.
            return date, sign * days * DAY + (clock if days else sign * clock)
    found = next((m for m in (form.fullmatch(text) for form in _DURATIONS) if m), None)
    if found is None or not any(found.groups()[1:]):
        return None
    parts = zip(found.groups()[1:], _SIZES, strict=False)
    total = sum(round(float(part) * size) for part, size in parts if part)
    return "", -total if found[1] or sign < 0 else total


def _of_clock(match: re.Match[str]) -> int:
    """ns since midnight."""
    hours, minutes, seconds, fraction = int(match["h"]), int(match["m"]), match["s"], match["f"] or ""
    whole = int(seconds or 0)
    if seconds is None and fraction:  # minutes, seconds and a fraction
        hours, minutes, whole = 0, hours, minutes
    if half := match["half"]:
        hours = hours % 12 + (12 if half[0] in "pPn下" else 0)
    shift = 0
    if zone := match["zone"]:
        digits = zone[1:].replace(":", "")
        shift = (int(digits[:2]) * 60 + int(digits[2:] or 0)) * (60 if zone[0] == "+" else -60)
    return ((hours * 60 + minutes) * 60 + whole - shift) * 10**9 + int((fraction or "0")[:9].ljust(9, "0"))


def day_of(date: str, day_first: bool) -> int | None:
    """Days since 1970; of "5/2/24" the day stands first or the month. None if there is no such day."""
    parts = re.findall(r"\d+|[^\W\d_]+", date.replace("年", " ").replace("月", " ").replace("日", " "))
    numbers = _ordered(parts, day_first or "." in date)
    if numbers is None:
        return None
    year, month, day = numbers
    try:
        first = np.datetime64(f"{year + (2000 if year < 100 else 0):04d}-{max(month, 1):02d}-01", "D")
        found = int(first.astype(np.int64)) + day - 1
    except ValueError:
        return None
    # Without a month the day is that of the year.
    return found if month == 0 or np.datetime64(found, "D").astype(object).month == month else None


def _ordered(parts: list[str], day_first: bool) -> tuple[int, int, int] | None:
    """Year, month (0: none) and day from the parts of a date in the order they stand in."""
    if len(parts) == 1:
        return int(parts[0][:4]), int(parts[0][4:6]), int(parts[0][6:])
    if len(parts) == 2:
        return int(parts[0]), 0, int(parts[1])
    named = [k for k, part in enumerate(parts) if not part.isdigit()]
    if len(parts) != 3 or len(named) > 1:
        return None
    if named:
        month = _month(parts.pop(named[0]))
        return (int(parts[1]), month, int(parts[0])) if month else None
    a, b, c = map(int, parts)
    if len(parts[0]) == 4:
        return a, b, c
    return (c, b, a) if a > 12 or (b <= 12 and day_first) else (c, a, b)


def _month(name: str) -> int:
    """1 to 12, or 0 where no language has it."""
    name = name.lower()
    if name[:4] in _ELSEWHERE:
        return _ELSEWHERE[name[:4]]
    return _MONTHS.index(name[:3]) + 1 if name[:3] in _MONTHS else _ELSEWHERE.get(name[:3], 0)
