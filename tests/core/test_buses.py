"""MDF files and bags of ROS 2, written by their own libraries: every group and topic with its own clock."""

import sqlite3

import numpy as np
import pytest
from logs import N, T, U, X
from test_containers import Maps, same

from optid.core.readers import read_recording
from optid.errors import RecordingError

NS = np.round(T * 1e9).astype("i8") + 1_714_644_000_000_000_000
HEADER = (
    "std_msgs/Header header\nfloat64[] values\n"
    + "=" * 80
    + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    + "=" * 80
    + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)


def mdf(path, version, *groups):
    asammdf = pytest.importorskip("asammdf")
    with asammdf.MDF(version=version) as file:
        for times, signals in groups:
            file.append(
                [asammdf.Signal(np.ascontiguousarray(v), times, name=n, unit="V") for n, v in signals]
            )
        return file.save(path, overwrite=True)


@pytest.mark.parametrize("version", ["3.30", "4.10"])
def test_mdf_groups_have_their_clocks(version, tmp_path):
    path = mdf(tmp_path / "run.mf4", version, (T, [("u", U), ("x", X)]))
    same(read_recording(path, Maps("time", "u", "x")))
    same(read_recording(path, Maps(None, "u", "x", rate=1000.0)))
    path = mdf(tmp_path / "two.mf4", version, (T, [("u", U)]), (T[::5], [("x", X[::5])]))
    found = read_recording(path, Maps("time", "u", "x"))
    assert np.flatnonzero(np.isfinite(found["position"].values)).tolist() == list(range(0, 46, 5))
    np.testing.assert_allclose(found["command"].values, U[: len(found)])


def test_mdf_names_that_stand_twice_or_not_at_all_and_damage(tmp_path):
    path = mdf(tmp_path / "run.mf4", "4.10", (T, [("a", U)]), (T, [("a", X)]))
    same(read_recording(path, Maps("time", "0/a", "1/a")))
    with pytest.raises(RecordingError, match="is in 2 groups"):
        read_recording(path, Maps("time", "a", "1/a"))
    with pytest.raises(RecordingError, match=r'no column "b"'):
        read_recording(path, Maps("time", "0/a", "b"))
    (tmp_path / "cut.mf4").write_bytes(path.read_bytes()[:60])
    with pytest.raises(RecordingError, match="the MDF data is truncated"):
        read_recording(tmp_path / "cut.mf4", Maps("time", "0/a", "1/a"))


def messages(values, late=0):
    """Stamped when taken; they arrive later, by less and less."""
    for k, (at, value) in enumerate(zip(NS.tolist(), values, strict=True)):
        stamp = {"sec": at // 10**9, "nanosec": at % 10**9}
        yield (
            at + late + 100 * k % 7,
            {"header": {"stamp": stamp, "frame_id": ""}, "values": [0.0, float(value)]},
        )


def mcap(path):
    writer = pytest.importorskip("mcap_ros2.writer")
    with path.open("wb") as file:
        bag = writer.Writer(file)
        kind = bag.register_msgdef("lab_msgs/msg/Stamped", HEADER)
        for topic, values, late in (("/axis/cmd", U, 0), ("/axis/state", X, 3_000_000)):
            for at, message in messages(values, late):
                bag.write_message(topic, kind, message, log_time=at, publish_time=at)
        bag.finish()
    return path


STATE = ("/axis/cmd.header.stamp", "/axis/cmd.values[1]", "/axis/state/values/1")


def test_mcap_by_the_stamps_of_its_messages(tmp_path):
    path = mcap(tmp_path / "run.mcap")
    same(read_recording(path, Maps(*STATE)))
    with pytest.raises(RecordingError, match=r"/axis/cmd\.FIELD, /axis/state\.FIELD"):
        read_recording(path, Maps(STATE[0], STATE[1], "/other.values"))
    with pytest.raises(RecordingError, match="map one of its fields or elements"):
        read_recording(path, Maps(STATE[0], STATE[1], "/axis/state.values"))
    (tmp_path / "cut.mcap").write_bytes(path.read_bytes()[:900])
    with pytest.raises(RecordingError, match="truncated or damaged"):
        read_recording(tmp_path / "cut.mcap", Maps(*STATE))


def test_json_messages_of_foxglove_by_their_arrival(tmp_path):
    writing = pytest.importorskip("mcap.writer")
    with (tmp_path / "run.mcap").open("wb") as file:
        bag = writing.Writer(file)
        bag.start()
        schema = bag.register_schema("axis", "jsonschema", b"{}")
        channel = bag.register_channel("/axis", "json", schema)
        for at, u, x in zip(NS.tolist(), U, X, strict=True):
            bag.add_message(channel, at, f'{{"u": {u}, "pose": {{"x": {x}}}}}'.encode(), at)
        bag.finish()
    same(read_recording(tmp_path / "run.mcap", Maps("/axis.log_time", "/axis.u", "/axis.pose.x")))


def test_db3_bags(tmp_path):
    encoding = pytest.importorskip("mcap_ros2._dynamic")
    encode = encoding.serialize_dynamic("lab_msgs/msg/Stamped", HEADER)["lab_msgs/msg/Stamped"]
    base = sqlite3.connect(tmp_path / "run.db3")
    base.execute("CREATE TABLE topics(id INTEGER, name TEXT, type TEXT)")
    base.execute(
        "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
    )
    for number, (topic, values) in enumerate((("/axis/cmd", U), ("/axis/state", X)), 1):
        base.execute("INSERT INTO topics VALUES (?, ?, 'lab_msgs/msg/Stamped')", (number, topic))
        rows = [(number, at, encode(message)) for at, message in messages(values)]
        base.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
    base.commit()
    with pytest.raises(RecordingError, match="no message definitions"):
        read_recording(tmp_path / "run.db3", Maps(*STATE))
    base.execute("CREATE TABLE message_definitions(topic_type TEXT, encoded_message_definition TEXT)")
    base.execute("INSERT INTO message_definitions VALUES ('lab_msgs/msg/Stamped', ?)", (HEADER,))
    base.commit()
    base.close()
    same(read_recording(tmp_path / "run.db3", Maps(*STATE)))
    assert len(T) == N
