"""Small logs in the formats of others, for the tests: ROS bags by rosbags, ULog by the published format."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

try:
    import rosbags
except ImportError:
    rosbags = None
try:
    import pyulog
except ImportError:
    pyulog = None

NS = 10**9


def time_of(types, ns: int):
    return types["builtin_interfaces/msg/Time"](sec=int(ns // NS), nanosec=int(ns % NS))


def header_of(types, ns: int, version: int):
    extra = {"seq": 0} if version == 1 else {}
    return types["std_msgs/msg/Header"](stamp=time_of(types, ns), frame_id="", **extra)


class BagWriter:
    """kind: "bag1", "bag2" (SQLite), "mcap". Joint states and commands, each (receipt in ns, header in ns, values)."""

    def __init__(self, path: Path, kind: str):
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin, Writer as Writer2
        from rosbags.typesys import Stores, get_typestore
        self.version = 1 if kind == "bag1" else 2
        self.store = get_typestore(Stores.ROS1_NOETIC if kind == "bag1" else Stores.ROS2_HUMBLE)
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        self.writer = Writer1(path) if kind == "bag1" else Writer2(path, version=9, storage_plugin=plugin)
        self.writer.open()
        self.connections: dict = {}

    def topic(self, name: str, kind: str):
        if name not in self.connections:
            self.connections[name] = self.writer.add_connection(name, kind, typestore=self.store)
        return self.connections[name]

    def write(self, topic: str, kind: str, received_ns: int, message) -> None:
        pack = self.store.serialize_ros1 if self.version == 1 else self.store.serialize_cdr
        self.writer.write(self.topic(topic, kind), int(received_ns), bytes(pack(message, kind)))

    def joint_state(self, received_ns: int, header_ns: int, names: list, position: list, velocity=(), topic="/joint_states"):
        types = self.store.types
        message = types["sensor_msgs/msg/JointState"](
            header=header_of(types, header_ns, self.version), name=names, position=np.array(position, float),
            velocity=np.array(velocity, float), effort=np.array([], float))
        self.write(topic, "sensor_msgs/msg/JointState", received_ns, message)

    def imu(self, received_ns: int, header_ns: int, z: float, topic="/imu"):
        types, none = self.store.types, np.zeros(9)
        vector = lambda v: types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=v)
        message = types["sensor_msgs/msg/Imu"](
            header=header_of(types, header_ns, self.version), orientation_covariance=none,
            orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0), angular_velocity=vector(z),
            angular_velocity_covariance=none, linear_acceleration=vector(9.81), linear_acceleration_covariance=none)
        self.write(topic, "sensor_msgs/msg/Imu", received_ns, message)

    def float64(self, received_ns: int, value: float, topic="/command"):
        self.write(topic, "std_msgs/msg/Float64", received_ns, self.store.types["std_msgs/msg/Float64"](data=value))

    def close(self) -> None:
        self.writer.close()


def ulog_bytes(formats: dict, messages: list, start_us: int = 0) -> bytes:
    """`formats`: topic -> "uint64_t timestamp;float[3] xyz"; `messages`: (topic, instance, struct format, values) in
    order. ULog of docs.px4.io/main/en/dev_log/ulog_file_format.html."""
    message = lambda kind, content: struct.pack("<HB", len(content), ord(kind)) + content
    out = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", start_us) + message("B", bytes(40))
    for topic, fields in formats.items():
        out += message("F", f"{topic}:{fields};".encode())
    ids: dict = {}
    for topic, instance, _, _ in messages:
        if (topic, instance) not in ids:
            ids[topic, instance] = len(ids)
            out += message("A", struct.pack("<BH", instance, ids[topic, instance]) + topic.encode())
    for topic, instance, layout, values in messages:
        out += message("D", struct.pack("<H", ids[topic, instance]) + struct.pack("<" + layout, *values))
    return out
