"""Robot logs of ROS 1 (.bag), ROS 2 (a folder with metadata.yaml, .db3) and MCAP (.mcap).

Messages have the time of their stamp, or that of their recording if they are not stamped. Messages
are read when they are needed; a bag is never in memory as a whole.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import cv2
import numpy as np

from geovp_classic import files
from geovp_classic.data.formats.calibration_files import camera_of_yaml, scaled_to
from geovp_classic.data.formats.frame_tree import FrameTree
from geovp_classic.data.formats.pose_files import pose_of_quaternion
from geovp_classic.data.frames import image_frames
from geovp_classic.data.frames.image_frames import Size
from geovp_classic.data.frames.undistortion import DistortedCamera
from geovp_classic.errors import BadData, MissingExtra, install_command
from geovp_classic.types import ByteArray, FloatArray

TYPES = {
    "image": ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"),
    "info": ("sensor_msgs/msg/CameraInfo",),
    "pose": (
        "nav_msgs/msg/Odometry",
        "geometry_msgs/msg/PoseStamped",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "geometry_msgs/msg/TransformStamped",
    ),
    "tf": ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"),
}
# of raw images, by their encoding without its 8 or 16 bits: values per pixel, and OpenCV's
# conversion to RGB
ENCODINGS: dict[str, tuple[int, int | None]] = {
    "rgb": (3, None),
    "bgr": (3, cv2.COLOR_BGR2RGB),
    "8UC3": (3, cv2.COLOR_BGR2RGB),
    "rgba": (4, cv2.COLOR_RGBA2RGB),
    "bgra": (4, cv2.COLOR_BGRA2RGB),
    "8UC4": (4, cv2.COLOR_BGRA2RGB),
    "mono": (1, cv2.COLOR_GRAY2RGB),
    "8UC1": (1, cv2.COLOR_GRAY2RGB),
    "bayer_rggb": (1, cv2.COLOR_BayerRGGB2RGB),
    "bayer_bggr": (1, cv2.COLOR_BayerBGGR2RGB),
    "bayer_gbrg": (1, cv2.COLOR_BayerGBRG2RGB),
    "bayer_grbg": (1, cv2.COLOR_BayerGRBG2RGB),
    "yuv422": (2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2RGB_YUYV),
    "yuyv": (2, cv2.COLOR_YUV2RGB_YUYV),
    "nv12": (1, cv2.COLOR_YUV2RGB_NV12),  # colours in more rows, half as many
    "nv21": (1, cv2.COLOR_YUV2RGB_NV21),
}


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag by its name, or a folder that ROS 2 wrote."""
    if path.is_dir():
        return os.path.isfile(path / "metadata.yaml")  # False in a folder that cannot be read
    return path.suffix.lower() in (".bag", ".mcap", ".db3")


class Bag:
    """A bag that is open for reading."""

    def __init__(self, path: Path) -> None:
        """Open a bag; BadData if it is damaged, MissingExtra without the library."""
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError as problem:
            raise MissingExtra(
                f"bags need rosbags, which is not installed: {install_command('rosbag')}"
            ) from problem
        self.path = path
        with self._checked():
            if any(map(Path.is_fifo, (path, *path.glob("*")))):
                raise ValueError("a pipe never ends")
            # before 2023, ROS 2 did not store the definitions of messages
            store = get_typestore(Stores.LATEST)
            self._reader = AnyReader([path], default_typestore=store)
            self._reader.open()

    def _checked(self) -> Any:
        advice = (
            "copy it again, or repair it with `rosbag reindex`, `ros2 bag reindex` or "
            "`mcap recover`"
        )
        return files.checked(f"{self.path} cannot be read as a bag", advice)

    def topics(self, kind: str) -> list[str]:
        """Return the topics with messages of a kind (see TYPES), sorted."""
        topics = sorted(
            topic
            for topic, info in self._reader.topics.items()
            if info.msgtype in TYPES[kind] and info.msgcount
        )
        if kind == "image" and len(topics) > 1:  # a depth camera has both
            firsts = ((topic, next(self.messages(topic))) for topic in topics)
            return [topic for topic, (_, message) in firsts if not has_depths(message)] or topics
        return topics

    def choose(self, kind: str, topic: str | None) -> str:
        """Return a named topic, else the only one of its kind, "" if there is none.

        BadData lists the topics if there are several, or if the named one is missing.
        """
        topics = self.topics(kind)
        if topic in topics or (topic is None and len(topics) < 2):
            return topic or "".join(topics)
        message = f"{self.path} has {len(topics)} {kind} topics"
        if topic is not None:
            message = f"{self.path} has no {kind} topic {topic!r}"
        names = ", ".join(topics) or "none"
        raise BadData(f"{message}: give {kind}_topic, one of {names}")

    def messages(
        self, topic: str, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[tuple[int, Any]]:
        """Yield the messages recorded in [start_ns, end_ns), each after its time of recording."""
        connections = [each for each in self._reader.connections if each.topic == topic]
        if not connections:  # which would stand for all
            return
        with self._checked():
            for connection, recorded_ns, data in self._reader.messages(
                connections, start_ns, end_ns
            ):
                kind = connection.msgtype
                yield recorded_ns, self._reader.deserialize(data, kind)

    def camera(self, image_topic: str, size_px: Size) -> DistortedCamera | None:
        """Return the camera of images, None if no CameraInfo that belongs to them is calibrated.

        It is in the namespace of the images, or the only one of the bag.
        """
        topics = self.topics("info")
        parents = PurePosixPath(image_topic).parents
        names = [str(parent / "camera_info") for parent in parents]
        topic = next(filter(topics.__contains__, names), None)
        if topic is None and len(topics) == 1:
            topic = topics[0]
        if topic is None:
            return None
        source = f"{self.path}: {topic}"
        with files.checked(f"{source} is not a calibration", "give intrinsics"):
            _, message = next(self.messages(topic))
            # ROS 1 has capital letters
            table = {
                name.lower(): value.tolist() if isinstance(value, np.ndarray) else value
                for name, value in vars(message).items()
            }
            if not any(table["k"]):
                return None
            table["roi"] = vars(message.roi)
            if "/image_rect" in image_topic:  # the names of image_proc
                matrix = np.reshape(table["p"], (3, 4))[:, :3]
                table |= {"k": matrix.tolist(), "d": [], "distortion_model": "none"}
            camera = camera_of_yaml(table)
        return scaled_to(camera, size_px, source)

    def add_links(self, tree: FrameTree, topic: str) -> None:
        """Add the poses of a topic, or the transforms of tf; a frame that is not named is ""."""
        for recorded_ns, message in self.messages(topic):
            for item in getattr(message, "transforms", [message]):
                # those of tf 1 begin with a slash
                parent = item.header.frame_id.strip("/")
                child = getattr(item, "child_frame_id", "").strip("/")
                time_s = stamp_ns(item, recorded_ns) / 1e9
                if (pose := pose_of(item)) is not None:
                    tree.add(parent, child, time_s, pose)


class BagImages:
    """The images of a topic in the order of their times; each is decoded when it is read."""

    def __init__(self, bag: Bag, topic: str | None, bits: int | None) -> None:
        """Read the times of all images, and decode the first; `bits` as in `read_image`."""
        self.topic = bag.choose("image", topic)
        stamps = []
        for time_ns, message in bag.messages(self.topic):
            stamps.append((stamp_ns(message, time_ns), time_ns))
            self.frame_id = message.header.frame_id.strip("/")
        # drivers that do not set the stamp repeat one: the time of recording tells images apart
        self._is_stamped = 2 * len({stamp for stamp, _ in stamps}) > len(stamps)
        recorded_ns = {stamp if self._is_stamped else time_ns: time_ns for stamp, time_ns in stamps}
        if not recorded_ns:
            raise BadData(
                f"{bag.path} has no messages of type Image or CompressedImage: record the topic "
                "of a camera"
            )
        self._bag, self._bits = bag, bits
        self._recorded_ns = dict(sorted(recorded_ns.items()))
        self.times_s = np.array(list(self._recorded_ns)) / 1e9  # [N]
        # no files have these names
        folder = bag.path / self.topic.strip("/")
        self.names = tuple(folder / str(stamp) for stamp in self._recorded_ns)
        self.size_px = self.read(self.names[0]).shape[1::-1]

    def read(self, name: Path) -> ByteArray:
        """Return one of the images [H, W, 3]; BadData if it cannot be decoded."""
        recorded_ns = self._recorded_ns[int(name.name)]
        recorded = self._bag.messages(self.topic, recorded_ns, recorded_ns + 1)
        message = next(
            message
            for _, message in recorded
            if not self._is_stamped or stamp_ns(message, recorded_ns) == int(name.name)
        )
        return decode(name, message, self._bits)


def has_depths(message: Any) -> bool:
    """Return whether an image has depths, by its encoding or format."""
    about = str(getattr(message, "encoding", "") or getattr(message, "format", ""))
    return "compressedDepth" in about or about.startswith(("16UC1", "32FC1"))


def decode(name: Path, message: Any, bits: int | None = None) -> ByteArray:
    """Return the RGB image [H, W, 3] of a message; `bits` as in `read_image`.

    BadData calls the image `name`.
    """
    if has_depths(message):
        raise BadData(f"{name} is of a depth topic: give the image_topic of a camera")
    if hasattr(message, "format"):  # CompressedImage, "encoding; codec compressed"
        image = image_frames.read_image(name, bits, message.data.tobytes())
        # a mosaic; image_transport names it, too, where it has demosaicked
        kind, _ = _encoding(message.format.partition(";")[0].strip())
        is_grey = bool((image == image[..., :1]).all())
        _, conversion = ENCODINGS.get(kind, (1, None))
        if not kind.startswith("bayer") or conversion is None or not is_grey:
            return image
        return cv2.cvtColor(image[..., 0], conversion)
    kind, depth = _encoding(message.encoding)
    if kind not in ENCODINGS:
        raise BadData(
            f"{name} has the encoding {message.encoding!r}, expected 8 or 16 bits of "
            f"{', '.join(ENCODINGS)}: convert the topic, or give another image_topic"
        )
    num_values, conversion = ENCODINGS[kind]
    num_rows = message.height * 3 // 2 if kind.startswith("nv") else message.height
    problem = f"{name} is not an image", "record the topic again"
    with files.checked(*problem):
        values = message.data.view("<>"[bool(message.is_bigendian)] + depth)
        rows = values.reshape(num_rows, -1)
        width = message.width * num_values
        if rows.shape[1] >= 2 * width:  # rows may be padded
            raise ValueError(f"rows have {rows.shape[1]} values, {message.encoding} has {width}")
        rows = rows[:, :width].astype(depth)
        image = rows.reshape(num_rows, message.width, num_values)
    image = image_frames.to_8_bits(name, image, bits)
    with files.checked(*problem):
        return image if conversion is None else cv2.cvtColor(image, conversion)


def _encoding(text: str) -> tuple[str, str]:
    """Return an encoding without its bits, and NumPy's name of their type."""
    for bits, depth in (("16", "u2"), ("8", "u1")):
        if text.endswith(bits):
            return text.removesuffix(bits), depth
    return text, "u1"


def stamp_ns(message: Any, recorded_ns: int) -> int:
    """Return the time in nanoseconds of a message's stamp, else that of its recording."""
    stamp = message.header.stamp
    return stamp.sec * 10**9 + stamp.nanosec or recorded_ns


def pose_of(message: Any) -> FloatArray | None:
    """Return parent_from_child [4, 4] of a pose or transform.

    None without a rotation or a position: trackers that are lost give zeros or NaN.
    """
    value = getattr(message, "transform", None) or message.pose
    value = getattr(value, "pose", value)  # next to a covariance
    position = getattr(value, "position", None) or value.translation
    turn = getattr(value, "orientation", None) or value.rotation
    numbers = [getattr(position, axis) for axis in "xyz"]
    numbers += [getattr(turn, axis) for axis in "xyzw"]
    with contextlib.suppress(BadData):
        if np.isfinite(numbers).all():
            return pose_of_quaternion(np.array([0.0, *numbers]))
    return None
