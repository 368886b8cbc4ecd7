"""Where the table of a text file begins: its header, delimiter and columns, from the names in the rig file.

Everything above the header (facts of the file, of the channels) and between header and data (units, types) may be
anything; so may columns that the rig file does not map.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

from optid.core.readers.cells import COMMA_DECIMAL, is_missing, is_number, is_stamp, is_value

DELIMITERS = ("\t", ";", "|", ",", " ")  # " " stands for any run of blanks
_MARK = re.compile(r"^\s*(?:[#%!'*;]+|//|REM\b)\s*")
_UNIT = re.compile(r"^(.*?)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|/\s?([^\s/]+))$")
_REMEMBERED = 4096  # signs of a line whose cells are kept for a while
_LONGEST_NAME = 400  # signs of a cell that can be a name with its unit: no pattern goes over longer ones
_PLACE = re.compile(r"column (\d{1,6})")
_LOOK = 60  # lines looked at to judge where rows of data begin
_ABOVE = 40  # rows between a header and its data: units, types, scales
_FOLLOWING = 4  # rows that show that a table has begun


def split(line: str, delimiter: str) -> list[str]:
    """The cells of a line, without blanks and quotes around them."""
    if delimiter == " ":
        return [cell.strip('"') for cell in line.split()]
    if '"' not in line:
        return [cell.strip() for cell in line.split(delimiter)]
    try:
        cells = next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [""])
    except csv.Error:  # a cell beyond what the csv module takes
        cells = line.split(delimiter)
    return [_unquoted(cell.strip()) for cell in cells]


def _unquoted(cell: str) -> str:
    """Without quotes around all of it, or one that has no partner; a name may hold some, as "Data".u does."""
    if cell.count('"') % 2:
        return cell.strip('"').strip()
    return cell[1:-1].strip() if cell.startswith('"') and cell.find('"', 1) == len(cell) - 1 else cell


@dataclass(frozen=True)
class Layout:
    """How a text table is laid out.

    Attributes:
        header: index of the line that names the columns; None where columns are selected by position.
        first: index of the first row of data.
        delimiter: one of `DELIMITERS`.
        names: of the columns, as the header has them.
        found: requested name -> indices of the columns with it (several if it occurs more than once).
        relaxed: requested name -> the header's spelling, where it differs.
        between: cells of the lines between header and data, one list a line.
    """

    header: int | None
    first: int
    delimiter: str
    names: tuple[str, ...]
    found: dict[str, tuple[int, ...]]
    relaxed: dict[str, str] = field(default_factory=dict)
    between: tuple[tuple[str, ...], ...] = ()

    def shifted(self) -> Layout:
        """The same with a column in front that the header does not name."""
        found = {name: tuple(k + 1 for k in indices) for name, indices in self.found.items()}
        return replace(self, names=("", *self.names), found=found)

    @cached_property
    def places(self) -> tuple[int, ...]:
        """Indices of all columns found."""
        return tuple(sorted({k for indices in self.found.values() for k in indices}))


@dataclass(frozen=True)
class _Candidate:
    score: tuple[float, ...]
    layout: Layout


def find_layout(lines: Sequence[str], wanted: Sequence[str]) -> Layout | None:
    """The layout under which most of the requested columns are found and followed by rows of data.

    Args:
        lines: the head of the file.
        wanted: names of the mapped columns; "column 3" is the third one, whatever its name.

    Returns:
        None where no line is followed by rows of numbers.
    """
    named = [name for name in wanted if not _PLACE.fullmatch(name)]
    candidates = list(_by_names(lines, wanted, named)) if named else []
    if not any(c.score[0] for c in candidates):
        candidates += [*_by_places(lines, wanted), *_by_rows(lines, wanted)]
    return max(candidates, key=lambda c: c.score).layout if candidates else None


def _by_names(lines: Sequence[str], wanted: Sequence[str], named: Sequence[str]) -> Iterator[_Candidate]:
    parts = [re.compile(re.escape(name.strip("#%! "))) for name in named]
    for i, line in enumerate(lines):
        if not any(part.search(line) for part in parts):
            continue
        for order, delimiter in enumerate(DELIMITERS):
            if delimiter != " " and delimiter not in line and len(named) > 1:
                continue
            for cells in _headers(line, delimiter):
                found, relaxed = _matches(cells, wanted)
                score = sum(name in found for name in named) - 0.1 * len(relaxed)
                if score <= 0:
                    continue
                first = _first_row(lines, i + 1, delimiter, cells, found)
                if first is not None:
                    between = tuple(tuple(split(text, delimiter)) for text in lines[i + 1 : first])
                    layout = Layout(i, first, delimiter, tuple(cells), found, relaxed, between)
                    if _numbered(lines, first, delimiter, len(cells)):
                        layout, cells = layout.shifted(), ["", *cells]
                    agreed = _agreement(lines, first, delimiter, len(cells))
                    # Of two headers over the same rows the nearer one; of two tables the first.
                    yield _Candidate((score, agreed > 0.5, -order, -first, i), layout)


def _headers(line: str, delimiter: str) -> Iterator[list[str]]:
    """The cells of a header: as they are, without a comment mark, and with blanks inside names."""
    plain = split(line, delimiter)
    yield plain
    bare = _MARK.sub("", line)
    if bare != line:
        yield split(bare, delimiter)
    if delimiter == " " and "  " in bare.strip():
        yield [cell.strip() for cell in re.split(r"\s{2,}|\t", bare.strip())]


def _matches(
    cells: Sequence[str], wanted: Sequence[str]
) -> tuple[dict[str, tuple[int, ...]], dict[str, str]]:
    exact: dict[str, list[int]] = {}
    loose: dict[str, list[int]] = {}
    for k, cell in enumerate(cells):
        exact.setdefault(cell, []).append(k)
    for k, cell in enumerate(cells if any(name not in exact for name in wanted) else ()):
        loose.setdefault(bare_name(cell), []).append(k)
    found: dict[str, tuple[int, ...]] = {}
    relaxed: dict[str, str] = {}
    for name in wanted:
        if name in exact:
            found[name] = tuple(exact[name])
        elif (place := _PLACE.fullmatch(name)) and 1 <= int(place[1]) <= len(cells):
            found[name] = (int(place[1]) - 1,)
        elif name in loose and len(loose[name]) == 1:
            found[name] = tuple(loose[name])
            relaxed[name] = cells[loose[name][0]]
        elif bare_name(name) in loose and len(loose[bare_name(name)]) == 1 and _MARK.match(name):
            found[name] = tuple(loose[bare_name(name)])
    return found, relaxed


@lru_cache(maxsize=4096)
def bare_name(cell: str) -> str:
    """A header's cell without comment mark and unit: "u [V]" and "% u (V)" are u."""
    cell = _MARK.sub("", cell)
    match = _UNIT.match(cell) if len(cell) <= _LONGEST_NAME else None
    return match[1].strip() if match and match[1].strip() else cell.strip()


def unit_in(cell: str) -> str:
    """The unit that a header's cell states behind the name; empty if none."""
    match = _UNIT.match(cell) if len(cell) <= _LONGEST_NAME else None
    return (
        next((part.strip() for part in match.groups()[1:] if part), "") if match and match[1].strip() else ""
    )


def _first_row(
    lines: Sequence[str], start: int, delimiter: str, cells: Sequence[str], found: dict[str, tuple[int, ...]]
) -> int | None:
    """The first line at or after `start` that is a row of data in every column found."""
    places = sorted({k for indices in found.values() for k in indices})
    full = [
        i
        for i in range(start, min(start + 20 * _ABOVE, len(lines)))
        if lines[i].strip() and not lines[i].lstrip().startswith(("#", "%", "//"))
    ][: _ABOVE + _FOLLOWING + 1]
    rows = [is_row(_again(lines[i], delimiter), places, len(cells)) for i in full]
    for k, i in enumerate(full[: _ABOVE + 1]):
        # A number among the facts of the channels ("SampleTime 1") is no row: others follow a row, or it begins as one.
        follow = all(rows[k : k + _FOLLOWING])
        if rows[k] and (follow or is_value(split(lines[i], delimiter)[0])):
            later = full[min(k + _FOLLOWING, len(full)) - 1]
            if not (
                follow and _other_kind(_again(lines[i], delimiter), _again(lines[later], delimiter), places)
            ):
                return i
    return None


def _other_kind(cells: Sequence[str], later: Sequence[str], places: Sequence[int]) -> bool:
    """A date or a time of day stands where rows further down hold numbers: it is a fact of the channel."""
    return any(is_stamp(cells[k]) and not is_number(cells[k]) and is_number(later[k]) for k in places)


def _numbered(lines: Sequence[str], first: int, delimiter: str, width: int) -> bool:
    """Every row has one cell more than the header, in front and counting the rows: as R writes its row names."""
    rows = [split(line, delimiter) for line in lines[first : first + _LOOK] if line.strip()]
    if len(rows) < 2 or any(len(row) != width + 1 or not row[-1] for row in rows):
        return False
    begin = int(rows[0][0]) if rows[0][0] in ("0", "1") else None
    return begin is not None and all(row[0] == str(k) for k, row in enumerate(rows, begin))


def unreadable_row(lines: Sequence[str], wanted: Sequence[str]) -> tuple[int, int, str, str] | None:
    """A header that names all columns, with a row below that holds something that is not a value.

    Returns:
        indices of the header's and the row's line, the mapped name, and what stands there.
    """
    named = [name for name in wanted if not _PLACE.fullmatch(name)]
    for i, line in enumerate(lines):
        for delimiter in DELIMITERS:
            for cells in _headers(line, delimiter) if delimiter in line else ():
                found, _ = _matches(cells, wanted)
                below = next((k for k in range(i + 1, len(lines)) if lines[k].strip()), None)
                if not named or below is None or any(name not in found for name in named):
                    continue
                row = split(lines[below], delimiter)
                for name, (k, *_) in found.items():
                    if k < len(row) and not is_missing(row[k]) and not is_value(row[k]):
                        return i, below, name, row[k]
    return None


def named_in_rows(lines: Sequence[str], layout: Layout, missing: Sequence[str]) -> str | None:
    """The column whose cells are the requested names: a long table, with one value per row."""
    rows = [split(line, layout.delimiter) for line in lines[layout.first :] if line.strip()]
    for k, name in enumerate(layout.names):
        cells = {row[k] for row in rows if k < len(row)}
        if missing and cells.issuperset(missing):
            return name or f"column {k + 1}"
    return None


def _again(line: str, delimiter: str) -> Sequence[str]:
    """The cells of a line that is looked at below each of the lines above it."""
    return _remembered(line, delimiter) if len(line) <= _REMEMBERED else split(line, delimiter)


@lru_cache(maxsize=256)
def _remembered(line: str, delimiter: str) -> tuple[str, ...]:
    return tuple(split(line, delimiter))


def is_row(cells: Sequence[str], places: Sequence[int], width: int) -> bool:
    """Numbers, stamps or nothing where columns are mapped, and not nothing everywhere."""
    if not places or len(cells) <= max(places) or (len(cells) < 2 and width > 1):
        return False
    held = [cells[k] for k in places]
    if not all(is_missing(cell) or is_value(cell) for cell in held):
        return False
    filled = [cell for cell in held if not is_missing(cell)]
    return bool(filled) or sum(not is_missing(cell) for cell in cells) == 0


def _agreement(lines: Sequence[str], first: int, delimiter: str, width: int) -> float:
    """Share of the lines from the first row on that have as many cells as most of them, times how many are alike."""
    body = [line for line in lines[first : first + _LOOK] if line.strip()]
    counts = [len(split(line, delimiter)) for line in body]
    if not counts:
        return 0.0
    return max(counts.count(width), counts.count(width + 1)) / len(counts) + 1e-3 * (width > 1)


def _by_places(lines: Sequence[str], wanted: Sequence[str]) -> Iterator[_Candidate]:
    """Layouts of tables whose columns are all selected by position: the names above them do not matter."""
    places = [int(match[1]) - 1 for match in map(_PLACE.fullmatch, wanted) if match]
    if len(places) < len(wanted) or min(places) < 0:
        return
    for order, delimiter in enumerate(DELIMITERS):
        cells = next((split(line, delimiter) for line in reversed(lines) if line.strip()), [])
        names = [f"column {k + 1}" for k in range(max(len(cells), max(places) + 1))]
        found, _ = _matches(names, wanted)
        first = _first_row(lines, 0, delimiter, names, found)
        if first is not None and len(cells) > max(places):
            agreed = _agreement(lines, first, delimiter, len(names))
            yield _Candidate(
                (0.5, agreed, -order, -first, 0), Layout(None, first, delimiter, tuple(names), found)
            )


def _by_rows(lines: Sequence[str], wanted: Sequence[str]) -> Iterator[_Candidate]:
    """Layouts judged from the rows alone, for tables without a header and for messages."""
    for order, delimiter in enumerate(DELIMITERS):
        for i, line in enumerate(lines):
            if not line.strip() or line.lstrip().startswith(("#", "%", "//")):
                continue
            cells = split(line, delimiter)
            values = [is_number(cell) or is_stamp(cell) for cell in cells]
            if sum(values) < max(len(cells) / 2, 1) or not is_value(next((c for c in cells if c), "")):
                continue
            agreed = _agreement(lines, i, delimiter, len(cells))
            if agreed < 0.5:
                continue
            above = next((k for k in range(i - 1, -1, -1) if lines[k].strip()), None)
            header, names = None, tuple(f"column {k + 1}" for k in range(len(cells)))
            if above is not None:
                upper = split(_MARK.sub("", lines[above]), delimiter)
                if len(upper) in (len(cells), len(cells) + 1) and not any(map(is_value, filter(None, upper))):
                    header, names = above, tuple(upper)
            found, relaxed = _matches(names, wanted)
            width = 0.3 if len(cells) > 1 else 0.0
            layout = Layout(header, i, delimiter, names, found, relaxed)
            yield _Candidate((0.0, agreed + width, -order, -i, 0), layout)
            break


def has_decimal_comma(rows: Sequence[Sequence[str]], places: Sequence[int]) -> bool:
    """Some mapped cell of these rows reads 1,5."""
    return any(COMMA_DECIMAL.fullmatch(row[k]) for row in rows for k in places if k < len(row))
