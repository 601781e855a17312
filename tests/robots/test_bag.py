"""One joint out of a robot's bag: which topic, which joint, and what was known at which instant."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from hapticd.record import RunFileError, import_run, read_run
from hapticd.record.importing_map import ImportMap, parse_map
from hapticd.robots import import_bag, is_bag

STATES, COMMANDS = "/joint_states", "/effort_controller/commands"
START_NS, ROWS, PERIOD_NS = 1_700_000_000_123_456_789, 200, 10_000_000
STEP = 2 * np.pi / 4096


def position(k: int) -> float:
    return float(STEP * round(100 * np.sin(0.05 * k)))


def command(k: int) -> float:
    """On every other row only, 3 ms before it."""
    return 0.1 * float(np.sin(0.11 * k))


def messages(store: Any, *, with_commands: bool, two_arms: bool = False) -> list[tuple[str, str, int, Any]]:
    types, found = store.types, []
    header, stamp, state, layout, array = (
        types[f"{name}"]
        for name in (
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
            "sensor_msgs/msg/JointState",
            "std_msgs/msg/MultiArrayLayout",
            "std_msgs/msg/Float64MultiArray",
        )
    )
    more = {"seq": 0} if "seq" in header.__dataclass_fields__ else {}
    for k in range(ROWS):
        now = START_NS + k * PERIOD_NS
        names = ["shoulder", "elbow"] if k % 2 else ["elbow", "shoulder"]  # a driver may change their order
        x = np.array([position(k) if name == "elbow" else 9.0 for name in names])
        effort = np.array([command(k) if name == "elbow" else 8.0 for name in names])
        at = stamp(sec=now // 10**9, nanosec=now % 10**9)
        body = state(header(stamp=at, frame_id="", **more), names, x, np.zeros(2), effort)
        found.append((STATES, "sensor_msgs/msg/JointState", now + 200_000, body))
        if two_arms:
            found.append(("/other/joint_states", "sensor_msgs/msg/JointState", now + 200_000, body))
        if with_commands and k % 2 == 0 and k > 4:
            sent = array(layout=layout(dim=[], data_offset=0), data=np.array([7.0, command(k)]))
            found.append((COMMANDS, "std_msgs/msg/Float64MultiArray", now - 3_000_000, sent))
    return sorted(found, key=lambda one: one[2])


def bag(folder: Path, plugin: StoragePlugin = StoragePlugin.MCAP, **what: bool) -> Path:
    store, path = get_typestore(Stores.ROS2_HUMBLE), folder / "robot"
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        topics: dict[str, Any] = {}
        for topic, kind, log, message in messages(store, **({"with_commands": False} | what)):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(topics[topic], log, store.serialize_cdr(message, kind))
    return path


def mapping(**changed: Any) -> ImportMap:
    data: dict[str, Any] = {
        "device": "rotary",
        "time": {"column": "stamp", "unit": "ns"},
        "position": {"column": "elbow.position"},
        "force": {"column": "elbow.effort"},
        "torque_constant": 0.5,
        "encoder": {"counts_per_rev": 4096},
    }
    return parse_map({**data, **changed}, "elbow.yaml")


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_a_joint_by_its_name_whatever_its_place(tmp_path: Path, plugin: StoragePlugin) -> None:
    path = bag(tmp_path, plugin)
    files = [path, *(file for file in path.iterdir() if file.suffix in (".mcap", ".db3"))]
    assert len(files) == 2
    for number, source in enumerate(files):
        assert is_bag(source)
        done = import_bag(source, mapping(), tmp_path / f"{number}.arrow")
        assert (done.rows, done.is_force, done.rate_hz) == (ROWS, True, pytest.approx(100.0))
        columns = read_run(done.path).columns
        np.testing.assert_allclose(columns["encoder_counts"] * STEP, [position(k) for k in range(ROWS)], atol=1e-9)
        np.testing.assert_allclose(columns["force_command"], [command(k) for k in range(ROWS)], rtol=1e-12)
        np.testing.assert_allclose(np.diff(columns["time_s"]), 0.01, atol=1e-9)


def test_a_bag_of_ros_1(tmp_path: Path) -> None:
    store, path = get_typestore(Stores.ROS1_NOETIC), tmp_path / "robot.bag"
    with Writer1(path) as writer:
        connection = None
        for topic, kind, log, message in messages(store, with_commands=False):
            connection = connection or writer.add_connection(topic, kind, typestore=store)
            writer.write(connection, log, store.serialize_ros1(message, kind))
    done = import_bag(path, mapping(), tmp_path / "run.arrow")
    np.testing.assert_allclose(
        read_run(done.path).columns["encoder_counts"] * STEP, [position(k) for k in range(ROWS)], atol=1e-9
    )


def test_a_command_of_another_topic_is_the_last_one_that_was_known(tmp_path: Path) -> None:
    path = bag(tmp_path, with_commands=True)
    asked = mapping(
        time={"column": "log_time", "unit": "ns"},
        current={"column": f"{COMMANDS}:data[1]"},
        force=None,
    )
    done = import_bag(path, asked, tmp_path / "run.arrow")
    assert done.rows == ROWS - 6
    assert any("6 rows before the first" in warning for warning in done.warnings)
    assert any("the last one that is not later" in warning for warning in done.warnings)
    expected = [command(k - k % 2) for k in range(6, ROWS)]
    np.testing.assert_allclose(read_run(done.path).columns["current_command_A"], expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"position": {"column": "wrist.position"}}, "none of 200 messages on /joint_states has it"),
        ({"position": {"column": "elbow.angle"}}, "a joint of a JointState has position, velocity, effort"),
        ({"position": {"column": "/joint_state:elbow.position"}}, "did you mean /joint_states?"),
        ({"time": {"column": "t", "unit": "ns"}}, "column stamp (of the header) or log_time"),
    ],
)
def test_what_is_not_there_is_said(tmp_path: Path, changed: dict[str, Any], said: str) -> None:
    with pytest.raises(RunFileError) as error:
        import_bag(bag(tmp_path), mapping(**changed), tmp_path / "run.arrow")
    assert said in str(error.value)
    assert not (tmp_path / "run.arrow").exists()


def test_two_topics_with_joints_need_a_name(tmp_path: Path) -> None:
    path = bag(tmp_path, two_arms=True)
    with pytest.raises(RunFileError, match=r"2 topics have JointState: write /joint_states:elbow\.position"):
        import_bag(path, mapping(), tmp_path / "run.arrow")
    asked = mapping(
        position={"column": "/other/joint_states:elbow.position"}, force={"column": "/other/joint_states:elbow.effort"}
    )
    assert import_bag(path, asked, tmp_path / "run.arrow").rows == ROWS


Message = tuple[str, str, int, Any]
STAMPED, BY_LOG = {"column": "stamp", "unit": "ns"}, {"column": "log_time", "unit": "ns"}


def state(
    k: int, effort: list[float], *, names: tuple[str, ...] = ("elbow",), topic: str = STATES, stamp: int | None = None
) -> Message:
    """A message of joints, of which the first is at `position`; the recorder takes it at its own instant."""
    types, now = get_typestore(Stores.ROS2_HUMBLE).types, START_NS + k * PERIOD_NS
    at = now if stamp is None else stamp
    header = types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9), frame_id=""
    )
    x = np.array([position(k), *(9.0 for _ in names[1:])])
    kind = "sensor_msgs/msg/JointState"
    return topic, kind, now, types[kind](header, list(names), x, np.zeros(0), np.array(effort))


def sent(k: int, instant_ns: int) -> Message:
    kind = "std_msgs/msg/Float64"
    return "/effort", kind, instant_ns, get_typestore(Stores.ROS2_HUMBLE).types[kind](data=command(k))


def bag_of(folder: Path, found: list[Message]) -> Path:
    store, path = get_typestore(Stores.ROS2_HUMBLE), folder / "robot"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topics: dict[str, Any] = {}
        for topic, kind, log, message in sorted(found, key=lambda one: one[2]):
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(topics[topic], log, store.serialize_cdr(message, kind))
    return path


@pytest.mark.parametrize(
    ("found", "changed", "rows", "warned"),
    [
        (
            [state(k, [] if k % 5 == 0 else [command(k)]) for k in range(100)],
            {},
            80,
            "20 messages without elbow.effort",
        ),
        ([state(k, [np.nan if k % 5 == 0 else 1.0]) for k in range(100)], {}, 80, "20 messages without elbow.effort"),
        ([state(k, [command(k)] if k < 50 else []) for k in range(100)], {}, 50, "50 messages without elbow.effort"),
        (
            [state(k, [1.0], stamp=START_NS + (k - k % 2) * PERIOD_NS) for k in range(100)],
            {},
            50,
            "50 of 100 messages are",
        ),
        (
            [*(state(k, []) for k in range(100)), *(sent(k, START_NS + 10 * k * PERIOD_NS) for k in range(5))],
            {"time": BY_LOG, "force": {"column": "/effort:data"}},
            100,
            "not later, 0.59 s old at most",
        ),
        (
            [*(state(k, []) for k in range(100)), *(sent(k, START_NS + 10 * k * PERIOD_NS) for k in range(5))],
            {"time": STAMPED, "force": {"column": "/effort:data"}},
            100,
            "/effort:data has no stamp of its own",
        ),
        (
            [
                *(state(k, []) for k in range(100)),
                sent(3, START_NS - 100 * PERIOD_NS),
            ],  # one command, which still holds
            {"time": BY_LOG, "force": {"column": "/effort:data"}},
            100,
            "1.99 s old at most",
        ),
    ],
)
def test_what_a_message_lacks_is_not_made_up(
    tmp_path: Path, found: list[Message], changed: dict[str, Any], rows: int, warned: str
) -> None:
    done = import_bag(bag_of(tmp_path, found), mapping(**changed), tmp_path / "run.arrow")
    assert done.rows == rows
    assert any(warned in warning for warning in done.warnings), done.warnings


@pytest.mark.parametrize(
    ("found", "changed", "said"),
    [
        ([state(k, [np.nan]) for k in range(20)], {}, "elbow.effort: none of 20 messages on /joint_states has it"),
        ([state(k, [1.0], names=("elbow", "wrist")) for k in range(20)], {}, "none of 20 messages"),
        ([state(k, [1.0, 2.0], names=("elbow", "elbow")) for k in range(20)], {}, "has the joint elbow 2 times"),
        (
            [state(k, [1.0], stamp=0) for k in range(20)],
            {},
            "all 20 messages have the stamp 0 ns; with time.column: log_time",
        ),
        (
            [state(k, [1.0], topic="/arm/joint_states") for k in range(20)],
            {"position": {"column": "arm/joint_states:elbow.position"}},
            "a topic begins with a slash: write /arm/joint_states:elbow.position",
        ),
        (
            [m for k in range(20) for m in (state(k, []), state(k, [1.0], topic="/arm", stamp=START_NS - 10**12 + k))],
            {"position": {"column": f"{STATES}:elbow.position"}, "force": {"column": "/arm:elbow.effort"}},
            "/arm:elbow.effort and /joint_states:elbow.position have no time in common",
        ),
    ],
)
def test_what_would_be_made_up_is_refused(
    tmp_path: Path, found: list[Message], changed: dict[str, Any], said: str
) -> None:
    with pytest.raises(RunFileError) as error:
        import_bag(bag_of(tmp_path, found), mapping(**changed), tmp_path / "run.arrow")
    assert said in str(error.value)
    assert not (tmp_path / "run.arrow").exists()


def test_what_is_no_bag(tmp_path: Path) -> None:
    (tmp_path / "broken.mcap").write_bytes(b"nothing of the kind")
    with pytest.raises(RunFileError, match="not a readable bag"):
        import_bag(tmp_path / "broken.mcap", mapping(), tmp_path / "run.arrow")
    with pytest.raises(RunFileError, match="no such file"):
        import_bag(tmp_path / "missing.bag", mapping(), tmp_path / "run.arrow")


def test_the_extra_is_named_where_it_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = bag(tmp_path)
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    with pytest.raises(RunFileError, match=r"pip install 'hapticd\[rosbag\]'"):
        import_bag(path, mapping(), tmp_path / "run.arrow")


def test_a_trajectory_of_mujocos_system_identification(tmp_path: Path) -> None:
    times = np.arange(ROWS) * 0.01
    x, u = np.array([position(k) for k in range(ROWS)]), np.array([command(k) for k in range(ROWS)])
    np.savez(
        tmp_path / "trajectory.npz",
        control_times=times,
        control_data=np.column_stack([u, 0 * u]),
        sensordata_times=times,
        sensordata_data=np.column_stack([x, 0 * x, u]),
        initial_state=np.zeros(3),
        sensordata_signal_mapping=np.asarray("joint"),
    )
    asked = mapping(
        time={"column": "sensordata_times"},
        position={"column": "sensordata_data[:,0]"},
        current={"column": "control_data[:,0]"},
        force=None,
    )
    done = import_run(tmp_path / "trajectory.npz", asked, tmp_path / "run.arrow")
    columns = read_run(done.path).columns
    np.testing.assert_allclose(columns["encoder_counts"] * STEP, x, atol=1e-9)
    np.testing.assert_allclose(columns["current_command_A"], u, rtol=1e-12)
