"""Reads exports as others would: python tests/clients/export.py URL

`rosbags` opens the bag and knows the messages, `mcap-ros2-support` decodes them from the embedded schemas alone, and SciPy integrates
the exported twist.
"""

import io
import math
import sys
import tempfile

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from scipy.integrate import solve_ivp

import slipdrive

RATE_HZ = 100
START_NS = 5_000_000_007
# What rounding may move, m and rad: SciPy's tolerance over some meters.
ROUNDING = 1e-8


def seconds(stamp) -> float:
    return stamp.sec + 1e-9 * stamp.nanosec


def integrated(time, twist, pose) -> np.ndarray:
    """Where the twist, linear between the points, leads from a pose."""

    def rate(now, state):
        forward, left, turn = (np.interp(now, time, one) for one in twist.T)
        sin, cos = math.sin(state[2]), math.cos(state[2])
        return [cos * forward - sin * left, sin * forward + cos * left, turn]

    # Each interval by itself: at the points the twist has kinks.
    for begin, end in zip(time, time[1:]):
        pose = solve_ivp(rate, (begin, end), pose, rtol=1e-10, atol=1e-12).y[:, -1]
    return pose


def check_twist(plan, exported, largest_miss: float) -> None:
    rows = np.genfromtxt(io.BytesIO(exported["trajectory.csv"]), delimiter=",", names=True)
    pose = np.column_stack([rows["x_m"], rows["y_m"], rows["yaw_rad"]])
    twist = np.column_stack([rows["velocity_forward_m_s"], rows["velocity_left_m_s"], rows["yaw_rate_rad_s"]])
    assert rows["time_s"][-1] == plan.final_time_s and np.allclose(np.diff(rows["time_s"])[:-1], 1 / RATE_HZ)
    end = integrated(rows["time_s"], twist, pose[0]) - pose[-1]
    for found, stated in [(math.hypot(end[0], end[1]), exported.miss_m), (abs(end[2]), exported.miss_rad)]:
        assert abs(found - stated) <= 0.1 * stated + ROUNDING, (found, stated)
    assert exported.miss_m <= largest_miss and exported.miss_rad <= largest_miss, exported
    print(f"miss {1e3 * exported.miss_m:.3f} mm and {1e3 * exported.miss_rad:.3f} mrad")


def check_bag(plan, rows) -> None:
    exported = plan.export(
        format="ros2_mcap",
        rate_hz=RATE_HZ,
        frame_id="map",
        start_time={"sec": START_NS // 10**9, "nanosec": START_NS % 10**9},
        joint_names=["left", "right"],
    )
    store = get_typestore(Stores.ROS2_LYRICAL)
    with tempfile.TemporaryDirectory() as folder:
        exported.save(folder)
        with Reader(folder) as bag:
            assert bag.message_count == 2 and bag.start_time == START_NS, bag.start_time
            known = [(connection.topic, at, store.deserialize_cdr(raw, connection.msgtype)) for connection, at, raw in bag.messages()]
    assert [(topic, at) for topic, at, _ in known] == [("/plan/trajectory", START_NS), ("/plan/joint_trajectory", START_NS)]
    reader = make_reader(io.BytesIO(exported["plan.mcap"]), decoder_factories=[DecoderFactory()])
    embedded = [message for *_, message in reader.iter_decoded_messages()]
    for (_, _, by_store), by_schema in zip(known, embedded):
        assert same(by_store, by_schema)

    trajectory, joints = (message for _, _, message in known)
    assert len(trajectory.points) == len(rows) and trajectory.header.frame_id == "map"
    for point, row in zip(trajectory.points, rows):
        assert abs(seconds(point.header.stamp) - 1e-9 * START_NS - row["time_s"]) < 2e-9
        assert (point.pose.position.x, point.pose.position.y) == (row["x_m"], row["y_m"])
        turn = 2 * math.atan2(point.pose.orientation.z, point.pose.orientation.w) - row["yaw_rad"]
        assert abs(math.remainder(turn, 2 * math.pi)) < 1e-12
        assert (point.velocity.linear.x, point.velocity.linear.y) == (row["velocity_forward_m_s"], row["velocity_left_m_s"])
        assert math.isnan(point.acceleration.linear.x) and math.isnan(point.effort.force.x)
    assert list(joints.joint_names) == ["left", "right"]
    time = np.array([seconds(point.time_from_start) for point in joints.points])
    effort = np.array([point.effort for point in joints.points])
    assert (np.diff(time) > 0).all() and abs(time[-1] - plan.final_time_s) < 1e-9
    # As one who holds or interpolates the efforts would apply them: the torques of the plan in every interval.
    torques = plan.torque_schedule
    middles = (np.arange(len(torques.left_n_m)) + 0.5) * torques.interval_s
    for wheel, of_plan in enumerate([torques.left_n_m, torques.right_n_m]):
        assert (np.interp(middles, time, effort[:, wheel]) == of_plan).all()


def same(one, other) -> bool:
    """Whether two readers have read the same, field by field."""
    if hasattr(one, "__dataclass_fields__"):
        return all(same(getattr(one, name), getattr(other, name)) for name in one.__dataclass_fields__ if not name.startswith("__"))
    if isinstance(one, (list, tuple, np.ndarray)):
        return len(one) == len(other) and all(map(same, one, other))
    return one == other or (one != one and other != other)


def main() -> None:
    client = slipdrive.Client(sys.argv[1])
    turn = {"goal": {"x_m": -1.5, "y_m": 2, "heading_rad": 1}, "slip": "forbidden"}
    slow = {"grid": {"steps": 400}, "solver": {"starts": 4}, "view": "plan"}
    rolling = client.solve({"maneuver": turn, **slow})
    sliding = client.solve({**client.example(), "view": "plan"})
    for plan, largest_miss in [(rolling, 1e-3), (sliding, 5e-3)]:
        assert plan.status == "converged", plan.status
        table = plan.export(format="csv", rate_hz=RATE_HZ)
        check_twist(plan, table, largest_miss)
        check_bag(plan, np.genfromtxt(io.BytesIO(table["trajectory.csv"]), delimiter=",", names=True))
    print("exports are read")


if __name__ == "__main__":
    main()
