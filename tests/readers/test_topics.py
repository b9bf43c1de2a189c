"""Bags of ROS 2 and MCAP files of others: fields become columns on the fastest topic's stamps."""

import numpy as np
import pytest

from hexsim.errors import HexsimError
from hexsim.readers.files import raw_table

pytest.importorskip("mcap", reason="pip install hexsim[ros]")
rosbag2 = pytest.importorskip("rosbags.rosbag2", reason="pip install hexsim[ros]")
from rosbags.typesys import Stores, get_typestore  # noqa: E402

STORE = get_typestore(Stores.ROS2_HUMBLE)
JOINTS, IMU, TEXT = "sensor_msgs/msg/JointState", "sensor_msgs/msg/Imu", "std_msgs/msg/String"
TOPICS = {JOINTS: "/joint_states", IMU: "/imu", TEXT: "/note"}
START_ns = 1_700_000_000_000_000_000


def header(stamp_ns: int):
    time = STORE.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return STORE.types["std_msgs/msg/Header"](stamp=time, frame_id="base")


def joints(stamp_ns: int):
    t = 1e-9 * (stamp_ns - START_ns)
    position = np.array([np.sin(t), np.cos(t)])
    return STORE.types[JOINTS](
        header=header(stamp_ns), name=["a", "b"], position=position, velocity=position, effort=np.zeros(0)
    )


def imu(stamp_ns: int):
    t = 1e-9 * (stamp_ns - START_ns)
    vector, turn = STORE.types["geometry_msgs/msg/Vector3"], STORE.types["geometry_msgs/msg/Quaternion"]
    return STORE.types[IMU](
        header=header(stamp_ns), orientation=turn(x=0.0, y=0.0, z=0.0, w=1.0), orientation_covariance=np.zeros(9),
        angular_velocity=vector(x=0.0, y=0.0, z=2 * t), angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(x=t, y=0.0, z=9.81), linear_acceleration_covariance=np.zeros(9),
    )  # fmt: skip


@pytest.fixture(params=("db3", "mcap"))
def bag(request, tmp_path):
    """Joint states at 100 Hz, an IMU at 50 Hz, and a text; received 5 ms after their header's stamp."""
    storage = {"db3": rosbag2.StoragePlugin.SQLITE3, "mcap": rosbag2.StoragePlugin.MCAP}[request.param]
    with rosbag2.Writer(tmp_path / "bag", version=9, storage_plugin=storage) as writer:
        channels = {kind: writer.add_connection(topic, kind, typestore=STORE) for kind, topic in TOPICS.items()}
        for k in range(200):
            stamp = START_ns + k * 10_000_000
            writer.write(channels[JOINTS], stamp + 5_000_000, STORE.serialize_cdr(joints(stamp), JOINTS))
            if k % 2 == 0:
                writer.write(channels[IMU], stamp + 5_000_000, STORE.serialize_cdr(imu(stamp), IMU))
        text = STORE.types[TEXT](data="begun")
        writer.write(channels[TEXT], START_ns, STORE.serialize_cdr(text, TEXT))
    return next((tmp_path / "bag").glob(f"*.{request.param}"))


def test_fields_of_messages_become_columns(bag):
    """Positions by joint at header stamps from 0 on, the slower IMU linear between its samples, names as short as they can be."""
    table = raw_table(bag)
    time = table.columns["time_s"]
    assert time == pytest.approx(0.01 * np.arange(200), abs=1e-9)
    assert table.columns["position_1"] == pytest.approx(np.sin(time), abs=1e-12)
    assert table.columns["position_2"] == pytest.approx(np.cos(time), abs=1e-12)
    inside = time < 1.98
    assert table.columns["imu.linear_acceleration.x"][inside] == pytest.approx(time[inside], abs=1e-9)
    assert any("100 samples, the fastest 200: linear between them" in loss for loss in table.losses)


def test_damaged_files_are_a_sentence(tmp_path):
    """Text under either name, and an empty file."""
    for name, content in (
        ("a.mcap", b"no"),
        ("b.db3", b"no bag at all, but text that is long enough to be read"),
        ("c.mcap", b""),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(HexsimError, match=f"cannot read .*{name} as "):
            raw_table(tmp_path / name)
