"""Robot logs written from messages, and from the frames, camera and poses of a clip."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from geovp_classic.types import Clip

TF_ROS1 = "geometry_msgs/TransformStamped[] transforms"
START_NS = 1_700_000_000_000_000_000
# the optical axis looks ahead, x of the base points ahead, z up
BASE_FROM_CAM = np.array([[0, 0, 1, 0.3], [-1, 0, 0, 0.02], [0, -1, 0, 1.2], [0, 0, 0, 1.0]])
Message = tuple[str, int, Any]  # topic, time of recording in ns, message
Edit = Callable[[str, Any], Any]


class Messages:
    """Messages of ROS 1 or 2, made from plain values."""

    def __init__(self, is_ros1: bool) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.is_ros1 = is_ros1
        self.store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.LATEST)
        if is_ros1:
            self.store.register(get_types_from_msg(TF_ROS1, "tf2_msgs/msg/TFMessage"))

    def make(self, kind: str, **given: Any) -> Any:
        """Return a message; fields are named as in ROS 2, parts are dicts, what is missing is 0."""
        fields: dict[str, Any] = {}
        for name, (node, detail) in self.store.fielddefs[kind][1]:
            value = given.get(name.lower(), 0)
            if node.name == "NAME":
                value = self.make(detail, **(value or {}))
            elif node.name == "ARRAY" and name.lower() not in given:
                value = np.zeros(detail[1])
            fields[name] = value
        return self.store.types[kind](**fields)

    def image(self, time_ns: int, image: np.ndarray, encoding: str = "rgb8") -> Any:
        height, width = image.shape[:2]
        rows = np.ascontiguousarray(image).view(np.uint8).reshape(height, -1)
        rows = np.pad(rows, ((0, 0), (0, 4)))  # rows may be padded
        return self.make(
            "sensor_msgs/msg/Image",
            header=_header(time_ns, "camera"),
            height=height,
            width=width,
            encoding=encoding,
            step=rows.shape[1],
            data=rows.ravel(),
        )

    def compressed(self, time_ns: int, image: np.ndarray) -> Any:
        data = cv2.imencode(".png", image[..., ::-1])[1].ravel()
        header = _header(time_ns, "camera")
        return self.make("sensor_msgs/msg/CompressedImage", header=header, format="png", data=data)

    def info(
        self,
        time_ns: int,
        clip: Clip,
        lens: Sequence[float] = (0.0,) * 5,
        roi: tuple[int, int, int, int] = (0, 0, 0, 0),
    ) -> Any:
        camera = clip.intrinsics
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=_header(time_ns, "camera"),
            height=camera.height_px,
            width=camera.width_px,
            distortion_model="plumb_bob",
            d=np.array(lens),
            k=camera.matrix.ravel(),
            r=np.eye(3).ravel(),
            p=np.column_stack([camera.matrix, np.zeros(3)]).ravel(),
            roi=dict(zip(("x_offset", "y_offset", "width", "height"), roi, strict=True)),
        )

    def transform(self, time_ns: int, parent: str, child: str, pose: np.ndarray) -> Any:
        """Return a TFMessage."""
        translation, rotation = _parts(pose)
        stamped = self.make(
            "geometry_msgs/msg/TransformStamped",
            header=_header(time_ns, parent),
            child_frame_id=child,
            transform={"translation": translation, "rotation": rotation},
        )
        return self.make("tf2_msgs/msg/TFMessage", transforms=[stamped])

    def pose(self, time_ns: int, parent: str, pose: np.ndarray) -> Any:
        """Return a PoseStamped."""
        position, orientation = _parts(pose)
        return self.make(
            "geometry_msgs/msg/PoseStamped",
            header=_header(time_ns, parent),
            pose={"position": position, "orientation": orientation},
        )

    def odometry(self, time_ns: int, parent: str, child: str, pose: np.ndarray) -> Any:
        position, orientation = _parts(pose)
        return self.make(
            "nav_msgs/msg/Odometry",
            header=_header(time_ns, parent),
            child_frame_id=child,
            pose={"pose": {"position": position, "orientation": orientation}},
        )


def _header(time_ns: int, frame_id: str) -> dict[str, Any]:
    return {
        "stamp": {"sec": time_ns // 10**9, "nanosec": time_ns % 10**9},
        "frame_id": frame_id,
    }


def _parts(pose: np.ndarray) -> list[dict[str, float]]:
    """Return the position and the quaternion of a pose."""
    quaternion = Rotation.from_matrix(pose[:3, :3]).as_quat()
    return [dict(zip("xyzw", part.tolist(), strict=False)) for part in (pose[:3, 3], quaternion)]


def write_messages(path: Path, made: Messages, messages: Sequence[Message]) -> Path:
    """Write a bag of ROS 1 (.bag), or a folder of ROS 2; MCAP if its name ends in `mcap`."""
    from rosbags import rosbag1, rosbag2

    writer: Any
    if made.is_ros1:
        writer, serialize = rosbag1.Writer(path), made.store.serialize_ros1
    else:
        plugins = rosbag2.StoragePlugin
        plugin = plugins.MCAP if path.name.endswith("mcap") else plugins.SQLITE3
        writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        serialize = made.store.serialize_cdr
    with writer:
        connections: dict[str, Any] = {}
        for topic, time_ns, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=made.store)
            writer.write(connections[topic], time_ns, serialize(message, kind))
    return path


def messages_of(
    made: Messages, clip: Clip, edit: Edit = lambda topic, message: message
) -> list[Message]:
    """Return a clip as messages: images, CameraInfo, and a moving base with a mounted camera.

    `edit` returns what is recorded in place of a message, None to omit it.
    """
    messages: list[Message] = []

    def add(topic: str, time_ns: int, message: Any) -> None:
        if (edited := edit(topic, message)) is not None:
            messages.append((topic, time_ns + 3_000_000, edited))

    mount = made.transform(START_NS, "base", "camera", BASE_FROM_CAM)
    add("/tf_static", START_NS, mount)
    for step, frame in enumerate(clip.frames):
        time_ns = START_NS + round((clip.times_s[step] - clip.times_s[0]) * 1e9)
        add("/cam/image_raw", time_ns, made.image(time_ns, frame))
        add("/cam/camera_info", time_ns, made.info(time_ns, clip))
        if clip.trajectory is not None:
            pose = clip.trajectory.world_from_cam[step] @ np.linalg.inv(BASE_FROM_CAM)
            add("/tf", time_ns, made.transform(time_ns, "/odom", "base", pose))
            add("/odometry", time_ns, made.odometry(time_ns, "odom", "base", pose))
    return messages


def write(root: Path, name: str, clip: Clip, edit: Edit = lambda topic, message: message) -> Path:
    """Write a clip as the bag `root/name`."""
    made = Messages(name.endswith(".bag"))
    return write_messages(root / name, made, messages_of(made, clip, edit))
