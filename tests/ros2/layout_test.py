"""The messages are ROS 2's: the same bytes as rosbags makes of the .msg files, and the type hashes that it computes.

    layout_test.py TILLER ROBOT

rosbags has ROS 2's message definitions and its own CDR. What is compared are the types of ros2_types.py, which the
other tests hold against tiller's on the wire, and what a running tiller announces of its topics.
"""
import csv
import dataclasses
import math
import pathlib
import random
import sys
import tempfile
import time

import numpy as np
from cyclonedds.builtin import (BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription,
                                DcpsEndpoint)
from cyclonedds.core import Policy
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from rosbags.typesys import Stores, get_typestore

import ros2_types as ros2
from faults_test import Run
from pendulum_plant import PERIOD_US

MESSAGES = {"sensor_msgs/msg/JointState": ros2.JointState, "sensor_msgs/msg/Imu": ros2.Imu,
            "nav_msgs/msg/Odometry": ros2.Odometry, "std_msgs/msg/Float64MultiArray": ros2.Float64MultiArray,
            "geometry_msgs/msg/PoseStamped": ros2.PoseStamped,
            "trajectory_msgs/msg/JointTrajectory": ros2.JointTrajectory,
            "diagnostic_msgs/msg/DiagnosticArray": ros2.DiagnosticArray,
            "rmw_dds_common/msg/ParticipantEntitiesInfo": ros2.ParticipantEntitiesInfo}
store, dice = get_typestore(Stores.ROS2_JAZZY), random.Random(1)
SOURCE = pathlib.Path(__file__).parents[2] / "runtime/ros2/ros2_wire.cpp"


def value_of(kind):
    """(for our type, for rosbags) of a description of rosbags: base, name, array or sequence."""
    node, detail = kind
    node = int(node)
    if node == 1:
        base = detail[0]
        if base == "string":
            word = "".join(dice.choices("abcxyz_", k=dice.randrange(9)))
            return word, word
        if base.startswith("float"):
            number = dice.gauss(0, 10)
            return number, number
        number = dice.randrange(100)
        return number, number
    if node == 2:
        return message_of(detail)
    inner, count = detail
    count = count if node == 3 else dice.randrange(4)
    pairs = [value_of(inner) for _ in range(count)]
    numbers = int(inner[0]) == 1 and inner[1][0] != "string"
    theirs = [pair[1] for pair in pairs]
    width = np.uint8 if inner[1][0] == "char" else np.float64
    return [pair[0] for pair in pairs], np.array(theirs, dtype=width) if numbers else theirs


def class_of(name):
    return getattr(ros2, name.rsplit("/", 1)[1])


def message_of(name):
    ours, theirs = {}, {}
    for field, kind in store.get_msgdef(name).fields:
        ours[field], theirs[field] = value_of(kind)
    names = [field.name for field in dataclasses.fields(class_of(name))]
    if names != list(ours):
        sys.exit(f"{name} has the fields {list(ours)}, not {names}")
    return class_of(name)(**ours), store.types[name](**theirs)


def compare_bytes():
    for name in MESSAGES:
        for _ in range(50):
            ours, theirs = message_of(name)
            mine, other = bytes(ours.serialize(use_version_2=False)), bytes(store.serialize_cdr(theirs, name))
            if mine[4:].rstrip(b"\0") != other[4:].rstrip(b"\0") or abs(len(mine) - len(other)) > 3:
                sys.exit(f"{name}: {mine.hex()} is not {other.hex()}")
    print(f"{len(MESSAGES)} messages of 50 random values: the bytes of rosbags")


def compare_hashes():
    text = SOURCE.read_text(encoding="utf-8")
    missing = [name for name in MESSAGES if store.hash_rihs01(name) not in text]
    if missing:
        sys.exit(f"{SOURCE.name} has not the hashes of {missing}")


WANTED = {"rt/joint_states": "sensor_msgs/msg/JointState", "rt/pendulum/commands": "std_msgs/msg/Float64MultiArray",
          "rt/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
          "rt/pendulum/joint_trajectory": "trajectory_msgs/msg/JointTrajectory"}


def compare_announced():
    """Names of topics and types, and the user data, as tools of ROS 2 read them."""
    with tempfile.TemporaryDirectory() as name:
        run = Run(pathlib.Path(name), "--lockstep", "--wait", "60", "--goals", "ros2")
        readers = [BuiltinDataReader(run.link.node.participant, kind)
                   for kind in (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription)]
        seen = {}
        for _ in range(600):
            for endpoint in [sample for reader in readers for sample in reader.read(N=100)]:
                data = endpoint.qos[Policy.Userdata] if endpoint.qos and Policy.Userdata in endpoint.qos else None
                if data:
                    seen[endpoint.topic_name] = (endpoint.type_name, bytes(data.data).decode())
            if set(WANTED) <= set(seen):
                break
            time.sleep(0.1)
        run.process.kill()
    for topic, kind in WANTED.items():
        wanted = (kind.replace("/", "::").replace("msg::", "msg::dds_::") + "_", f"typehash={store.hash_rihs01(kind)};")
        if seen.get(topic) != wanted:
            sys.exit(f"{topic} announces {seen.get(topic)}, not {wanted}")
    print("announced as rmw_cyclonedds does:", *sorted(WANTED))


def compare_graph():
    """The node and its endpoints, as `ros2 node list` and `ros2 node info` read them: told before anybody listened."""
    with tempfile.TemporaryDirectory() as name:
        run = Run(pathlib.Path(name), "--lockstep", "--wait", "60", "--goals", "ros2")
        participant = run.link.node.participant
        topic = Topic(participant, "ros_discovery_info", ros2.ParticipantEntitiesInfo)
        reader, endpoints, nodes, participants = DataReader(participant, topic, qos=ros2.GRAPH), {}, {}, set()
        known = [BuiltinDataReader(participant, kind)
                 for kind in (BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription)]
        for _ in range(600):
            for endpoint in [sample for one in known for sample in one.read(N=100)]:
                if isinstance(endpoint, DcpsEndpoint):
                    endpoints[endpoint.key.bytes] = endpoint.topic_name
            for told in reader.take(N=10):
                if isinstance(told, ros2.ParticipantEntitiesInfo):
                    participants.add(bytes(told.gid.data))
                    for node in told.node_entities_info_seq:
                        nodes[node.node_namespace + node.node_name] = [
                            {bytes(gid.data) for gid in gids} for gids in (node.reader_gid_seq, node.writer_gid_seq)]
            if len(nodes) == 2 and all(gid in endpoints for sets in nodes.values() for gids in sets for gid in gids):
                break
            time.sleep(0.1)
        run.process.kill()
    named = {node: [sorted(endpoints[gid] for gid in gids) for gids in sets] for node, sets in nodes.items()}
    wanted = {"/tiller_pendulum": [["rt/joint_states"], ["rt/diagnostics", "rt/pendulum/commands"]],
              "/tiller_pendulum_goals": [["rt/pendulum/joint_trajectory"], []]}
    if named != wanted or len(participants) != 2:
        sys.exit(f"the graph has {named} of {len(participants)} participants, not {wanted}")
    print("in the graph:", *sorted(named))


def steer_by(topic, kind, source, message_of_angle):
    """The pendulum's angle out of another message: every field before it lies where it should, or it is wrong."""
    ticks, text = 40, f'\n[transport]\nkind = "ros2"\nsources = {{ angle_rad = "{source}" }}\n'
    with tempfile.TemporaryDirectory() as name:
        run = Run(pathlib.Path(name), "--lockstep", "--wait", "60", "--patience", "60", "--log", "run.csv", "--seconds",
                  str(0.02 * ticks), more_text=text)
        writer, angles = run.link.node.writer(topic, kind), []

        def publish(k, angle):
            angles.append(angle)
            header = ros2.stamp(10**9 + k * PERIOD_US * 1000)
            header.frame_id = "world" * (k % 4)
            writer.write(message_of_angle(header, angle))

        k = 0
        while run.tick(k, 20.0 if k < ticks else 1.0, publish=publish):
            k += 1
        run.end(0)
        with open(pathlib.Path(name) / "run.csv", encoding="utf-8", newline="") as log:
            measured = [float(row["angle_rad"]) for row in csv.DictReader(log)]
    sent = list(dict.fromkeys(angles))[:len(measured)]
    if len(measured) < ticks or max(abs(a - b) for a, b in zip(sent, measured)) > 1e-9:
        sys.exit(f"{source}: sent {sent[:3]}, measured {measured[:3]}")
    print(f"{source}: {ticks} ticks")


def yaw(angle):
    return ros2.Quaternion(z=math.sin(angle / 2), w=math.cos(angle / 2))


def odometry_of(header, angle):
    pose = ros2.PoseWithCovariance(ros2.Pose(orientation=yaw(angle)), [0.1] * 36)
    return ros2.Odometry(header, "base" * (header.stamp.nanosec % 3), pose)


def imu_of(header, angle):
    return ros2.Imu(header, orientation_covariance=[0.1] * 9, linear_acceleration=ros2.Vector3(1.0, angle, 3.0))


if __name__ == "__main__":
    compare_bytes()
    compare_hashes()
    compare_announced()
    compare_graph()
    steer_by("odom", ros2.Odometry, "odometry:yaw", odometry_of)
    steer_by("imu", ros2.Imu, "imu:linear_acceleration.y", imu_of)
