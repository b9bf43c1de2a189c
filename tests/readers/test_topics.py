"""Bags of ROS 2 and MCAP files of others: fields are signals with the stamps of their topic."""

import numpy as np
import pytest

from hexsim import HexsimError, readers
from hexsim.readers import files

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


def test_fields_of_messages_are_signals_with_the_stamps_of_their_topic(bag):
    """Positions under the name of their joint, each topic on its own stamps: of the header, and of receipt 5 ms later."""
    raw = files.raw_log(bag)
    position, turn = raw.one("joint_states.position.b", "b", bag), raw.one("angular_velocity.z", "turn", bag)
    assert raw.find("position_2") == [position]
    assert position.values == pytest.approx(np.cos(0.01 * np.arange(200)), abs=1e-12)
    for signal, period, n in ((position, 0.01, 200), (turn, 0.02, 100)):
        assert signal.stamps["header time"] == pytest.approx(period * np.arange(n), abs=1e-9)
        assert np.diff(signal.stamps["time of receipt"]) == pytest.approx(np.full(n - 1, period), abs=1e-9)


def test_a_slower_topic_is_interpolated_and_weighs_less(bag):
    """The grid is that of the joints at 100 Hz; the IMU at 50 Hz is a curve through its samples, of half the weight."""
    mapping = readers.Mapping.model_validate(
        {"kind": "own", "columns": {"joint": {"from": "position.a"}, "turn_rad_s": {"from": "angular_velocity.z"}}}
    )
    log = readers.read_log(bag, mapping)
    assert (log.rate, log.n) == (100.0, 199)
    assert log.columns["turn_rad_s"] == pytest.approx(2 * log.time, abs=1e-9)
    assert log.columns["joint"] == pytest.approx(np.sin(log.time), abs=1e-12)
    assert set(log.sampled) == {"turn_rad_s"} and log.weight("turn_rad_s") == pytest.approx(np.full(199, 0.5))
    assert any(
        "turn_rad_s: 100 samples, the grid has 200 points: compared at its samples alone" in loss for loss in log.losses
    )


def test_damaged_files_are_a_sentence(tmp_path):
    """Text under either name, and an empty file."""
    for name, content in (
        ("a.mcap", b"no"),
        ("b.db3", b"no bag at all, but text that is long enough to be read"),
        ("c.mcap", b""),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(HexsimError, match=f"cannot read .*{name} as "):
            files.raw_log(tmp_path / name)
