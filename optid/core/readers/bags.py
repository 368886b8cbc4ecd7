"""Bags of ROS 2 and Foxglove: MCAP files and .db3 databases. Each topic has its own clock."""

from __future__ import annotations

import contextlib
import io
import json
import re
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from optid.core.readers.limits import Budget
from optid.core.readers.mdf import EXTRA
from optid.core.readers.table import Clock, Column, Table
from optid.errors import RecordingError

_CURE = "export the topics as CSV, for instance in PlotJuggler; or convert the bag to MCAP: ros2 bag convert"
Message = tuple[str, int, Any]  # topic, ns of arrival, decoded


def read(data: bytes, path: Path, wanted: tuple[str, ...], budget: Budget) -> Table:
    """The requested fields of messages, each with its topic's clock.

    They are named "/topic.field.part[0]", or with slashes as in PlotJuggler; "/topic.log_time" is the time of arrival.
    The clock is the stamp in the messages' header where they have one, else their arrival.

    Raises:
        RecordingError: truncated or damaged, no bag, definitions missing, or mcap-ros2-support is not installed.
    """
    try:
        import mcap_ros2.decoder
    except ImportError as error:
        broken = (
            ""
            if isinstance(error, ModuleNotFoundError)
            else f" (it is installed but cannot be imported: {error})"
        )
        raise RecordingError(f"bags need mcap-ros2-support{broken}", where=path, hint=EXTRA) from None
    budget.take(4 * len(data), "the messages")
    try:
        factory = mcap_ros2.decoder.DecoderFactory()
        messages = _of_sqlite(data, factory, path) if data[:6] == b"SQLite" else _of_mcap(data, factory)
        topics: dict[str, list[tuple[int, Any]]] = {}
        for topic, at, message in messages:
            if any(_rest(name, topic) is not None for name in wanted):
                topics.setdefault(topic, []).append((at, message))
            else:
                topics.setdefault(topic, [])
    except RecordingError:
        raise
    except Exception as error:  # damaged bytes make the libraries raise exceptions of any kind
        reason = " ".join(f"{type(error).__name__} {error}".split())[:120]
        raise RecordingError(
            f"the bag is truncated or damaged ({reason})", where=path, expected="a complete file"
        ) from None
    return _table(topics, wanted)


def _table(topics: dict[str, list[tuple[int, Any]]], wanted: tuple[str, ...]) -> Table:
    columns: dict[str, Column] = {}
    left_out: dict[str, str] = {}
    for name in wanted:
        for topic, messages in topics.items():
            rest = _rest(name, topic)
            if rest is None or not messages:
                continue
            found = _column(messages, rest)
            if isinstance(found, str):
                left_out[name] = found
            else:
                columns[name] = found
    return Table(columns, [f"{topic}.FIELD" for topic in topics], "bag", "", left_out)


def _rest(name: str, topic: str) -> list[str] | None:
    """The parts of a name behind its topic, if it is one of this topic."""
    if not name.startswith(topic) or name[len(topic) : len(topic) + 1] not in (".", "/"):
        return None
    return re.findall(r"[^./\[\]]+", name[len(topic) :])


def _column(messages: list[tuple[int, Any]], parts: list[str]) -> Column | str:
    arrival = np.array([at for at, _ in messages], dtype=np.int64)
    stamps = np.array([_stamp(message) for _, message in messages], dtype=np.int64)
    times = stamps if (stamps > 0).all() and (np.diff(stamps) > 0).all() else arrival
    clock = None
    if len(times) > 1 and bool((np.diff(times) > 0).all()):
        clock = Clock((times - times[0]) * 1e-9, int(times[0]))
    if parts == ["log_time"]:
        return Column(arrival.astype("datetime64[ns]"), clock)
    if parts[-1:] == ["stamp"]:
        return Column(stamps.astype("datetime64[ns]"), clock)
    values = [_field(message, parts) for _, message in messages]
    wrong = next((v for v in values if not isinstance(v, int | float | type(None))), None)
    if wrong is not None:
        return f"is not a number but {type(wrong).__name__}: map one of its fields or elements"
    if all(v is None for v in values):
        return "is not a field of these messages"
    return Column(np.array([np.nan if v is None else v for v in values], dtype=np.float64), clock)


def _field(message: Any, parts: list[str]) -> Any:
    for part in parts:
        if isinstance(message, list | tuple | np.ndarray):
            k = int(part) if part.isdigit() else -1
            message = message[k] if 0 <= k < len(message) else None
        elif isinstance(message, dict):
            message = message.get(part)
        else:
            message = getattr(message, part, None)
    return message.item() if isinstance(message, np.generic) else message


def _stamp(message: Any) -> int:
    """ns of the header's stamp; 0 if there is none."""
    stamp = _field(message, ["header", "stamp"])
    seconds, rest = _field(stamp, ["sec"]), _field(stamp, ["nanosec"]) or _field(stamp, ["nsec"]) or 0
    return int(seconds) * 10**9 + int(rest) if isinstance(seconds, int | float) else 0


def _of_mcap(data: bytes, factory: Any) -> Iterator[Message]:
    from mcap.reader import make_reader

    for schema, channel, message in make_reader(io.BytesIO(data)).iter_messages():
        decode = factory.decoder_for(channel.message_encoding, schema)
        if decode is not None:
            yield channel.topic, message.log_time, decode(message.data)
        elif channel.message_encoding == "json":
            yield channel.topic, message.log_time, json.loads(message.data)


def _of_sqlite(data: bytes, factory: Any, path: Path) -> Iterator[Message]:
    with contextlib.closing(sqlite3.connect(":memory:")) as base:
        base.deserialize(data)
        tables = {name for (name,) in base.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"topics", "messages"} <= tables:
            raise RecordingError(
                "this is an SQLite database, but not a ROS 2 bag", where=path, hint="export its table as CSV"
            )
        if "message_definitions" not in tables:
            raise RecordingError(
                "the bag holds no message definitions (ROS 2 before Iron)", where=path, hint=_CURE
            )
        texts = dict(base.execute("SELECT topic_type, encoded_message_definition FROM message_definitions"))
        decoders = {
            number: (topic, factory.decoder_for("cdr", _schema(number, kind, texts[kind])))
            for number, topic, kind in base.execute("SELECT id, name, type FROM topics")
            if kind in texts
        }
        for number, at, content in base.execute(
            "SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp"
        ):
            if number in decoders:
                topic, decode = decoders[number]
                yield topic, at, decode(content)


def _schema(number: int, kind: str, text: str) -> Any:
    from mcap.records import Schema

    return Schema(id=number, name=kind, encoding="ros2msg", data=text.encode())
