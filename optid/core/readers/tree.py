"""Variables, structs, cells and groups as names of signals, common to .mat and HDF5 files.

A struct's field is "log.x", an element of a struct array or cell "log[0].x", a signal of a matrix "acc[0]".
MATLAB's notation, "acc(1,:)", "log.signals(2).values", "c{1}", is accepted as well.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from optid.core.readers.limits import shown
from optid.core.readers.table import Clock, Column, Raw, Table
from optid.errors import RecordingError

Node = Any  # Array, str, Mapping, list or Sealed
_MANY = 20_000  # names examined: a file with more is not a recording
_LISTED = 64  # signals of a matrix that are listed by name
_INDEX = re.compile(r"\[(\d+)\]$")
_MATLAB = re.compile(r"\((?:(\d+)(?:,:)?|:,(\d+))\)|\{(\d+)\}")
_TIMES = ("time", "t", "Time", "T", "Zeit", "timestamp", "Timestamp", "times", "X", "x_values")


class Array(Protocol):
    """A numeric array that may be still in the file."""

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def __getitem__(self, key: Any) -> Any:
        """Values."""
        ...


@dataclass(frozen=True)
class Sealed:
    """A variable that only its own program can open, or that is not a signal.

    Attributes:
        kind: what it is, "a timeseries object".
        cure: what to do.
    """

    kind: str
    cure: str = ""


def only_matlab(kind: str, name: str) -> Sealed:
    """An object of a MATLAB class, with the line that turns it into plain variables."""
    name = re.sub(r"[^\w.{}()]", "", name) or "x"
    lines = {
        "timeseries": f"t = {name}.Time; x = {name}.Data; save('run.mat', 't', 'x', '-v7')",
        "timetable": f"s = table2struct(timetable2table({name}), 'ToScalar', true); "
        "save('run.mat', '-struct', 's', '-v7')",
        "table": f"s = table2struct({name}, 'ToScalar', true); save('run.mat', '-struct', 's', '-v7')",
        "Simulink.SimulationData.Dataset": f"x = {name}{{1}}.Values.Data; "
        f"t = {name}{{1}}.Values.Time; save('run.mat', 't', 'x', '-v7')",
        "Simulink.SimulationOutput": f"logs = {name}.logsout; x = logs{{1}}.Values.Data; t = logs{{1}}.Values.Time; "
        "save('run.mat', 't', 'x', '-v7')",
        "datetime": f"t = seconds({name} - {name}(1)); save('run.mat', 't', '-append')",
        "duration": f"t = seconds({name}); save('run.mat', 't', '-append')",
    }
    article = "an" if kind[:1] in "aeiouAEIOU" else "a"
    cure = lines.get(kind, f"s = struct({name}); save('run.mat', '-struct', 's', '-v7')")
    return Sealed(f"is {article} {shown(kind)} object, which only MATLAB can read", f"in MATLAB: {cure}")


def table_of(root: Mapping[str, Node], wanted: Sequence[str], path: Path, reader: str) -> Table:
    """The requested signals.

    Raises:
        RecordingError: no vector is in it.
    """
    flat = dict(_first(_flat(root)))
    signals = {name: node for name, node in flat.items() if _is_signal(node)}
    asked = {name: _canonical(name) for name in wanted}
    length = _common_length(signals, asked.values())
    if not signals and not any(isinstance(node, Sealed) for node in flat.values()):
        raise RecordingError(
            "it holds no vector of samples", where=path, expected="signals as vectors of one length"
        )
    aliases = dict(_first(_aliases(root)))
    columns: dict[str, Column] = {}
    left_out: dict[str, str] = {}
    for name, canonical in asked.items():
        target = aliases.get(name, canonical) if canonical not in flat else canonical
        found = _pick(flat, target, length)
        if isinstance(found, str):
            left_out[name] = found
        elif found is not None:
            columns[name] = Column(found, clock=_clock(root, target, len(found)))
    sealed = {name: node for name, node in flat.items() if isinstance(node, Sealed)}
    texts = {name: "holds text" for name in wanted if isinstance(_walk(root, _parts(asked[name])), str)}
    left_out = {**texts, **left_out}
    for name in wanted:
        if name not in columns and name not in left_out:
            holder = next((s for s in sealed if name == s or name.startswith((f"{s}.", f"{s}["))), None)
            if holder is not None:
                left_out[name] = _words(sealed[holder])
    about = ""
    if any(name not in columns and name not in left_out for name in wanted):
        objects = [f'"{shown(name)}" {_words(node)}' for name, node in sealed.items() if node.cure]
        about = "; ".join(objects[:3])
    return Table(columns, list(_listed(signals, length)), reader, about, left_out)


def _words(node: Sealed) -> str:
    return f"{node.kind} ({node.cure})" if node.cure else node.kind


def _first(pairs: Iterator[tuple[str, Any]]) -> Iterator[tuple[str, Any]]:
    for number, pair in enumerate(pairs):
        if number >= _MANY:
            return
        yield pair


def _canonical(name: str) -> str:
    """MATLAB's indices, from 1, as those from 0."""
    return (
        _MATLAB.sub(lambda m: f"[{max(int(next(g for g in m.groups() if g)) - 1, 0)}]", name)
        .replace("/", ".")
        .strip(".")
    )


def _flat(node: Node, name: str = "") -> Iterator[tuple[str, Node]]:
    if isinstance(node, Mapping):
        for key, inner in node.items():
            yield from _flat(inner, f"{name}.{key}" if name else str(key))
    elif isinstance(node, list):
        for k, inner in enumerate(node):
            yield from _flat(inner, f"{name}[{k}]")
    elif not isinstance(node, str):
        yield name, node


def _is_signal(node: Node) -> bool:
    return not isinstance(node, Sealed) and node.dtype.kind in "biufcmM" and int(np.prod(node.shape)) > 1


def _squeezed(shape: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(n for n in shape if n != 1)


def _common_length(signals: Mapping[str, Node], asked: Any) -> int:
    """The length of the vectors asked for, else of most vectors and matrices of the file."""
    for names in (asked, signals):
        shapes = [_squeezed(signals[name].shape) for name in names if name in signals]
        vectors = Counter(shape[0] for shape in shapes if len(shape) == 1)
        if vectors:
            return max(vectors, key=lambda n: (vectors[n], n))
    longest = Counter(max(_squeezed(node.shape), default=0) for node in signals.values())
    return max(longest, key=lambda n: (longest[n], n)) if longest else 0


def _samples_axis(shape: tuple[int, ...], length: int) -> int:
    """Of a matrix: the axis of the common length, else the longest."""
    return shape.index(length) if length in shape else int(np.argmax(shape))


def _pick(flat: Mapping[str, Node], name: str, length: int) -> Raw | str | None:
    """A signal, the reason why it is not one, or None if the name does not exist."""
    node, column = flat.get(name), None
    match = _INDEX.search(name)
    if node is None and match:
        node, column = flat.get(name[: match.start()]), int(match[1])
    if node is None:
        return None
    if isinstance(node, Sealed):
        return _words(node)
    if not _is_signal(node):
        return (
            "holds a single number"
            if node.dtype.kind in "biufc"
            else f"holds {node.dtype} instead of numbers"
        )
    shape = _squeezed(node.shape)
    if len(shape) == 1:
        return None if column not in (None, 0) else np.asarray(node[()]).reshape(-1)
    axis = _samples_axis(shape, length)
    count = int(np.prod(shape)) // shape[axis]
    if column is None:
        return f'holds {count} signals: "{shown(name)}[0]" to "{shown(name)}[{count - 1}]"'
    if column >= count:
        return f"does not exist: it holds {count} signals, [0] to [{count - 1}]"
    if len(shape) == 2 and len(node.shape) == 2:
        return np.asarray(node[:, column] if axis == 0 else node[column, :])
    whole = np.moveaxis(np.asarray(node[()]).reshape(shape), axis, 0)
    return np.ascontiguousarray(whole.reshape(shape[axis], -1, order="F")[:, column])


def _listed(signals: Mapping[str, Node], length: int) -> Iterator[str]:
    for name, node in signals.items():
        shape = _squeezed(node.shape)
        if len(shape) == 1:
            yield name
        else:
            count = int(np.prod(shape)) // shape[_samples_axis(shape, length)]
            yield from (f"{name}[{k}]" for k in range(min(count, _LISTED)))


def _aliases(node: Node, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Names that a file gives its signals in words: Simulink's labels, dSPACE's names.

    Each alone and behind the struct that holds it.
    """
    if not isinstance(node, Mapping):
        return
    for key, inner in node.items():
        name = f"{prefix}.{key}" if prefix else str(key)
        parts = inner if isinstance(inner, list) else [inner]
        for k, part in enumerate(parts):
            place = f"{name}[{k}]" if isinstance(inner, list) else name
            if not isinstance(part, Mapping):
                continue
            for word, data in (
                ("label", "values"),
                ("Name", "Data"),
                ("name", "data"),
                ("blockName", "values"),
            ):
                label = part.get(word)
                if isinstance(label, str) and label.strip() and data in part:
                    yield label.strip(), f"{place}.{data}"
                    yield f"{name}.{label.strip()}", f"{place}.{data}"
            yield from _aliases(part, place)


def _clock(root: Mapping[str, Node], name: str, length: int) -> Clock | None:
    """The time vector that stands beside a signal within its struct, or above it (Simulink's structure with time)."""
    parts = _parts(name)
    for depth in range(len(parts) - 1, 0, -1):
        holder = _walk(root, parts[:depth])
        if not isinstance(holder, Mapping):
            continue
        for key in _TIMES:
            times = _times(holder.get(key))
            if times is not None and len(times) == length and f"{'.'.join(parts[:depth])}.{key}" != name:
                return Clock(times, in_rig_unit=True)
    return None


def _parts(name: str) -> list[str]:
    """Of "log[0].x": log, [0], x."""
    return re.findall(r"[^.\[\]]+|\[\d+\]", name)


def _times(node: Node) -> Any:
    if isinstance(node, Mapping):  # dSPACE: X.Data
        node = node.get("Data")
    if node is None or isinstance(node, str | list | Sealed | Mapping) or node.dtype.kind not in "iuf":
        return None
    if len(_squeezed(node.shape)) != 1:
        return None
    times = np.asarray(node[()], dtype=np.float64).reshape(-1)
    return times if bool((np.diff(times) > 0).all()) else None


def _walk(node: Node, parts: Sequence[str]) -> Node:
    for part in parts:
        if part.startswith("[") and isinstance(node, list):
            k = int(part[1:-1])
            node = node[k] if k < len(node) else None
        elif isinstance(node, Mapping):
            node = node.get(part)
        else:
            return None
    return node
